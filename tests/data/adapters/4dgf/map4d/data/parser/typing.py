"""The records of the metadata."""

from dataclasses import dataclass
from typing import Any


@dataclass
class ImageInfo:
    image_path: str
    width: int
    height: int
    pose: Any
    intrinsics: Any
    mask_path: str
    depth_path: str
    cam_id: int
    sequence_id: int
    frame_id: int
    timestamp: float
    flow_neighbors: list
    cam2vehicle: Any = None


@dataclass
class AnnotationInfo:
    sequence_id: int
    frame_id: int
    timestamp: float
    boxes: Any
    box_ids: Any
    class_ids: Any
    vehicle2world: Any = None


@dataclass
class PointCloudInfo:
    points_path: str
    sequence_id: int
    frame_id: int
    timestamp: float
    vehicle2world: Any = None
    colors: Any = None
