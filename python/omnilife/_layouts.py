"""Images and masks of any layout, single or in batches, from NumPy and PyTorch."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal, Optional

import numpy as np
import numpy.typing as npt

from .errors import InputError

Array = npt.NDArray[Any]
#: Order of the axes of an image: rows, columns and channels, or channels first.
Layout = Literal["HWC", "CHW"]


@dataclass(frozen=True)
class Images:
    """Images (height, width, 3) of one size."""

    arrays: list[Array]
    #: False for an image that was given alone.
    is_batch: bool

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of all of them, rows and columns before channels."""
        own: tuple[int, ...] = self.arrays[0].shape
        return (len(self.arrays), *own) if self.is_batch else own


def host(values: Any) -> Array:
    """Returns the NumPy array of an array or of a tensor on any device."""
    # PyTorch is never imported here: a tensor brings its own methods.
    if hasattr(values, "detach"):
        values = values.detach().cpu()
        # NumPy has no such type.
        if str(values.dtype) == "torch.bfloat16":
            values = values.float()
    return np.asarray(values)


def images(values: Any, name: str, layout: Optional[Layout]) -> Images:
    """Returns an image or a batch, (N, ...), without changing a value.

    Raises `InputError` where the axis of channels is neither told nor plain from the shape.
    """
    array = host(values)
    if array.ndim not in (3, 4) or 0 in array.shape:
        raise InputError(
            f"{name} is of shape {array.shape}, expected (height, width, 3), (3, height, width), "
            "or a batch (N, ...) of one of them"
        )
    if _layout(array.shape, name, layout) == "CHW":
        array = np.moveaxis(array, -3, -1)
    return Images(list(array) if array.ndim == 4 else [array], array.ndim == 4)


def parts(values: Any, of: Images, name: str) -> list[Optional[Array]]:
    """Returns a mask or distances (height, width) for every image, None for those without.

    An axis of one channel may be there. A batch takes (N, ...), a list, or one (height, width) for all.
    """
    count = len(of.arrays)
    if values is None:
        return [None] * count
    if not of.is_batch:
        return [_plane(values, of)]
    if not isinstance(values, (list, tuple)):
        values = host(values)
        if values.ndim == 2:
            return [values] * count
    if len(values) != count:
        raise InputError(f"{name} is for {len(values)} images, the batch has {count}")
    return [None if value is None else _plane(value, of) for value in values]


def _plane(values: Any, of: Images) -> Array:
    array = host(values)
    height, width, _ = of.arrays[0].shape
    has_channel = array.shape in ((1, height, width), (height, width, 1))
    return array.reshape(height, width) if has_channel else array


def _layout(shape: tuple[int, ...], name: str, layout: Optional[Layout]) -> Layout:
    fits: list[Layout] = []
    if shape[-1] == 3:
        fits.append("HWC")
    if shape[-3] == 3:
        fits.append("CHW")
    if layout not in (None, "HWC", "CHW"):
        raise InputError(f'layout is {layout!r}, expected "HWC" or "CHW"')
    if layout is None and len(fits) == 2:
        raise InputError(f'{name} of shape {shape} may be HWC or CHW: give layout="HWC" or "CHW"')
    if not fits or layout not in (None, *fits):
        said = "three channels" if layout is None else f"three channels as {layout} has them"
        raise InputError(f"{name} is of shape {shape}, expected {said}")
    return layout or fits[0]
