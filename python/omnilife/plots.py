"""Plots of results. They need matplotlib, the extra `plots`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, Union

from . import _arrays
from ._extras import extra
from .errors import InputError
from .metrics import METRICS
from .results import Result, read_trace

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
    stem = f"novel_{metric.replace('-', '_')}"
    column = next((name for name in (stem, f"{stem}_db") if name in table), None)
    if column is None or against not in table:
        raise InputError(f"{file}: has no {metric if column is None else against}")
    rows = zip(table[against], table[column])
    points = [(at, value) for at, value in rows if at is not None and value is not None]
    if not points:
        raise InputError(f"{file}: has no row with {against} and {metric}")
    figure, axes = pyplot.subplots(layout="constrained")
    axes.plot(
        *zip(*points), marker="o", label=result.method if isinstance(result, Result) else None
    )
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
