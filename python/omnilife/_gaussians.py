"""Gaussians of a run: those of its model, and those of its latest checkpoint while it learns.

The files are `gaussians.ply` and `gaussians-moving.ply` (properties of 3DGS) and `checkpoint.bin`, whose layout is
that of reconstruct/training/src/train/checkpoint.rs and reconstruct/engine/src/model/saved.rs.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from ._arrays import F32, F64, U8
from .errors import InputError

#: Files of a model with centres in the world: static or canonical Gaussians, and those with times of their own.
MODEL_FILES = ("gaussians.ply", "gaussians-moving.ply")
#: Gaussians in the coordinates of objects.
OBJECT_FILE = "gaussians-objects.ply"
CHECKPOINT_FILE = "checkpoint.bin"

_MAGIC = b"omnilife/checkpoint/3"
#: Value of the constant spherical harmonic.
_CONSTANT = 0.28209479177387814
_TYPES = {"float": "<f4", "double": "<f8"}
#: Coefficients beyond the constant one, of degrees 1 to 3.
_REST = (3, 8, 15)


@dataclass(frozen=True)
class Gaussians:
    """Gaussians in world units."""

    centres: F64
    #: Standard deviations along the axes, (n, 3).
    scales: F32
    #: Rotations as unit quaternions (x, y, z, w).
    quaternions: F32
    #: Colour without direction and opacity, (n, 4), 8 bits.
    colours: U8
    #: Harmonics of degrees 1 to 3, (n, 15, 3), zero beyond the model's degree; None at degree 0.
    harmonics: Optional[F32]

    def __len__(self) -> int:
        return len(self.centres)

    def spread(self, most: int) -> Gaussians:
        """At most `most` of them, evenly spread over their order."""
        if len(self) <= most:
            return self
        chosen = np.arange(most) * len(self) // most
        harmonics = None if self.harmonics is None else self.harmonics[chosen]
        scales, quaternions = self.scales[chosen], self.quaternions[chosen]
        return Gaussians(self.centres[chosen], scales, quaternions, self.colours[chosen], harmonics)


@dataclass(frozen=True)
class Checkpoint:
    """A training at its latest checkpoint."""

    iteration: int
    #: Wall-clock time of planning and steps.
    wall_seconds: float
    gaussians: Gaussians
    #: Parts that are left out, with the reason.
    left_out: list[str]


def of_arrays(arrays: dict[str, Any]) -> Gaussians:
    """Gaussians of the arrays that training has; rows are Gaussians, positions are in world units."""
    count = len(arrays["positions"])
    quaternions = np.asarray(arrays["quaternions"], dtype=np.float32)
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    quaternions = (quaternions / np.maximum(lengths, 1e-12))[:, [1, 2, 3, 0]]
    colours = np.empty((count, 4), dtype=np.uint8)
    colours[:, :3] = _bytes(0.5 + _CONSTANT * arrays["sh_constant"])
    colours[:, 3] = _bytes(1.0 / (1.0 + np.exp(-np.clip(arrays["opacity_logits"][:, 0], -60.0, 60.0))))
    harmonics = None
    rest = arrays.get("sh_rest")
    if rest is not None:
        harmonics = np.zeros((count, _REST[-1], 3), dtype=np.float32)
        harmonics[:, : rest.shape[1]] = rest
    scales = np.exp(arrays["log_scales"]).astype(np.float32)
    return Gaussians(arrays["positions"], scales, quaternions, colours, harmonics)


def read_ply(path: Path) -> Gaussians:
    """Reads the Gaussians of a model's file."""
    data = _read(path)
    table = _table(path, data)
    names = table.dtype.names or ()

    def columns(*wanted: str) -> F64:
        missing = [name for name in wanted if name not in names]
        if missing:
            raise InputError(f"{path}: has no property {missing[0]}")
        return np.stack([table[name].astype(np.float64) for name in wanted], axis=1)

    count = sum(name.startswith("f_rest_") for name in names)
    arrays: dict[str, Any] = {
        "positions": columns("x", "y", "z"),
        "log_scales": columns("scale_0", "scale_1", "scale_2"),
        "quaternions": columns("rot_0", "rot_1", "rot_2", "rot_3"),
        "opacity_logits": columns("opacity"),
        "sh_constant": columns("f_dc_0", "f_dc_1", "f_dc_2"),
    }
    if count:
        if count // 3 not in _REST or count % 3:
            raise InputError(f"{path}: has {count} properties f_rest, expected 0, 9, 24 or 45")
        rest = columns(*(f"f_rest_{at}" for at in range(count)))
        arrays["sh_rest"] = rest.reshape(-1, 3, count // 3).transpose(0, 2, 1)
    _check_finite(path, arrays)
    return of_arrays(arrays)


def read_checkpoint(path: Path) -> Checkpoint:
    """Reads the Gaussians of a checkpoint; parts without centres in the world are left out."""
    first, _, rest = _read(path).partition(b"\n")
    if first != _MAGIC:
        raise InputError(f"{path}: begins with {first[:40]!r}, expected {_MAGIC!r}")
    text, _, body = rest.partition(b"\n")
    try:
        header = json.loads(text)
        state, learner = header["state"], json.loads(header["learner"])
        iteration, training = state["iteration"], state["training"]
        seconds = training["secs"] + training["nanos"] * 1e-9
        digest, normalization = header["body_sha256"], header.get("normalization")
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: its header is not readable: {error!r}") from error
    if hashlib.sha256(body).hexdigest() != digest:
        raise InputError(f"{path}: is truncated or damaged: its content is not what was written")
    left_out: list[str] = []
    found: list[dict[str, Any]] = []
    model = learner.get("model") if isinstance(learner, dict) else None
    if not isinstance(model, dict) or "parts" not in model:
        left_out.append("the model is not made of Gaussians")
    elif normalization is None:
        left_out.append("the checkpoint does not have the scene's normalization")
    else:
        try:
            found = _parts(model["parts"], np.frombuffer(body, dtype="<f4"), left_out)
            found = [_in_world(arrays, normalization) for arrays in found]
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise InputError(f"{path}: its parts are not those of a model: {error!r}") from error
    for arrays in found:
        _check_finite(path, arrays)
    return Checkpoint(iteration, seconds, joined([of_arrays(arrays) for arrays in found]), left_out)


def joined(parts: list[Gaussians]) -> Gaussians:
    """The Gaussians of several parts, one after the other."""
    if len(parts) == 1:
        return parts[0]

    def stack(width: int, kind: npt.DTypeLike, arrays: list[Any]) -> Any:
        return np.concatenate([np.zeros((0, width), dtype=kind), *arrays])

    harmonics = None
    if any(part.harmonics is not None for part in parts):
        zeros = (np.zeros((len(part), _REST[-1], 3), dtype=np.float32) for part in parts)
        given = (part.harmonics for part in parts)
        harmonics = np.concatenate(
            [zero if part is None else part for zero, part in zip(zeros, given)]
        )
    return Gaussians(
        stack(3, np.float64, [part.centres for part in parts]),
        stack(3, np.float32, [part.scales for part in parts]),
        stack(4, np.float32, [part.quaternions for part in parts]),
        stack(4, np.uint8, [part.colours for part in parts]),
        harmonics,
    )


def _parts(parts: list[dict[str, Any]], words: F32, left_out: list[str]) -> list[dict[str, Any]]:
    """The arrays of a model's parts in normalized units; `words` is the checkpoint's body."""
    at = 0
    found = []
    for part in parts:
        count = int(part["gaussians"])
        arrays: dict[str, Any] = {}
        for array in part["arrays"]:
            width = int(array["width"])
            values = words[at : at + count * width].reshape(count, width)
            arrays[array["name"]] = values.astype(np.float64)
            # Values, then two moments unless the array is not trained.
            at += count * width * (1 if array.get("frozen") else 3)
        # A sum and a number of views per Gaussian, and a time gradient.
        at += count * (3 if part["with_times"] else 2)
        at += 3 * int((part["shared"] or {"values": 0})["values"])
        kind = part["parameterization"]
        if "positions" not in arrays:
            left_out.append(f"{count} Gaussians of the kind {kind} rest in coordinates of their own")
            continue
        if "sh_rest" in arrays:
            rest = arrays["sh_rest"]
            if rest.shape[1] // 3 not in _REST or rest.shape[1] % 3:
                raise ValueError(f"sh_rest is {rest.shape[1]} wide")
            arrays["sh_rest"] = rest.reshape(count, -1, 3)
        found.append(arrays)
    return found


def _in_world(arrays: dict[str, Any], normalization: dict[str, Any]) -> dict[str, Any]:
    scale, offset = float(normalization["scale"]), np.array(normalization["offset"], dtype=np.float64)
    if not scale > 0.0 or offset.shape != (3,):
        raise ValueError("the normalization must have a positive scale and three offsets")
    positions = arrays["positions"] / scale + offset
    return {**arrays, "positions": positions, "log_scales": arrays["log_scales"] - np.log(scale)}


def _table(path: Path, data: bytes) -> npt.NDArray[Any]:
    """The vertices of a binary PLY of floats and doubles."""
    head, end, body = data.partition(b"end_header\n")
    lines = head.decode("ascii", "replace").splitlines()
    if not end or lines[:2] != ["ply", "format binary_little_endian 1.0"]:
        raise InputError(f"{path}: must be a PLY in binary_little_endian 1.0 with a header that ends")
    fields: list[tuple[str, str]] = []
    count: Optional[int] = None
    for line in lines[2:]:
        words = line.split()
        if words[:2] == ["element", "vertex"] and len(words) == 3 and words[2].isdigit() and count is None:
            count = int(words[2])
        elif words[:1] == ["property"] and len(words) == 3 and words[1] in _TYPES and count is not None:
            fields.append((words[2], _TYPES[words[1]]))
        elif words[:1] != ["comment"]:
            raise InputError(f"{path}: a vertex with float and double properties was expected, got {line!r}")
    try:
        kind = np.dtype(fields)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error
    if count is None or len(body) != count * kind.itemsize:
        expected = (count or 0) * kind.itemsize
        raise InputError(f"{path}: has {len(body)} bytes of Gaussians, expected {expected}")
    return np.frombuffer(body, dtype=kind)


def _check_finite(path: Path, arrays: dict[str, Any]) -> None:
    for name, array in arrays.items():
        # An opacity of 0 or 1 has an infinite logit.
        bad = np.isnan(array) if name == "opacity_logits" else ~np.isfinite(array)
        if bad.any():
            raise InputError(f"{path}: {name} holds {int(bad.sum())} values that are not finite")


def _bytes(values: Any) -> U8:
    found: U8 = np.rint(255.0 * np.clip(values, 0.0, 1.0)).astype(np.uint8)
    return found


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
