"""What a recording of a run holds: the scene, rows of the trace, views with their errors, and Gaussians."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Optional

import numpy as np

from . import _gaussians, _native
from ._arrays import F64, U8
from ._gaussians import Gaussians
from .errors import InputError, UndefinedScore
from .jobs import load_run
from .metrics import METRICS
from .results import _read_csv
from .scene import Frame, Scene, Split
from .tables import Table

#: Rounding of coordinates that is not seen, in units of the radius of a scene's cameras.
_UNSEEN_ROUNDING = 1e-5
#: Difference of 8-bit values at the end of the colours of errors.
_LARGE_ERROR = 64.0
#: Points of a path that is drawn.
_PATH_POINTS = 64

_INPUT_COLOUR, _NOVEL_COLOUR, _PATH_COLOUR = (60, 130, 220), (240, 150, 40), (150, 150, 150)
#: Columns of the curve that scoring makes which are times, not scores.
_TIMES = ("wall_seconds", "cpu_seconds", "evaluation_seconds", "iteration")


class Recording:
    """A recording of one run under way."""

    def __init__(
        self,
        sdk: Any,
        stream: Any,
        scene: Scene,
        split: Split,
        folder: Path,
        views: int,
        max_gaussians: int,
    ) -> None:
        self._sdk, self._stream = sdk, stream
        self._scene, self._split, self._folder = scene, split, folder
        self._views, self._max_gaussians = views, max_gaussians
        #: Lines on what is not shown.
        self.notes: list[str] = []
        posed = [frame for frame in scene.frames if frame.pose is not None]
        if not posed:
            raise InputError(f"{scene.path}: must have frames with poses, got none")
        centres = np.array([_centre(frame) for frame in posed])
        self._radius = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()) or 1.0
        self._origin = self._origin_of(centres)
        #: Rows of the trace that are logged: iteration and time.
        self._rows: set[tuple[int, float]] = set()
        self._checkpoint: Optional[tuple[int, int]] = None
        self._truths: set[int] = set()

    def _origin_of(self, centres: F64) -> F64:
        """The world's origin, moved to the cameras where 32-bit coordinates would be too coarse."""
        mean = centres.mean(axis=0)
        if np.finfo(np.float32).eps * np.linalg.norm(mean) <= _UNSEEN_ROUNDING * self._radius:
            return np.zeros(3)
        origin: F64 = np.rint(mean)
        self.notes.append(f"coordinates are relative to {origin.tolist()}: the viewer's have 32 bits")
        return origin

    def layout(self) -> Any:
        """The views that the viewer opens with."""
        views = self._sdk.blueprint
        return views.Blueprint(
            views.Horizontal(
                views.Spatial3DView(origin="world", name="scene"),
                views.Vertical(
                    views.Grid(
                        views.Spatial2DView(origin="views/novel", contents="views/novel/*/rendered"),
                        views.Spatial2DView(origin="views/novel", contents="views/novel/*/error"),
                    ),
                    views.TimeSeriesView(origin="scores", name="scores"),
                    views.TimeSeriesView(origin="trace", contents="trace/train_loss", name="loss"),
                ),
            )
        )

    # The scene, which does not change.

    def log_scene(self) -> None:
        """Logs cameras, points and tracks."""
        sdk = self._sdk
        frames = self._scene.frames
        for kind, numbers, colour in (
            ("input", self._split.input_views, _INPUT_COLOUR),
            ("novel", self._split.novel_views, _NOVEL_COLOUR),
        ):
            if not all(0 <= number < len(frames) for number in numbers):
                raise InputError(f"{self._split.path}: has frames that are not in {self._scene.path}")
            chosen = [frames[number] for number in numbers if frames[number].pose is not None]
            if chosen:
                points = sdk.Points3D(
                    [self._near(_centre(frame)) for frame in chosen],
                    radii=0.01 * self._radius,
                    colors=[colour],
                    labels=[str(frame.index) for frame in chosen],
                    show_labels=False,
                )
                self._log(f"world/cameras/{kind}", points, static=True)
        path = [self._near(_centre(frame)) for frame in frames if frame.pose is not None]
        self._log("world/cameras/path", sdk.LineStrips3D([path], colors=[_PATH_COLOUR]), static=True)
        positions, colours = self._scene.points()
        if len(positions):
            points = sdk.Points3D(self._near(positions), colors=colours)
            self._log("world/points", points, static=True)
        self._log_tracks()

    def _log_tracks(self) -> None:
        file = self._split.path.parent / "tracks.json"
        if not file.is_file():
            return
        record = json.loads(_native.read_record("tracks", str(file)))
        if record["scene"] != self._scene.id:
            raise InputError(f"{file}: has tracks of {record['scene']}, the scene is {self._scene.id}")
        for track in record["tracks"]:
            path = self._near(spline_points(track["path"]["centre"], _PATH_POINTS))
            label = f"{track['class']} {track['id']}"
            strip = self._sdk.LineStrips3D([path], labels=[label], show_labels=False)
            self._log(f"world/tracks/{track['id']}", strip, static=True)

    def _log_camera(self, frame: Frame) -> None:
        assert frame.pose is not None
        sdk, camera = self._sdk, frame.camera
        place = f"world/shown/{frame.index:06}"
        pose = sdk.Transform3D(translation=self._near(_centre(frame)), mat3x3=frame.pose.rotation)
        if camera.model != "pinhole":
            self._log(place, pose, sdk.TransformAxes3D(0.1 * self._radius), static=True)
            return
        pinhole = sdk.Pinhole(
            image_from_camera=camera.K,
            resolution=list(camera.size),
            camera_xyz=sdk.ViewCoordinates.RDF,
            image_plane_distance=0.1 * self._radius,
        )
        self._log(place, pose, pinhole, static=True)

    # A run on its way.

    def has_ended(self) -> bool:
        """Whether the run's record is there, which is written last."""
        return (self._folder / "run.json").is_file()

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return self._folder

    def versions(self) -> list[Optional[tuple[int, int]]]:
        """Time and size of the trace and the checkpoint, `None` for one that is not there."""
        found: list[Optional[tuple[int, int]]] = []
        for name in ("trace.csv", "checkpoint.bin"):
            try:
                status = (self._folder / name).stat()
            except FileNotFoundError:
                found.append(None)
            else:
                found.append((status.st_mtime_ns, status.st_size))
        return found

    def log_news(self) -> None:
        """Logs rows of the trace and a checkpoint, as far as they are new."""
        trace = self._folder / "trace.csv"
        if trace.is_file():
            self._log_trace(_read_csv(trace), last=None)
        self._log_checkpoint()

    def log_run(self) -> None:
        """Logs a run that has ended: rows that are new, predictions and the model."""
        run = load_run(self._folder)
        if run.scene != self._scene.id:
            raise InputError(f"{run.path}: is a run on {run.scene}, the scene is {self._scene.id}")
        if run.record["trace"] is None:
            self._set_time(0, 0.0)
            self._log_views("novel", self._spread(self._split.novel_views), self._predictions(run.record))
            self.notes.append(f"{run.path}: the run left no trace")
            return
        trace = run.trace()
        # Without it, its iteration and time are those of the last row.
        self._log_trace(trace, last=self._predictions(run.record))
        given = run.record["predictions"]["input_views"]
        if given is not None:
            middle = self._split.input_views[len(self._split.input_views) // 2 :][:1]
            self._log_views("input", middle, self._folder / given)
        self._log_model()

    def _predictions(self, record: dict[str, Any]) -> Path:
        return self._folder / str(record["predictions"]["novel_views"])

    def _log_trace(self, trace: Table, last: Optional[Path]) -> None:
        """Logs new rows with the views of each; those of the last one are in the folder `last`."""
        columns = ("iteration", "wall_seconds")
        if any(name not in trace for name in columns):
            raise InputError(f"{self._folder / 'trace.csv'}: must have the columns {', '.join(columns)}")
        count = len(trace["iteration"])
        for at in range(count):
            row = (int(trace["iteration"][at]), float(trace["wall_seconds"][at]))
            is_last = last is not None and at == count - 1
            if row in self._rows and not is_last:
                continue
            self._rows.add(row)
            self._set_time(*row)
            for name, values in trace.items():
                if name not in columns and isinstance(values[at], (int, float)):
                    self._log(f"trace/{name}", self._sdk.Scalars(float(values[at])))
            kept = self._folder / "trace" / f"{row[0]:06}"
            if is_last and last is not None:
                self._log_views("novel", self._shown(), last)
            elif kept.is_dir():
                self._log_views("novel", self._spread(_frames_in(kept)), kept)

    def _shown(self) -> list[int]:
        """The novel views that rows before showed, so that the last row goes on with them."""
        shown = sorted(self._truths & set(self._split.novel_views))
        return shown or self._spread(self._split.novel_views)

    def _spread(self, frames: list[int]) -> list[int]:
        count = min(self._views, len(frames))
        return [frames[(2 * part + 1) * len(frames) // (2 * count)] for part in range(count)]

    def _log_views(self, kind: str, frames: list[int], folder: Path) -> None:
        for number in frames:
            file = folder / f"{number:06}.png"
            if number >= len(self._scene.frames) or not file.is_file():
                self._note_once(f"{file}: is not there or not of the scene: the view is not shown")
                continue
            frame = self._scene.frames[number]
            data, (width, height) = _native.read_image(str(file))
            rendered = np.frombuffer(data, dtype=np.uint8).reshape(height, width, 3)
            truth = frame.image((width, height))
            place = f"views/{kind}/{number:06}"
            if number not in self._truths:
                self._truths.add(number)
                self._log(f"{place}/truth", self._sdk.Image(truth), static=True)
                if frame.pose is not None:
                    self._log_camera(frame)
            encoded = self._sdk.EncodedImage(contents=file.read_bytes(), media_type="image/png")
            self._log(f"{place}/rendered", encoded)
            error = self._sdk.DepthImage(
                error_image(rendered, truth), meter=1.0, colormap="turbo", depth_range=[0.0, _LARGE_ERROR]
            )
            self._log(f"{place}/error", error)
            self._log_psnr(f"scores/psnr/{kind}-{number:06}", rendered, frame)

    def _log_psnr(self, place: str, rendered: U8, frame: Frame) -> None:
        size = (rendered.shape[1], rendered.shape[0])
        try:
            psnr = METRICS["psnr"](rendered, frame.image(size), layout="HWC", ignored=frame.ignored(size))
        except UndefinedScore as error:
            self._note_once(f"frame {frame.index}: {error}")
            return
        self._log(place, self._sdk.Scalars(psnr))

    def log_curve(self, curve: Table) -> None:
        """Logs the curve that scoring made of the run's trace."""
        if "iteration" not in curve or "wall_seconds" not in curve:
            raise InputError("the curve of the scores must have the columns iteration and wall_seconds")
        for at, iteration in enumerate(curve["iteration"]):
            self._set_time(int(iteration), float(curve["wall_seconds"][at]))
            for name, values in curve.items():
                if name not in _TIMES and isinstance(values[at], (int, float)):
                    self._log(f"scores/curve/{name}", self._sdk.Scalars(float(values[at])))

    # Gaussians.

    def _log_checkpoint(self) -> None:
        file = self._folder / _gaussians.CHECKPOINT_FILE
        try:
            state = file.stat()
            stamp = (state.st_mtime_ns, state.st_size)
            if stamp == self._checkpoint:
                return
            found = _gaussians.read_checkpoint(file)
        except (FileNotFoundError, InputError):
            # It goes when the run ends.
            if not file.is_file():
                return
            raise
        self._checkpoint = stamp
        for reason in found.left_out:
            self._note_once(f"{file}: {reason}: not shown")
        self._set_time(found.iteration, found.wall_seconds)
        self._log_gaussians(found.gaussians, file)

    def _log_model(self) -> None:
        files = [self._folder / name for name in _gaussians.MODEL_FILES]
        parts = [_gaussians.read_ply(file) for file in files if file.is_file()]
        objects = self._folder / _gaussians.OBJECT_FILE
        if objects.is_file():
            self._note_once(f"{objects}: rest in coordinates of their objects: not shown")
        if not parts:
            self._note_once(f"{self._folder}: the model has no Gaussians in the world: none are shown")
            return
        self._log_gaussians(_gaussians.joined(parts), self._folder)

    def _log_gaussians(self, gaussians: Gaussians, source: Path) -> None:
        shown = gaussians.spread(self._max_gaussians)
        if len(shown) < len(gaussians):
            self._note_once(f"{source}: shows {len(shown)} of {len(gaussians)} Gaussians")
        if len(shown) == 0:
            return
        splats = self._sdk.GaussianSplats3D(
            self._near(shown.centres),
            scales=shown.scales,
            quaternions=shown.quaternions,
            colors=shown.colours,
            sh_coefficients=shown.harmonics,
        )
        self._log("world/gaussians", splats)

    # The stream.

    def _near(self, positions: F64) -> Any:
        return (np.asarray(positions, dtype=np.float64) - self._origin).astype(np.float32)

    def _set_time(self, iteration: int, wall_seconds: float) -> None:
        self._stream.set_time("iteration", sequence=iteration)
        self._stream.set_time("wall_time", duration=wall_seconds)

    def _log(self, place: str, *parts: Any, static: bool = False) -> None:
        self._stream.log(place, *parts, static=static)

    def _note_once(self, line: str) -> None:
        if line not in self.notes:
            self.notes.append(line)


def error_image(rendered: U8, truth: U8) -> U8:
    """The largest difference of the three channels of every pixel, (height, width), 0 to 255."""
    difference = np.abs(rendered.astype(np.int16) - truth.astype(np.int16))
    largest: U8 = difference.max(axis=2).astype(np.uint8)
    return largest


def spline_points(spline: dict[str, Any], count: int) -> F64:
    """`count` points (count, 3) of a clamped B-spline at equal steps of time, by de Boor's algorithm."""
    degree, knots = int(spline["degree"]), np.array(spline["knots"], dtype=np.float64)
    coefficients = np.array(spline["coefficients"], dtype=np.float64).reshape(-1, 3)
    points = np.empty((count, 3))
    for at, instant in enumerate(np.linspace(knots[degree], knots[len(coefficients)], count)):
        piece = int(np.searchsorted(knots, instant, side="right")) - 1
        piece = min(max(piece, degree), len(coefficients) - 1)
        values = coefficients[piece - degree : piece + 1].copy()
        for level in range(1, degree + 1):
            for index in range(degree, level - 1, -1):
                left = knots[piece - degree + index]
                width = knots[piece + 1 + index - level] - left
                weight = (instant - left) / width if width > 0 else 0.0
                values[index] = (1 - weight) * values[index - 1] + weight * values[index]
        points[at] = values[degree]
    return points


def _centre(frame: Frame) -> F64:
    assert frame.pose is not None
    return frame.pose.centre


def _frames_in(folder: Path) -> list[int]:
    return sorted(int(file.stem) for file in folder.glob("[0-9]*.png") if file.stem.isdigit())
