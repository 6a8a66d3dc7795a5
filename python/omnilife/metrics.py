"""Every metric that omnilife scores by, of arrays.

    from omnilife.metrics import psnr, ws_psnr, lpips_alex
    psnr(prediction, truth)

A metric is the attribute of its id with `_` for `-`, and an entry of `METRICS`. They are walked from
the program's own list, so that a metric that is added there is here. Their numbers are those of
`omnilife bench score`, which compares 8-bit images: values in [0, 1] are rounded to bytes first, as it
rounds predictions that come as .npy.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Optional, Union

import numpy as np
import numpy.typing as npt

from . import _arrays, _native
from ._arrays import Size
from .errors import InputError, UndefinedScore

Image = npt.ArrayLike
Mask = npt.ArrayLike


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
        mask: Optional[Union[Mask, Mapping[str, Mask]]] = None,
        depth: Optional[tuple[npt.ArrayLike, npt.ArrayLike]] = None,
        previous: Optional[tuple[Image, Image]] = None,
        ignored: Optional[Mask] = None,
    ) -> float:
        """Compares two images (height, width, 3), in uint8 or as floats in [0, 1].

        `mask` (height, width) marks, as the metric needs it, what moves or the objects of its class; of
        metrics of single objects it is one mask or a dictionary of masks by name. `depth` are
        predicted and true distances (height, width) along the rays, 0 for unknown, `previous` is the
        pair of images before this one in time. Pixels that `ignored` (height, width) marks do not count,
        as those of a scene's `Frame.ignored`. Metrics that need a ("sphere", "") take the images for
        panoramas, whatever they show.

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
        outcome = _outcomes(
            [self.id],
            prediction,
            truth,
            mask=single if is_masked else None,
            classes={of_class: single} if of_class is not None and single is not None else {},
            objects=masks,
            depth=depth,
            previous=previous,
            ignored=ignored,
        )[0]
        if isinstance(outcome, str):
            raise UndefinedScore(f"{self.id} is undefined: {outcome}")
        return outcome


def compute(
    prediction: Image,
    truth: Image,
    metrics: Iterable[str],
    *,
    mask: Optional[Mask] = None,
    classes: Optional[Mapping[str, Mask]] = None,
    objects: Optional[Mapping[str, Mask]] = None,
    depth: Optional[tuple[npt.ArrayLike, npt.ArrayLike]] = None,
    previous: Optional[tuple[Image, Image]] = None,
    ignored: Optional[Mask] = None,
) -> dict[str, Optional[float]]:
    """Several metrics by id, None where one is undefined; what they share is computed once.

    `mask` marks what moves, `classes` and `objects` hold the masks of classes and of single objects,
    `ignored` marks the pixels that do not count.
    """
    ids = list(metrics)
    outcomes = _outcomes(
        ids,
        prediction,
        truth,
        mask=mask,
        classes=classes or {},
        objects=objects or {},
        depth=depth,
        previous=previous,
        ignored=ignored,
    )
    return {
        id: None if isinstance(outcome, str) else outcome for id, outcome in zip(ids, outcomes)
    }


def _outcomes(
    ids: list[str],
    prediction: Image,
    truth: Image,
    *,
    mask: Optional[Mask],
    classes: Mapping[str, Mask],
    objects: Mapping[str, Mask],
    depth: Optional[tuple[npt.ArrayLike, npt.ArrayLike]],
    previous: Optional[tuple[Image, Image]],
    ignored: Optional[Mask],
) -> list[Union[float, str]]:
    predicted, size = _arrays.image_bytes(prediction, "prediction")
    true = _of_size(truth, size, "truth")
    before = None
    if previous is not None:
        names = ("the prediction before", "the truth before")
        before = (_of_size(previous[0], size, names[0]), _of_size(previous[1], size, names[1]))
    distances = None
    if depth is not None:
        distances = (
            _arrays.distance_bytes(depth[0], size, "the predicted depth"),
            _arrays.distance_bytes(depth[1], size, "the true depth"),
        )

    def marks(given: Optional[Mask], name: str) -> Optional[bytes]:
        return None if given is None else _arrays.mask_bytes(given, size, name)

    def masks(given: Mapping[str, Mask]) -> dict[str, bytes]:
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


def _of_size(image: Image, size: Size, name: str) -> bytes:
    found, own = _arrays.image_bytes(image, name)
    if own != size:
        (width, height), shape = size, np.shape(image)
        raise InputError(f"{name} is of shape {shape}, the prediction of {(height, width, 3)}")
    return found


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
