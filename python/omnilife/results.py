"""Results and traces as tables.

A table is a dictionary of columns, lists of equal length, with methods that make data frames of it. What is
not known is None.
"""

from __future__ import annotations

import csv
import json
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Optional, Sequence, Union

from . import _arrays, _html, _native
from .errors import InputError
from .tables import SUMMARY, Table


@dataclass(frozen=True)
class Result:
    """The scores of one method on one scene under one protocol; `read_result` reads one."""

    #: The result.json.
    path: Path
    method: str
    scene: str
    #: Id and version of the protocol, `per-scene/2`.
    protocol: str
    protocol_hash: str
    #: Why the run that was to predict the views failed; such a result has no scores.
    run_failure: Optional[str]
    #: Views that could not be scored, with the reason.
    failures: list[dict[str, Any]]
    #: What a reader of the scores should know.
    warnings: list[str]
    #: One row per view: `view` (`input` or `novel`), `frame`, `time_seconds`, `distance_to_given` and the
    #: metrics by id.
    views: Table = field(repr=False)
    #: The whole result.json.
    record: dict[str, Any] = field(repr=False)

    @property
    def is_complete(self) -> bool:
        """Whether the run ended well and every view has scores; nothing else is ranked or compared."""
        return self.run_failure is None and not self.failures

    def mean(self, metric: str, view: str = "novel") -> float:
        """The mean of a metric over the views, `novel` or `input` ones, that have a value."""
        summary = self.record[f"{view}_views"].get(metric)
        if summary is None:
            raise InputError(f"{self.path}: has no {metric} of {view} views")
        return float(summary["mean"])

    def means(self) -> Table:
        """One row per metric and kind of view."""
        table = Table({name: [] for name in ("view", "metric", *SUMMARY)})
        for view in ("input", "novel"):
            for metric, summary in self.record[f"{view}_views"].items():
                row = {"view": view, "metric": metric, **summary}
                for name, column in table.items():
                    column.append(row[name])
        return table

    def _repr_html_(self) -> str:
        rows = {
            "file": self.path,
            "protocol": self.protocol,
            "run failed": self.run_failure,
            "views without scores": len(self.failures) or None,
            "warnings": len(self.warnings) or None,
        }
        means = self.means()
        shown = Table({name: means[name] for name in ("view", "metric", "mean", "views")})
        below = shown.wide()._repr_html_() if means["metric"] else ""
        return _html.facts(f"{self.method} on {self.scene}", rows, below)


_OF_RESULT = (
    "method",
    "scene",
    "protocol",
    "protocol_hash",
    "seed",
    "training_seconds",
    "primitives",
    "iterations",
)


def read_result(path: _arrays.Path) -> Result:
    """Reads a result.json, or that of a folder, with the table of views beside it."""
    place = Path(_arrays.path(path))
    file = place / "result.json" if place.is_dir() else place
    record = json.loads(_native.read_record("result", str(file)))
    return Result(
        path=file,
        method=record["method"],
        scene=record["scene"],
        protocol=record["protocol"],
        protocol_hash=record["protocol_hash"],
        run_failure=record.get("run_failure"),
        failures=record["failures"],
        warnings=record["warnings"],
        views=_read_csv(file.parent / record["frames_table"]),
        record=record,
    )


def read_results(folder: _arrays.Path) -> Table:
    """All results in a folder and below it, as the leaderboard finds them.

    One row per result, kind of view and metric, with `path`, what the scores are of, and the mean; `wide()` of
    it has one row per result and kind of view.
    """
    table = Table({name: [] for name in ("path", *_OF_RESULT, "view", "metric", *SUMMARY)})
    for path, text in _native.results_below(_arrays.path(folder)):
        record = json.loads(text)
        for view in ("input", "novel"):
            for metric, summary in record[f"{view}_views"].items():
                row = {"path": str(path), "view": view, "metric": metric, **summary}
                for name, column in table.items():
                    column.append(row[name] if name in row else record[name])
    return table


def query(
    folder: _arrays.Path,
    table: str = "results",
    *,
    by: Sequence[str] = (),
    metrics: Sequence[str] = ("psnr",),
    where: Sequence[str] = (),
    dataset: Optional[_arrays.Path] = None,
) -> Table:
    """Means of the results in a folder and below it, by any columns: `omnilife leaderboard query`.

    `table` is `results`, `views` or `curves`; `where` are conditions such as `"view=novel"` and
    `"third=2,3"`, all of which must hold. Lines on what was left out are warnings.
    """
    rows, notes = _native.query(
        _arrays.path(folder),
        table,
        list(by),
        list(metrics),
        list(where),
        None if dataset is None else _arrays.path(dataset),
    )
    for note in notes:
        warnings.warn(note, stacklevel=2)
    answer = Table()
    numbers = {name for metric in metrics for name in (metric, f"{metric}_sd")}
    for row in json.loads(rows):
        for name, value in row.items():
            # JSON has no infinite numbers.
            is_number = name in numbers and isinstance(value, str)
            answer.setdefault(name, []).append(float(value) if is_number else value)
    return answer


def read_trace(path: _arrays.Path) -> Table:
    """Error against run time: the trace of a run, or the curve that scoring made of it.

    `path` is the folder of a run or of its scores, or the trace.csv or curve.csv there. One row per
    moment; the curve has the scores of the novel views.
    """
    place = Path(_arrays.path(path))
    if (place / "run.json").is_file():
        trace = json.loads(_native.read_record("run", str(place / "run.json")))["trace"]
        if trace is None:
            raise InputError(f"{place / 'run.json'}: the run left no trace")
        return _read_csv(place / trace)
    return _read_csv(place / "curve.csv" if place.is_dir() else place)


def _read_csv(path: Path) -> Table:
    """A table of numbers and names: a column of whole numbers is of ints, of other numbers of floats."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{path}: cannot be read: {reason}") from error
    if not rows or any(len(row) != len(rows[0]) for row in rows):
        raise InputError(f"{path}: must be a table of rows of equal length")
    columns = ([row[at] for row in rows[1:]] for at in range(len(rows[0])))
    return Table({name: _values(column) for name, column in zip(rows[0], columns)})


def _values(column: list[str]) -> list[Any]:
    for kind in (int, float):
        try:
            return [_value(text, kind) for text in column]
        except ValueError:
            continue
    return [text or None for text in column]


def _value(text: str, kind: type[Union[int, float]]) -> Optional[Union[int, float]]:
    return None if text == "" else kind(text)
