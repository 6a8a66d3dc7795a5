"""Between NumPy's arrays and the bytes that the compiled half takes and gives."""

from __future__ import annotations

import os
from typing import Any, Union

import numpy as np
import numpy.typing as npt

from . import _native
from .errors import InputError

Path = Union[str, "os.PathLike[str]"]
U8 = npt.NDArray[np.uint8]
F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]
#: Width and height in pixels.
Size = tuple[int, int]


def image_bytes(array: npt.NDArray[Any], name: str) -> tuple[bytes, Size]:
    """The bytes that are scored of an image (height, width, 3), and its size.

    uint8 is taken as it is, floating point must be in [0, 1] and is rounded as `bench score` rounds
    predictions that come as .npy.
    """
    height, width, _ = array.shape
    if array.dtype == np.uint8:
        return array.tobytes(), (width, height)
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"{name} is of {array.dtype}, expected uint8, or floats in [0, 1]")
    values = array.astype(np.float64).tobytes()
    try:
        return _native.scored_bytes(values, (height, width, 3)), (width, height)
    except InputError as error:
        raise InputError(str(error).replace("the image", name, 1)) from None


def mask_bytes(mask: npt.ArrayLike, size: Size, name: str) -> bytes:
    """One byte per pixel of a mask (height, width): bools, or uint8 of which above 127 is inside."""
    array = np.asarray(mask)
    _check_shape(array, size, name)
    if array.dtype == np.bool_:
        return array.tobytes()
    if array.dtype != np.uint8:
        raise InputError(f"{name} is of {array.dtype}, expected bool or uint8")
    inside = array > 127
    if array.any() and not inside.any():
        raise InputError(f"{name} holds nothing above {array.max()}, expected bools, or 0 and 255")
    return inside.tobytes()


def distance_bytes(distances: npt.ArrayLike, size: Size, name: str) -> bytes:
    """Distances (height, width) along the rays as f32."""
    array = np.asarray(distances)
    _check_shape(array, size, name)
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(f"{name} is of {array.dtype}, expected floats")
    return array.astype(np.float32).tobytes()


def rows(values: npt.ArrayLike, columns: int, name: str) -> F64:
    """Rows of `columns` numbers, (..., columns) in f64."""
    array: Any = np.asarray(values, dtype=np.float64)
    if array.ndim == 0 or array.shape[-1] != columns:
        raise InputError(f"{name} is of shape {array.shape}, expected (..., {columns})")
    return np.ascontiguousarray(array)


def path(place: Path) -> str:
    """A path as text, with `~` for the home folder."""
    return os.path.expanduser(os.fspath(place))


def _check_shape(array: npt.NDArray[Any], size: Size, name: str) -> None:
    width, height = size
    if array.shape != (height, width):
        raise InputError(f"{name} is of shape {array.shape}, expected {(height, width)}")
