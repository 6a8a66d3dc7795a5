"""Long work: curation, poses and training, with progress.

The command that came with the package does it in a process of its own. Its FFmpeg, OpenCV and graphics libraries
stay out of Python's process.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any, Callable, Optional, Union

from . import _arrays, _html, _native
from .errors import InputError, MachineError
from .results import read_trace
from .scene import Scene, Split, _file_in, load_scene
from .tables import Table

_LOG = logging.getLogger("omnilife")
_PROGRAM = "omnilife.exe" if os.name == "nt" else "omnilife"


@dataclass(frozen=True)
class Progress:
    """A piece of work at its begin, on its way or at its end."""

    label: str
    #: Steps done.
    done: int
    #: All steps; None where their number is not known.
    total: Optional[int]
    #: The state in words, such as the number of primitives; may be empty.
    status: str
    #: Pieces of work around this one.
    depth: int
    has_ended: bool

    def __str__(self) -> str:
        count = f"{self.done} of {self.total}" if self.total else str(self.done or "")
        return f"{self.label}: " + ", ".join(filter(None, (count, self.status)))


#: Receives progress, five times a second at most.
Report = Callable[[Progress], None]


def show_progress(progress: Progress) -> None:
    """Shows progress on a line of standard error: `curate(..., progress=omnilife.show_progress)`."""
    end = "\n" if progress.has_ended else ""
    print(f"\r{str(progress):<99.99}", end=end, file=sys.stderr, flush=True)


@dataclass(frozen=True)
class Dataset:
    """A curated dataset; `load_dataset` reads one."""

    #: The dataset.json.
    path: Path
    #: Folders of the sequences, in the order of the videos and of time.
    sequences: list[Path]
    #: One row per video: `file`, `outcome`, `sequences` and `reason`.
    videos: Table = field(repr=False)
    #: The whole dataset.json.
    record: dict[str, Any] = field(repr=False)

    def _repr_html_(self) -> str:
        rows = {"file": self.path, "sequences": len(self.sequences)}
        return _html.facts(f"Dataset {self.path.parent.name}", rows, self.videos._repr_html_())


@dataclass(frozen=True)
class Run:
    """A method's run on a scene; `load_run` reads one."""

    #: The run.json.
    path: Path
    method: str
    #: Id of the scene.
    scene: str
    #: The whole run.json.
    record: dict[str, Any] = field(repr=False)

    def trace(self) -> Table:
        """Error against run time, one row per moment."""
        return read_trace(self.path.parent)

    def novel_views(self) -> dict[int, Path]:
        """Predicted images by frame."""
        folder = self.path.parent / self.record["predictions"]["novel_views"]
        return {int(file.stem): file for file in sorted(folder.glob("[0-9]*.png"))}

    def _repr_html_(self) -> str:
        rows = {
            "file": self.path,
            "iterations": self.record["iterations"],
            "primitives": self.record["primitives"],
            "training": f"{self.record['training_seconds']:.1f} s",
            "warnings": len(self.record["warnings"]) or None,
        }
        views = list(self.novel_views().values())
        image = _html.image_file(views[len(views) // 2]) if views else ""
        return _html.facts(f"{self.method} on {self.scene}", rows, image)


def command(*words: object, progress: Optional[Report] = None) -> str:
    """Runs the command `omnilife` with these words and returns its standard output.

    `progress` receives the work on its way; decisions go to the logger `omnilife`. A failure raises `InputError`
    or `MachineError` with the command's own line. Ctrl-C tells the command to end first: a training then goes
    on from its checkpoint when it is begun again.
    """
    line = [_program(), "--progress", "json", *map(_word, words)]
    with tempfile.TemporaryFile() as output:
        try:
            process = subprocess.Popen(
                line,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.PIPE,
                encoding="utf-8",
                errors="replace",
                # Ctrl-C reaches this process alone, which then tells the command once.
                start_new_session=True,
            )
        except OSError as error:
            raise MachineError(f"{line[0]}: cannot be started: {error.strerror}") from error
        assert process.stderr is not None
        said: list[str] = []
        try:
            with process.stderr as lines:
                for text in lines:
                    if not _reported(text, progress):
                        said.append(text.strip())
            code = process.wait()
        except BaseException:
            process.terminate()
            process.wait()
            raise
        if code != 0:
            message = _message(said) or f"omnilife {' '.join(line[3:5])} ended with {code}"
            raise InputError(message) if code == 2 else MachineError(message)
        output.seek(0)
        return output.read().decode("utf-8", "replace")


def curate(
    videos: Union[_arrays.Path, Iterable[_arrays.Path]],
    out: _arrays.Path,
    *,
    progress: Optional[Report] = None,
    **options: object,
) -> Dataset:
    """Cuts videos to sequences of sampled frames, as `omnilife curate build` does.

    Options are those of the command: `curate("walk.mp4", "DATASET", fps=2, criteria="none", slices=True)`. A
    video that gives no sequence for a reason in it is a row of `videos`; one that fails is an error after the
    others, and `load_dataset(out)` then has them.
    """
    given = (videos,) if isinstance(videos, (str, os.PathLike)) else tuple(videos)
    place = _arrays.path(out)
    words = ["curate", "build", *_options(options), f"--out={place}", "--"]
    command(*words, *map(_arrays.path, given), progress=progress)
    return load_dataset(place)


def find_poses(
    sequence: _arrays.Path, *, progress: Optional[Report] = None, **options: object
) -> Scene:
    """Finds the camera poses of a sequence, or takes those of a file, as `omnilife curate poses` does.

    `find_poses(sequence, poses="poses.json")` takes them; without `poses`, structure from motion must be
    installed.
    """
    place = _arrays.path(sequence)
    command("curate", "poses", *_options(options), "--", place, progress=progress)
    return load_scene(place)


def reconstruct(
    scene: Union[Scene, _arrays.Path],
    split: Union[Split, _arrays.Path],
    out: _arrays.Path,
    *,
    progress: Optional[Report] = None,
    **options: object,
) -> Run:
    """Trains a method on the input views and renders all views, as `omnilife reconstruct train` does.

    Options are those of the command; those of the method are a dictionary:
    `reconstruct(scene, split, "RUN", method="odgs", iterations=1500, set={"max-gaussians": 20000})`. A run that
    is there and unchanged is read.
    """
    scene = scene.path if isinstance(scene, Scene) else _file_in(scene, "scene.json")
    split = split.path if isinstance(split, Split) else _file_in(split, "split.json")
    place = _arrays.path(out)
    words = ["reconstruct", "train", *_options(options), f"--split={split}", f"--out={place}"]
    command(*words, "--", scene, progress=progress)
    return load_run(place)


def load_dataset(path: _arrays.Path) -> Dataset:
    """Reads a dataset.json, or that of a folder."""
    file = _file_in(path, "dataset.json")
    record = json.loads(_native.read_record("dataset", str(file)))
    sequences: list[Path] = []
    videos = Table({name: [] for name in ("file", "outcome", "sequences", "reason")})
    for video in record["videos"]:
        status = video["status"]
        folders = status.get("sequences", [])
        sequences += [file.parent / folder for folder in folders]
        reason = f"as {status['of']}" if "of" in status else status.get("reason")
        row = (video["file"], status["outcome"], len(folders), reason)
        for column, value in zip(videos.values(), row):
            column.append(value)
    return Dataset(file, sequences, videos, record)


def load_run(path: _arrays.Path) -> Run:
    """Reads a run.json, or that of a folder."""
    file = _file_in(path, "run.json")
    record = json.loads(_native.read_record("run", str(file)))
    return Run(file, record.get("variant") or record["method"], record["scene"], record)


def _program() -> str:
    """The command of this package, or else the first one in PATH."""
    try:
        files = metadata.files("omnilife") or []
    except metadata.PackageNotFoundError:
        files = []
    places = (str(file.locate()) for file in files if file.name == _PROGRAM)
    found = next(filter(os.path.isfile, places), None) or shutil.which("omnilife")
    if found is None:
        raise MachineError("the command omnilife is not installed")
    return found


def _options(options: Mapping[str, object]) -> list[str]:
    """Options as words: `with_=["a", "b"]` is `--with=a,b`, `set={"x": 1}` is `--set=x=1`."""
    words = []
    for name, value in options.items():
        flag = "--" + name.rstrip("_").replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            words.append(flag)
        elif isinstance(value, Mapping):
            words += [f"{flag}={key}={_word(item)}" for key, item in value.items()]
        elif isinstance(value, (list, tuple)):
            words.append(f"{flag}={','.join(map(_word, value))}")
        else:
            words.append(f"{flag}={_word(value)}")
    return words


def _word(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return _arrays.path(value) if isinstance(value, os.PathLike) else str(value)


def _reported(text: str, progress: Optional[Report]) -> bool:
    """Passes a line of progress on; returns False for any other line."""
    try:
        event = json.loads(text) if text.startswith("{") else None
    except ValueError:
        event = None
    if not isinstance(event, dict) or "event" not in event:
        return False
    kind = event.pop("event")
    if kind == "note":
        _LOG.info("%s", event["line"])
    elif progress is not None:
        progress(Progress(**event, has_ended=kind == "end"))
    return True


def _message(said: list[str]) -> str:
    """The line of an error: the command's own, that of its options, or the last one."""
    for start, lines in (("omnilife: ", said[::-1]), ("error: ", said)):
        found = next((line for line in lines if line.startswith(start)), None)
        if found is not None:
            return found[len(start) :]
    return next(filter(None, reversed(said)), "")
