"""A run in the viewer Rerun, which is the extra `rerun`: at its end, or while it learns.

python -m omnilife.rerun RUN --scene SCENE --split SPLIT --save run.rrd
python -m omnilife.rerun RUN --scene SCENE --split SPLIT --connect --follow

It reads the files that a training leaves, in a process of its own, and writes nothing into the run's folder.
"""

from __future__ import annotations

import argparse
import logging
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Optional, Union
from urllib.parse import urlsplit

from . import _arrays
from ._extras import extra
from ._recording import Recording
from .errors import InputError, MachineError, OmnilifeError
from .jobs import load_run
from .results import read_trace
from .scene import Scene, Split, load_scene, load_split

#: Address of a viewer on this machine, as its own default is.
VIEWER = "rerun+http://127.0.0.1:9876/proxy"
#: Gaussians that are shown at most.
MAX_GAUSSIANS = 200_000
#: Seconds between two looks at a run that learns.
INTERVAL_SECONDS = 2.0

#: Seconds without a change of a run's files after which a note says so.
_QUIET_SECONDS = 600.0
#: Seconds until a viewer that does not answer is not there, and until one must have taken what was sent.
_CONNECT_SECONDS = 3.0
_SEND_SECONDS = 20.0
#: First bytes of recordings, and a word among the last ones of those that are whole.
_MAGIC, _FOOT, _FOOT_BYTES = b"RRF2", b"RRF2FOOT", 32

_LOG = logging.getLogger("omnilife")


def show(
    run: _arrays.Path,
    scene: Union[Scene, _arrays.Path],
    split: Union[Split, _arrays.Path],
    *,
    save: Optional[_arrays.Path] = None,
    connect: Optional[str] = None,
    follow: bool = False,
    scores: Optional[_arrays.Path] = None,
    views: int = 3,
    max_gaussians: int = MAX_GAUSSIANS,
    interval_seconds: float = INTERVAL_SECONDS,
) -> list[str]:
    """Shows a run in Rerun; returns lines on what is not shown.

    `save` is a file that gets the recording, `connect` the address of a viewer that receives it. Without `follow`
    the run must have ended, and the file appears whole. With `follow` the run may learn or be about to: the file
    grows under its name until the run ends or Ctrl-C, and viewers open it at any time. Where neither trace.csv nor
    checkpoint.bin changes for ten minutes, a warning says so once in the log `omnilife`. `scores` is the folder of
    the run's scores, whose curve is shown. `views` is the number of novel views that are shown.
    """
    sdk = _sdk()
    for name, value, least in (("views", views, 1), ("max_gaussians", max_gaussians, 1)):
        if value < least:
            raise InputError(f"{name} must be at least {least}, got {value}")
    if not 0.1 <= interval_seconds <= 3600:
        raise InputError(f"interval_seconds must be in [0.1, 3600], got {interval_seconds}")
    if (save is None) == (connect is None):
        raise InputError("a recording needs either a file to save or a viewer to connect")
    scene = scene if isinstance(scene, Scene) else load_scene(scene)
    split = split if isinstance(split, Split) else load_split(split)
    if split.scene != scene.id:
        raise InputError(f"{split.path}: is a split of {split.scene}, the scene is {scene.id}")
    folder = Path(_arrays.path(run))
    if not follow:
        ended = load_run(folder)
        if ended.scene != scene.id:
            raise InputError(f"{ended.path}: is a run on {ended.scene}, the scene is {scene.id}")
    curve = None if scores is None else read_trace(scores)
    stream = sdk.RecordingStream(f"omnilife {scene.id}")
    recording = Recording(sdk, stream, scene, split, folder, views, max_gaussians)
    with _Sink(stream, recording.layout(), save, connect, follow) as sink:
        recording.log_scene()
        if follow:
            _follow(recording, sink, interval_seconds)
        else:
            recording.log_run()
        if curve is not None:
            recording.log_curve(curve)
        sink.flush()
    return recording.notes


def _follow(recording: Recording, sink: _Sink, interval_seconds: float) -> None:
    seen, since, is_noted = recording.versions(), time.monotonic(), False
    try:
        while not recording.has_ended():
            recording.log_news()
            sink.flush()
            versions = recording.versions()
            if versions != seen:
                seen, since = versions, time.monotonic()
            elif not is_noted and time.monotonic() - since >= _QUIET_SECONDS:
                is_noted = True
                _LOG.warning(
                    "omnilife.rerun: neither trace.csv nor checkpoint.bin of %s has changed for %d minutes: it is "
                    "still followed, until its end or Ctrl-C",
                    *(recording.folder, round(_QUIET_SECONDS / 60)),
                )
            time.sleep(interval_seconds)
        recording.log_run()
    except KeyboardInterrupt:
        recording.notes.append("interrupted: later rows of the run are not shown")


class _Sink:
    """A file or a viewer that receives a recording; fails where it does not."""

    def __init__(
        self,
        stream: Any,
        layout: Any,
        save: Optional[_arrays.Path],
        connect: Optional[str],
        follow: bool,
    ) -> None:
        self._stream = stream
        self._address = connect
        self._file = None if save is None else Path(_arrays.path(save))
        self._written = self._file
        if self._file is not None:
            _check_file(self._file)
            written = self._file
            if not follow:
                written = written.with_name(f".{written.name}.{os.getpid()}.part")
            self._written = written
            try:
                with _as_machine_error(self._file):
                    # Tried here: the recording reports what fails in a log of its own alone.
                    written.touch()
                    _in_time(lambda: stream.save(written, default_blueprint=layout))
            except MachineError:
                if not follow:
                    written.unlink(missing_ok=True)
                raise
        else:
            address = connect or VIEWER
            self._address = address
            _check_viewer(address)
            with _as_machine_error(address):
                stream.connect_grpc(address, default_blueprint=layout)

    def flush(self) -> None:
        """Waits until everything so far has arrived."""
        with _as_machine_error(self._file or self._address):
            self._stream.flush(timeout_sec=_SEND_SECONDS)

    def __enter__(self) -> _Sink:
        return self

    def __exit__(self, kind: Optional[type[BaseException]], *_: object) -> None:
        try:
            _in_time(self._stream.disconnect)
        except TimeoutError as error:
            # After a failure, that is what is reported.
            if kind is None:
                raise MachineError(f"{self._file or self._address}: cannot be ended: {error}") from error
        if self._file is None or self._written is None:
            return
        is_temporary = self._written != self._file
        if kind is not None:
            if is_temporary:
                self._written.unlink(missing_ok=True)
            return
        if not _is_whole(self._written):
            if is_temporary:
                self._written.unlink(missing_ok=True)
            raise MachineError(
                f"{self._file}: its end was not written: is the disk full, or RERUN=off in the environment?"
            )
        if is_temporary:
            with _as_machine_error(self._file):
                os.replace(self._written, self._file)


def _in_time(work: Callable[[], object]) -> None:
    """Does a step of the SDK, which may wait for ever for a file or a viewer that takes nothing any more."""
    errors: list[BaseException] = []

    def do() -> None:
        try:
            work()
        except BaseException as error:
            errors.append(error)

    thread = threading.Thread(target=do, daemon=True)
    thread.start()
    thread.join(_SEND_SECONDS)
    if thread.is_alive():
        raise TimeoutError(f"nothing arrives for {_SEND_SECONDS:.0f} s: is the disk full, or the viewer gone?")
    for error in errors:
        raise error


class _as_machine_error:
    """Turns failures of the SDK and of the system into one line that names the place."""

    def __init__(self, place: Any) -> None:
        self._place = place

    def __enter__(self) -> None:
        return None

    def __exit__(self, _: Any, error: Optional[BaseException], __: Any) -> None:
        if error is None or isinstance(error, OmnilifeError) or not isinstance(error, Exception):
            return
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise MachineError(f"{self._place}: cannot be written: {' '.join(reason.split())}") from error


def _check_file(file: Path) -> None:
    """Refuses to replace a file that is not a recording."""
    if file.is_dir():
        raise InputError(f"{file}: is a folder, expected the name of a file")
    if file.exists() and file.stat().st_size > 0 and not _is_recording(file):
        raise InputError(f"{file}: exists and is not a recording of Rerun: it is not replaced")


def _is_recording(file: Path) -> bool:
    try:
        with open(file, "rb") as opened:
            return opened.read(4) == _MAGIC
    except OSError:
        return False


def _is_whole(file: Path) -> bool:
    with _as_machine_error(file), open(file, "rb") as opened:
        size = opened.seek(0, os.SEEK_END)
        opened.seek(max(0, size - _FOOT_BYTES))
        return _FOOT in opened.read()


def _check_viewer(address: str) -> None:
    """Refuses an address where no viewer listens: the SDK itself would wait for one in silence."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port or 9876
    except ValueError as error:
        raise InputError(f"{address}: is not an address of a viewer: {error}") from error
    if not parts.scheme.startswith("rerun") or host is None:
        raise InputError(f"{address}: is not an address of a viewer, such as {VIEWER}")
    try:
        socket.create_connection((host, port), timeout=_CONNECT_SECONDS).close()
    except OSError as error:
        reason = error.strerror or str(error)
        raise MachineError(f"{address}: no viewer answers there: {reason}; start one with `rerun`") from error


def _sdk() -> Any:
    sdk = extra("rerun", "rerun")
    if not hasattr(sdk, "GaussianSplats3D"):
        version = getattr(sdk, "__version__", "another package of that name")
        raise ImportError(f"rerun-sdk must be 0.41 or newer, got {version}", name="rerun")
    sdk.set_strict_mode(True)
    return sdk


def main(words: Optional[Sequence[str]] = None) -> int:
    """Runs the command line; returns its exit code: 0, 2 for bad input, 1 for the machine's failures."""
    parser = argparse.ArgumentParser(
        prog="python -m omnilife.rerun", description="Shows a run in Rerun, while it learns too."
    )
    parser.add_argument("run", metavar="RUN", help="folder of the run")
    parser.add_argument("--scene", required=True, help="scene.json, or its folder")
    parser.add_argument("--split", required=True, help="split.json, or its folder")
    sink = parser.add_mutually_exclusive_group(required=True)
    sink.add_argument("--save", metavar="FILE.rrd", help="writes the recording to this file")
    sink.add_argument(
        "--connect",
        nargs="?",
        const=VIEWER,
        metavar="ADDRESS",
        help=f"sends the recording to a viewer that runs, by default to {VIEWER}",
    )
    parser.add_argument("--follow", action="store_true", help="shows a run that learns, until it ends or Ctrl-C")
    parser.add_argument("--scores", metavar="FOLDER", help="shows the curve in these scores of the run too")
    parser.add_argument(
        "--views", type=int, default=3, metavar="N", help="shows N novel views per row of the trace [default: 3]"
    )
    parser.add_argument(
        "--max-gaussians",
        type=int,
        default=MAX_GAUSSIANS,
        metavar="N",
        help="shows at most N Gaussians of a model or checkpoint, evenly spread over its order [default: 200000]",
    )
    parser.add_argument(
        "--every",
        type=float,
        default=INTERVAL_SECONDS,
        metavar="SECONDS",
        help="looks for news of a run that learns this often [default: 2]",
    )
    given = parser.parse_args(words)
    # The SDK's own log would say the same as the error below, in lines of another form.
    os.environ.setdefault("RUST_LOG", "off")
    try:
        notes = show(
            *(given.run, given.scene, given.split),
            save=given.save,
            connect=given.connect,
            follow=given.follow,
            scores=given.scores,
            views=given.views,
            max_gaussians=given.max_gaussians,
            interval_seconds=given.every,
        )
    except (OmnilifeError, ImportError) as error:
        print(f"omnilife.rerun: {error}", file=sys.stderr)
        return 1 if isinstance(error, MachineError) else 2
    for note in notes:
        print(f"omnilife.rerun: {note}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    _code = main()
    if _code != 0:
        # At its exit the SDK waits without end for a file or a viewer that is gone.
        sys.stderr.flush()
        os._exit(_code)
