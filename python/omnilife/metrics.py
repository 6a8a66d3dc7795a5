"""Every metric that omnilife scores by, of arrays.

    from omnilife.metrics import psnr, ws_psnr, lpips_alex
    psnr(prediction, truth)

Images are NumPy arrays or PyTorch tensors on any device, (height, width, 3) or (3, height, width), one
or a batch (N, ...) of them.

A metric is the attribute of its id with `_` for `-`, and an entry of `METRICS`. They are walked from
the program's own list, so that a metric that is added there is here. Their numbers are those of
`omnilife bench score`, which compares 8-bit images: values in [0, 1] are rounded to bytes first, as it
rounds predictions that come as .npy.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Optional, Union

import numpy as np

from . import _arrays, _html, _layouts, _native
from ._arrays import F64
from ._layouts import Layout
from .errors import InputError, UndefinedScore

#: An array or a tensor.
Image = Any
#: An array or a tensor; for a batch also a list, with None for the images without one.
Mask = Any


@dataclass(frozen=True)
class Metric:
    """A metric: a number for a predicted image beside its ground truth."""

    #: As it stands in protocols and results.
    id: str
    #: Name for people.
    title: str
    #: Empty for plain numbers.
    unit: str
    #: `higher-is-better`, `lower-is-better`, or None for what is only read beside another.
    direction: Optional[str]
    #: Lowest and highest possible value.
    range: tuple[float, float]
    #: The definition: formula, conventions and where they are published.
    source: str
    #: What it needs beside two images: pairs of a kind and a name, such as ("class-mask", "human").
    needs: tuple[tuple[str, str], ...]

    def __call__(
        self,
        prediction: Image,
        truth: Image,
        *,
        layout: Optional[Layout] = None,
        mask: Optional[Union[Mask, Mapping[str, Mask]]] = None,
        depth: Optional[tuple[Mask, Mask]] = None,
        previous: Optional[tuple[Image, Image]] = None,
        ignored: Optional[Mask] = None,
    ) -> Any:
        """Compares two images, in uint8 or as floats in [0, 1], and returns a float.

        Two batches (N, ...) give an array (N) of floats, NaN where the metric has no value. `layout` is
        "HWC" or "CHW", of all images. Without it the channels are the axis of length 3, of which each
        image must have only one.

        `mask` (height, width) marks, as the metric needs it, what moves or the objects of its class; of
        metrics of single objects it is one mask or a dictionary of masks by name. `depth` are
        predicted and true distances (height, width) along the rays, 0 for unknown, `previous` is the
        pair of images before this one in time. Pixels that `ignored` (height, width) marks do not count,
        as those of a scene's `Frame.ignored`. Metrics that need a ("sphere", "") take the images for
        panoramas, whatever they show.

        For a batch, masks and distances are (N, height, width), one (height, width) for all, or a list
        with None for images without. They may have an axis of one channel.

        Raises `UndefinedScore` where the metric has no value, such as for a mask that marks nothing, and
        `InputError` for what it needs and does not get, or gets and does not need.
        """
        masks: dict[str, Mask] = {}
        kinds = dict(self.needs)
        if "object-masks" in kinds:
            masks = dict(mask) if isinstance(mask, Mapping) else {} if mask is None else {"": mask}
        elif isinstance(mask, Mapping):
            raise InputError(f"{self.id} takes one mask")
        of_class = kinds.get("class-mask")
        is_masked = "dynamic-mask" in kinds
        given = {"a mask": mask, "depth": depth, "previous": previous}
        takes = {
            "a mask": is_masked or of_class is not None or "object-masks" in kinds,
            "depth": "depth" in kinds,
            "previous": "previous-view" in kinds,
        }
        for name, value in given.items():
            if value is not None and not takes[name]:
                hint = "; psnr-static, psnr-dynamic and their like do" if name == "a mask" else ""
                raise InputError(f"{self.id} does not take {name}{hint}")
            if value is None and takes[name] and name != "previous":
                raise InputError(f"{self.id} needs {name}")
        single = None if mask is None or isinstance(mask, Mapping) else mask
        outcomes, is_batch = _outcomes(
            [self.id],
            prediction,
            truth,
            layout,
            mask=single if is_masked else None,
            classes={of_class: single} if of_class is not None and single is not None else {},
            objects=masks,
            depth=depth,
            previous=previous,
            ignored=ignored,
        )
        if is_batch:
            return _numbers(outcomes, 0)
        outcome = outcomes[0][0]
        if isinstance(outcome, str):
            raise UndefinedScore(f"{self.id} is undefined: {outcome}")
        return outcome

    def _repr_html_(self) -> str:
        about = {
            "id": self.id,
            "unit": self.unit or None,
            "direction": self.direction,
            "range": f"{self.range[0]:g} to {self.range[1]:g}",
            "needs": ", ".join(" ".join(filter(None, need)) for need in self.needs) or None,
            "definition": self.source,
        }
        return _html.facts(self.title, about)


def compute(
    prediction: Image,
    truth: Image,
    metrics: Iterable[str],
    *,
    layout: Optional[Layout] = None,
    mask: Optional[Mask] = None,
    classes: Optional[Mapping[str, Mask]] = None,
    objects: Optional[Mapping[str, Mask]] = None,
    depth: Optional[tuple[Mask, Mask]] = None,
    previous: Optional[tuple[Image, Image]] = None,
    ignored: Optional[Mask] = None,
) -> dict[str, Any]:
    """Several metrics by id, None where one is undefined; what they share is computed once.

    Batches give an array (N) for each, NaN where it is undefined; shapes and `layout` are those of `Metric`.
    `mask` marks what moves, `classes` and `objects` hold the masks of classes and of single objects,
    `ignored` marks the pixels that do not count.
    """
    ids = list(metrics)
    outcomes, is_batch = _outcomes(
        ids,
        prediction,
        truth,
        layout,
        mask=mask,
        classes=classes or {},
        objects=objects or {},
        depth=depth,
        previous=previous,
        ignored=ignored,
    )
    if is_batch:
        return {id: _numbers(outcomes, at) for at, id in enumerate(ids)}
    return {
        id: None if isinstance(outcome, str) else outcome for id, outcome in zip(ids, outcomes[0])
    }


#: A score, or the reason why there is none.
Outcome = Union[float, str]


def _outcomes(
    ids: list[str],
    prediction: Image,
    truth: Image,
    layout: Optional[Layout],
    *,
    mask: Optional[Mask],
    classes: Mapping[str, Mask],
    objects: Mapping[str, Mask],
    depth: Optional[tuple[Mask, Mask]],
    previous: Optional[tuple[Image, Image]],
    ignored: Optional[Mask],
) -> tuple[list[list[Outcome]], bool]:
    """The outcomes of every image, and whether the images are a batch."""
    images = _layouts.images(prediction, "prediction", layout)
    count = len(images.arrays)

    def like(given: Image, name: str) -> list[_layouts.Array]:
        found = _layouts.images(given, name, layout)
        if found.shape != images.shape:
            raise InputError(f"{name} is of shape {found.shape}, the prediction of {images.shape}")
        return found.arrays

    def pairs(
        given: Optional[tuple[Any, Any]], take: Callable[[Any, str], list[Any]], name: str
    ) -> list[Any]:
        if given is None:
            return [None] * count
        both = zip(take(given[0], f"the predicted {name}"), take(given[1], f"the true {name}"))
        return [None if one is None or other is None else (one, other) for one, other in both]

    def parts(given: Any, name: str) -> list[Optional[_layouts.Array]]:
        return _layouts.parts(given, images, name)

    def named(given: Mapping[str, Mask]) -> list[dict[str, _layouts.Array]]:
        found = {name: parts(masks, f"mask {name}") for name, masks in given.items()}
        return [
            {name: mask for name, masks in found.items() if (mask := masks[at]) is not None}
            for at in range(count)
        ]

    rows = zip(
        images.arrays,
        like(truth, "truth"),
        parts(mask, "the mask"),
        named(classes),
        named(objects),
        pairs(depth, parts, "depth"),
        pairs(previous, like, "image before"),
        parts(ignored, "the mask of what is ignored"),
    )
    outcomes = []
    for at, row in enumerate(rows):
        try:
            outcomes.append(_of_image(ids, *row))
        except InputError as error:
            raise InputError(f"image {at}: {error}" if images.is_batch else str(error)) from None
    return outcomes, images.is_batch


def _numbers(outcomes: list[list[Outcome]], at: int) -> F64:
    values = (row[at] for row in outcomes)
    return np.array([np.nan if isinstance(value, str) else value for value in values])


def _of_image(
    ids: list[str],
    prediction: _layouts.Array,
    truth: _layouts.Array,
    mask: Optional[_layouts.Array],
    classes: dict[str, _layouts.Array],
    objects: dict[str, _layouts.Array],
    depth: Optional[tuple[_layouts.Array, _layouts.Array]],
    previous: Optional[tuple[_layouts.Array, _layouts.Array]],
    ignored: Optional[_layouts.Array],
) -> list[Outcome]:
    predicted, size = _arrays.image_bytes(prediction, "prediction")
    true = _arrays.image_bytes(truth, "truth")[0]
    before = None
    if previous is not None:
        before = (
            _arrays.image_bytes(previous[0], "the predicted image before")[0],
            _arrays.image_bytes(previous[1], "the true image before")[0],
        )
    distances = None
    if depth is not None:
        distances = (
            _arrays.distance_bytes(depth[0], size, "the predicted depth"),
            _arrays.distance_bytes(depth[1], size, "the true depth"),
        )

    def marks(given: Optional[_layouts.Array], name: str) -> Optional[bytes]:
        return None if given is None else _arrays.mask_bytes(given, size, name)

    def masks(given: Mapping[str, _layouts.Array]) -> dict[str, bytes]:
        return {name: _arrays.mask_bytes(m, size, f"mask {name}") for name, m in given.items()}

    return _native.compute(
        ids,
        size,
        predicted,
        true,
        {
            "ignored": marks(ignored, "the mask of what is ignored"),
            "dynamic": marks(mask, "the mask"),
            "classes": masks(classes),
            "objects": masks(objects),
            "depth": distances,
            "previous": before,
        },
    )


def _walk() -> dict[str, Metric]:
    found = {}
    for about in _native.metrics():
        low, high = about["range"]
        found[about["id"]] = Metric(
            id=about["id"],
            title=about["title"],
            unit=about["unit"],
            direction=about["direction"],
            range=(low, high),
            source=about["source"],
            needs=tuple((kind, name) for kind, name in about["needs"]),
        )
    return found


#: All metrics by id, in their order.
METRICS: Mapping[str, Metric] = MappingProxyType(_walk())


def __getattr__(name: str) -> Metric:
    metric = METRICS.get(name.replace("_", "-"))
    if metric is None:
        raise AttributeError(f"module {__name__} has no metric {name}")
    return metric


def __dir__() -> list[str]:
    return sorted(list(globals()) + [id.replace("-", "_") for id in METRICS])
