"""Scenes, splits, metrics, scores and results of omnilife, as NumPy arrays and plain tables.

The command `omnilife` comes with the package. See docs/guides/python.md.
"""

from . import metrics
from .camera import Camera, Pose
from .errors import InputError, MachineError, OmnilifeError, UndefinedScore
from .metrics import METRICS, Metric, compute
from .plots import plot_curve
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
    "Distances",
    "Frame",
    "InputError",
    "MachineError",
    "Metric",
    "OmnilifeError",
    "Pose",
    "Result",
    "Scene",
    "Split",
    "Table",
    "UndefinedScore",
    "compute",
    "load_scene",
    "load_split",
    "metrics",
    "plot_curve",
    "protocols",
    "query",
    "read_result",
    "read_results",
    "read_trace",
    "score",
    "split_scene",
]
