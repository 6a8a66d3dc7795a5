"""Scenes and splits: which frames there are, where their cameras were, and who is given which."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any, Optional

import numpy as np

from . import _arrays, _html, _native
from ._arrays import F32, F64, U8, Bool, Size
from .camera import Camera, Pose
from .errors import InputError, OmnilifeError


@dataclass(frozen=True)
class Distances:
    """A file of distances: 16-bit grey PNG or .npy of float32."""

    path: Path
    #: What a step of 1 in the file means, in units of the world frame.
    unit: float
    #: `ray`, or `z` for distances along the viewing direction.
    convention: str
    #: Who estimated them; nothing for true ones.
    source: Optional[str]

    def read(self, size: Optional[Size] = None) -> F32:
        """Distances (height, width) in units of the world frame; 0 where they are not known.

        At another size (width, height), every pixel is that of the nearest one.
        """
        data, (width, height) = _native.read_distances(str(self.path), self.unit, size)
        return np.frombuffer(data, dtype=np.float32).reshape(height, width)


@dataclass(frozen=True)
class Frame:
    """One frame of a scene. Its files are read when they are asked for."""

    #: Its place in the scene, from 0: the number in splits, predictions and scores.
    index: int
    #: Presentation timestamp in the source, seconds.
    time_seconds: float
    camera: Camera
    #: None where it is not known; such frames are neither trained on nor scored.
    pose: Optional[Pose]
    image_path: Path
    #: What moves.
    mask_path: Optional[Path]
    #: Ignored regions: nothing is learned from it, and no score counts it.
    ignore_mask_path: Optional[Path]
    #: Masks by the name of a class, such as `human` and `vehicle`.
    class_paths: dict[str, Path]
    #: Masks by the name of an object; none where it is not seen.
    object_paths: dict[str, Path]
    #: True distances along the rays.
    depth: Optional[Distances]
    #: Distances that somebody estimated. A method may use them, no score does.
    depth_prior: Optional[Distances]

    def image(self, size: Optional[Size] = None) -> U8:
        """The image (height, width, 3) as decoded, in sRGB.

        At another size (width, height), by area averaging and rounded to 8 bits, as scoring does.
        """
        data, (width, height) = _native.read_image(str(self.image_path), self.camera.size, size)
        return np.frombuffer(data, dtype=np.uint8).reshape(height, width, 3)

    def mask(self, size: Optional[Size] = None) -> Optional[Bool]:
        """What moves, (height, width); None without a mask. At another size, of the nearest pixels."""
        return None if self.mask_path is None else self._mask(self.mask_path, size)

    def ignored(self, size: Optional[Size] = None) -> Optional[Bool]:
        """Ignored regions, (height, width); None without any.

        At another size, every pixel over which a marked one lies, as scoring does.
        """
        if self.ignore_mask_path is None:
            return None
        return self._mask(self.ignore_mask_path, size, touched=True)

    def classes(self, size: Optional[Size] = None) -> dict[str, Bool]:
        """Masks of the objects of a class, by its name."""
        return {name: self._mask(path, size) for name, path in self.class_paths.items()}

    def objects(self, size: Optional[Size] = None) -> dict[str, Bool]:
        """Masks of single objects, by their names."""
        return {name: self._mask(path, size) for name, path in self.object_paths.items()}

    def rays(self, size: Optional[Size] = None) -> tuple[F64, F64]:
        """The camera centre (3) and unit directions (height, width, 3) through the centres of all
        pixels, on the world's axes; of images of another size (width, height) where it is given.

        `frame.camera.rays()` has them on the camera's axes.
        """
        if self.pose is None:
            raise InputError(f"{self.image_path}: the frame has no pose")
        camera = self.camera if size is None else self.camera.resized(*size)
        return self.pose.centre, camera.rays(self.pose.rotation)

    def _repr_html_(self) -> str:
        pose = self.pose
        rows = {
            "time": f"{self.time_seconds:.6g} s",
            "file": self.image_path,
            "centre": "not known" if pose is None else np.array2string(pose.centre, precision=4),
            "dynamic mask": self.mask_path,
            "ignore mask": self.ignore_mask_path,
            "classes": ", ".join(self.class_paths) or None,
            "objects": ", ".join(self.object_paths) or None,
            "distances": None if self.depth is None else self.depth.path,
        }
        return _html.facts(f"Frame {self.index}", rows, self._thumbnail())

    def _thumbnail(self) -> str:
        width, height = self.camera.size
        shrink = max(1.0, width / _html.THUMBNAIL_WIDTH)
        try:
            pixels = self.image((round(width / shrink), max(1, round(height / shrink))))
        except OmnilifeError as error:
            return f"<p>{escape(str(error))}</p>"
        return _html.image(pixels)

    def _mask(self, path: Path, size: Optional[Size], touched: bool = False) -> Bool:
        data, (width, height) = _native.read_mask(str(path), self.camera.size, size, touched)
        return np.frombuffer(data, dtype=np.uint8).reshape(height, width) > 0


@dataclass(frozen=True)
class Scene:
    """A scene; `load_scene` reads one."""

    #: The scene.json.
    path: Path
    #: Id of the sequence.
    id: str
    camera: Camera
    #: `metres`, or `arbitrary`.
    scale: str
    #: In order of time.
    frames: list[Frame]
    #: PLY file of points in world units.
    points_path: Optional[Path]
    #: The whole scene.json, with where the poses come from and whether they can be trusted.
    record: dict[str, Any] = field(repr=False)

    def points(self) -> tuple[F64, U8]:
        """Positions (n, 3) in world units and colours (n, 3) of the points; none without a file."""
        data = (
            (b"", b"") if self.points_path is None else _native.read_points(str(self.points_path))
        )
        positions = np.frombuffer(data[0], dtype=np.float64).reshape(-1, 3)
        return positions, np.frombuffer(data[1], dtype=np.uint8).reshape(-1, 3)

    def _repr_html_(self) -> str:
        times = [frame.time_seconds for frame in self.frames]
        posed = sum(frame.pose is not None for frame in self.frames)
        rows = {
            "file": self.path,
            "camera": f"{self.camera.model}, {self.camera.width} x {self.camera.height}",
            "frames": f"{len(times)}, {posed} with a pose",
            "time": f"{min(times):.6g} to {max(times):.6g} s" if times else None,
            "world units": self.scale,
            "points": self.points_path,
        }
        middle = self.frames[len(times) // 2]._thumbnail() if times else ""
        return _html.facts(f"Scene {self.id}", rows, middle)


@dataclass(frozen=True)
class Split:
    """The frames of a scene under a protocol; `load_split` reads one."""

    #: The split.json.
    path: Path
    #: Id of the scene.
    scene: str
    #: Id and version of the protocol, `per-scene/2`.
    protocol: str
    #: Scores of different hashes are never compared.
    protocol_hash: str
    #: Frames that a method may use.
    input_views: list[int]
    #: Frames that it must predict.
    novel_views: list[int]
    #: The whole split.json.
    record: dict[str, Any] = field(repr=False)

    def scored_size(self, scene: Scene) -> Size:
        """Width and height in pixels of the images that are scored."""
        protocol = json.dumps(self.record["protocol"])
        width, height = _native.scored_size(scene.camera._json(), protocol)
        return width, height

    def _repr_html_(self) -> str:
        rows = {
            "file": self.path,
            "scene": self.scene,
            "hash": self.protocol_hash,
            "input views": len(self.input_views),
            "novel views": len(self.novel_views),
        }
        return _html.facts(f"Split {self.protocol}", rows)


def load_scene(path: _arrays.Path) -> Scene:
    """Reads a scene.json, or that of a folder."""
    file = _file_in(path, "scene.json")
    record = json.loads(_native.read_record("scene", str(file)))
    camera = Camera._of_record(record["camera"])
    frames = [
        _frame(file.parent, camera, index, entry) for index, entry in enumerate(record["frames"])
    ]
    points = _beside(file.parent, record["points"])
    return Scene(file, record["id"], camera, record["scale"], frames, points, record)


def load_split(path: _arrays.Path) -> Split:
    """Reads a split.json, or that of a folder."""
    file = _file_in(path, "split.json")
    record = json.loads(_native.read_record("split", str(file)))
    protocol = record["protocol"]
    return Split(
        path=file,
        scene=record["scene"],
        protocol=f"{protocol['id']}/{protocol['version']}",
        protocol_hash=record["protocol_hash"],
        input_views=record["input_views"],
        novel_views=record["novel_views"],
        record=record,
    )


def split_scene(scene: _arrays.Path, out: _arrays.Path, protocol: str = "per-scene") -> Split:
    """Splits a scene under a protocol, writes the split to the file `out` and reads it.

    `omnilife.protocols()` has the ids. As `omnilife bench split`.
    """
    _native.split_scene(str(_file_in(scene, "scene.json")), protocol, _arrays.path(out))
    return load_split(out)


def protocols() -> dict[str, str]:
    """Ids of the protocols with what they measure."""
    return dict(_native.protocols())


def _frame(folder: Path, camera: Camera, index: int, entry: dict[str, Any]) -> Frame:
    def distances(record: Optional[dict[str, Any]]) -> Optional[Distances]:
        if record is None:
            return None
        convention, source = record.get("convention", "ray"), record.get("source")
        return Distances(folder / record["file"], record["unit"], convention, source)

    def masks(kind: str) -> dict[str, Path]:
        return {name: folder / file for name, file in entry.get(kind, {}).items()}

    pose = entry["pose"]
    return Frame(
        index=index,
        time_seconds=entry["time_seconds"],
        camera=camera,
        pose=None if pose is None else Pose._of_record(pose),
        image_path=folder / entry["image"],
        mask_path=_beside(folder, entry["mask"]),
        ignore_mask_path=_beside(folder, entry.get("ignore_mask")),
        class_paths=masks("classes"),
        object_paths=masks("objects"),
        depth=distances(entry.get("depth")),
        depth_prior=distances(entry.get("depth_prior")),
    )


def _beside(folder: Path, name: Optional[str]) -> Optional[Path]:
    return None if name is None else folder / name


def _file_in(path: _arrays.Path, name: str) -> Path:
    place = Path(_arrays.path(path))
    return place / name if os.path.isdir(place) else place
