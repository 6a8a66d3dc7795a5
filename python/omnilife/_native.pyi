"""The compiled half (python/src): bytes in C order and records as JSON. Sizes are (width, height)."""

from typing import Optional, TypedDict, Union

__all__ = [
    "compute",
    "metrics",
    "project",
    "protocols",
    "query",
    "rays",
    "read_distances",
    "read_image",
    "read_mask",
    "read_points",
    "read_record",
    "resized",
    "results_below",
    "rotation_matrix",
    "score",
    "scored_bytes",
    "scored_size",
    "split_scene",
    "unproject",
]

_Size = tuple[int, int]
_Rows = list[list[float]]

class _Metric(TypedDict):
    id: str
    title: str
    unit: str
    direction: Optional[str]
    range: list[float]
    source: str
    needs: list[tuple[str, str]]

class _Given(TypedDict):
    ignored: Optional[bytes]
    dynamic: Optional[bytes]
    classes: dict[str, bytes]
    objects: dict[str, bytes]
    depth: Optional[tuple[bytes, bytes]]
    previous: Optional[tuple[bytes, bytes]]

class _Request(TypedDict):
    scene: str
    split: str
    run: Optional[str]
    novel_views: Optional[str]
    input_views: Optional[str]
    method: Optional[str]
    out: str
    memory_bytes: int
    without_lpips: bool
    metrics: list[str]

def compute(
    ids: list[str], size: _Size, prediction: bytes, truth: bytes, given: _Given
) -> list[Union[float, str]]: ...
def metrics() -> list[_Metric]: ...
def project(camera: str, points: bytes) -> bytearray: ...
def protocols() -> list[tuple[str, str]]: ...
def rays(camera: str, rotation: Optional[_Rows] = None) -> bytearray: ...
def read_distances(
    path: str, unit: float, size: Optional[_Size] = None
) -> tuple[bytearray, list[int]]: ...
def read_image(
    path: str, expected: Optional[_Size] = None, size: Optional[_Size] = None
) -> tuple[bytearray, list[int]]: ...
def read_mask(
    path: str,
    expected: Optional[_Size] = None,
    size: Optional[_Size] = None,
    touched: bool = False,
) -> tuple[bytearray, list[int]]: ...
def read_points(path: str) -> tuple[bytearray, bytearray]: ...
def read_record(kind: str, path: str) -> str: ...
def resized(camera: str, size: _Size) -> str: ...
def query(
    results: str,
    table: str,
    by: list[str],
    metrics: list[str],
    conditions: list[str],
    dataset: Optional[str],
) -> tuple[str, list[str]]: ...
def results_below(folder: str) -> list[tuple[str, str]]: ...
def rotation_matrix(rotation_wxyz: list[float]) -> _Rows: ...
def score(request: _Request) -> list[str]: ...
def scored_bytes(values: bytes, shape: tuple[int, int, int]) -> bytes: ...
def scored_size(camera: str, protocol: str) -> list[int]: ...
def split_scene(scene: str, protocol: str, out: str) -> None: ...
def unproject(camera: str, pixels: bytes) -> bytearray: ...
