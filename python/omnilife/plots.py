"""Plots of results. They need matplotlib, the extra `plots`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Union

from . import _arrays
from ._extras import extra
from .errors import InputError
from .jobs import Run
from .metrics import METRICS
from .results import Result, read_trace
from .tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_AXES = {
    "wall_seconds": "wall-clock time (s)",
    "cpu_seconds": "CPU time (s)",
    "iteration": "iteration",
}


def plot_curve(
    result: Union[Result, _arrays.Path],
    metric: str = "psnr",
    against: Literal["wall_seconds", "cpu_seconds", "iteration"] = "wall_seconds",
) -> Figure:
    """Plots a metric of the novel views against run time.

    `result` is a result, or the folder of one. `metric` must be one that the curve has: `psnr`, `ssim`,
    `lpips-alex`, `psnr-static` or `psnr-dynamic`. The figure is closed for pyplot: a notebook shows it
    once, a script calls its `savefig`.
    """
    pyplot = extra("matplotlib.pyplot", "plots")
    if against not in _AXES:
        raise InputError(f"against is {against!r}, expected one of {', '.join(_AXES)}")
    folder = result.path.parent if isinstance(result, Result) else Path(_arrays.path(result))
    file = folder / "curve.csv" if isinstance(result, Result) or folder.is_dir() else folder
    if not file.is_file():
        raise InputError(
            f"{file}: there is no curve: score a run that left a trace, into a folder `out`"
        )
    table = read_trace(file)
    if against not in table:
        raise InputError(f"{file}: has no {against}")
    stem = f"novel_{metric.replace('-', '_')}"
    column = next((name for name in (stem, f"{stem}_db") if name in table), None)
    if column is None:
        raise InputError(f"{file}: has no {metric}")
    name = result.method if isinstance(result, Result) else None
    figure, axes = pyplot.subplots(layout="constrained")
    axes.plot(*_points(table, against, column, file), marker="o", label=name)
    about = METRICS.get(metric)
    title = metric if about is None else about.title
    unit = "" if about is None or not about.unit else f" ({about.unit})"
    axes.set(xlabel=_AXES[against], ylabel=f"{title}{unit} of novel views")
    if isinstance(result, Result):
        axes.set_title(f"{result.scene}, {result.protocol}")
        axes.legend()
    axes.grid(alpha=0.3)
    # Otherwise a notebook shows it twice, and pyplot keeps it for ever.
    pyplot.close(figure)
    return figure  # type: ignore[no-any-return,unused-ignore]


def plot_trace(
    run: Union[Run, _arrays.Path],
    columns: Sequence[str] = ("train_psnr_db",),
    against: Literal["wall_seconds", "cpu_seconds", "iteration"] = "wall_seconds",
) -> Figure:
    """Plots columns of a run's trace against run time, one below the other.

    `run` is a run, or the folder of one. It may still learn: then the trace so far is plotted. The figure is
    closed for pyplot, as that of `plot_curve`.
    """
    pyplot = extra("matplotlib.pyplot", "plots")
    if against not in _AXES:
        raise InputError(f"against is {against!r}, expected one of {', '.join(_AXES)}")
    folder = run.path.parent if isinstance(run, Run) else Path(_arrays.path(run))
    file = folder / "trace.csv" if folder.is_dir() else folder
    table = read_trace(file)
    missing = [name for name in (against, *columns) if name not in table]
    if missing:
        raise InputError(f"{file}: has no {missing[0]}")
    if not columns:
        raise InputError("no columns are given")
    figure, all_axes = pyplot.subplots(
        len(columns), sharex=True, squeeze=False, layout="constrained"
    )
    for axes, column in zip(all_axes[:, 0], columns):
        axes.plot(*_points(table, against, column, file), marker="o")
        axes.set_ylabel(column.replace("_", " "))
        axes.grid(alpha=0.3)
    all_axes[-1, 0].set_xlabel(_AXES[against])
    pyplot.close(figure)
    return figure  # type: ignore[no-any-return,unused-ignore]


def _points(
    table: Table, against: str, column: str, file: Path
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """The values of two columns in the rows that have both."""
    rows = zip(table[against], table[column])
    points = [(at, value) for at, value in rows if at is not None and value is not None]
    if not points:
        raise InputError(f"{file}: has no row with {against} and {column}")
    across, up = zip(*points)
    return across, up
