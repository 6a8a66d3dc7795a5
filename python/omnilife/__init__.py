"""Scenes, splits, metrics, scores and results of omnilife, as NumPy arrays and plain tables.

The command `omnilife` comes with the package. See docs/guides/python.md.
"""

from . import metrics
from .camera import Camera, Pose
from .errors import InputError, MachineError, OmnilifeError, UndefinedScore
from .jobs import (
    Dataset,
    Progress,
    Run,
    command,
    curate,
    find_poses,
    load_dataset,
    load_run,
    reconstruct,
    show_progress,
)
from .metrics import METRICS, Metric, compute
from .plots import plot_curve, plot_trace
from .results import Result, query, read_result, read_results, read_trace
from .scene import (
    Distances,
    Frame,
    Scene,
    Split,
    load_scene,
    load_split,
    protocols,
    split_scene,
)
from .scoring import score
from .tables import Table

__all__ = [
    "METRICS",
    "Camera",
    "Dataset",
    "Distances",
    "Frame",
    "InputError",
    "MachineError",
    "Metric",
    "OmnilifeError",
    "Pose",
    "Progress",
    "Result",
    "Run",
    "Scene",
    "Split",
    "Table",
    "UndefinedScore",
    "command",
    "compute",
    "curate",
    "find_poses",
    "load_dataset",
    "load_run",
    "load_scene",
    "load_split",
    "metrics",
    "plot_curve",
    "plot_trace",
    "protocols",
    "query",
    "read_result",
    "read_results",
    "read_trace",
    "reconstruct",
    "score",
    "show_progress",
    "split_scene",
]
