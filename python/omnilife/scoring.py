"""Folders of predictions against a scene and a split."""

from __future__ import annotations

import logging
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Optional, Union

from . import _arrays, _native
from .results import Result, read_result
from .scene import Scene, Split, _file_in

_LOG = logging.getLogger("omnilife")


def score(
    scene: Union[Scene, _arrays.Path],
    split: Union[Split, _arrays.Path],
    *,
    novel_views: Optional[_arrays.Path] = None,
    input_views: Optional[_arrays.Path] = None,
    run: Optional[_arrays.Path] = None,
    method: Optional[str] = None,
    out: Optional[_arrays.Path] = None,
    metrics: Iterable[str] = (),
    without_lpips: bool = False,
    memory_bytes: int = 2_000_000_000,
) -> Result:
    """Scores predictions, as `omnilife bench score` does.

    `novel_views` and `input_views` are folders with one prediction per frame, `000004.png` or
    `000004.npy` (float32 in [0, 1], height x width x 3), and need the name of a `method`; or `run` is
    the folder or record of a run. The files of the result go into the folder `out`, and nowhere
    without one. `metrics` computes those of these ids alone, `without_lpips` all that need no network.

    A prediction that is missing or unreadable is a row of `failures`, not an exception.
    """
    scene = scene.path if isinstance(scene, Scene) else _file_in(scene, "scene.json")
    split = split.path if isinstance(split, Split) else _file_in(split, "split.json")

    def into(folder: str) -> Result:
        notes = _native.score(
            {
                "scene": str(scene),
                "split": str(split),
                "run": None if run is None else str(_run_file(run)),
                "novel_views": None if novel_views is None else _arrays.path(novel_views),
                "input_views": None if input_views is None else _arrays.path(input_views),
                "method": method,
                "out": folder,
                "memory_bytes": memory_bytes,
                "without_lpips": without_lpips,
                "metrics": list(metrics),
            }
        )
        for note in notes:
            _LOG.info("%s", note)
        return read_result(os.path.join(folder, "result.json"))

    if out is not None:
        return into(_arrays.path(out))
    with tempfile.TemporaryDirectory(prefix="omnilife-") as folder:
        return into(folder)


def _run_file(run: _arrays.Path) -> Path:
    external = Path(_arrays.path(run)) / "external-run.json"
    own = _file_in(run, "run.json")
    return external if external.is_file() and not own.is_file() else own
