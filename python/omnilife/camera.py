"""Cameras and poses.

Camera axes are x right, y down, z forward. Image coordinates (u, v) are in pixels from the top-left
corner of the image; the centre of the first pixel is at (0.5, 0.5).
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Optional

import numpy as np
import numpy.typing as npt

from . import _native
from ._arrays import F64, Size, rows
from .errors import InputError


@dataclass(frozen=True)
class Camera:
    """The camera of all frames of a scene."""

    #: `erp` (the whole sphere, equirectangular) or `pinhole` (without distortion).
    model: str
    width: int
    height: int
    #: Focal lengths and principal point in pixels, of a pinhole alone.
    fx: Optional[float] = None
    fy: Optional[float] = None
    cx: Optional[float] = None
    cy: Optional[float] = None

    @property
    def size(self) -> Size:
        """Width and height in pixels."""
        return self.width, self.height

    @property
    def K(self) -> F64:
        """The intrinsic matrix (3, 3) in pixels, of a pinhole.

        The centre of the first pixel is at (0.5, 0.5): subtract 0.5 from cx and cy where it is at (0, 0).
        """
        if None in (self.fx, self.fy, self.cx, self.cy):
            raise InputError(
                f"a camera of the model {self.model} has no K; `rays` has its directions"
            )
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], dtype=np.float64)

    def rays(self, rotation: Optional[npt.ArrayLike] = None) -> F64:
        """Unit directions through the centres of all pixels, (height, width, 3).

        They are on the axes of the camera, or on those of the world with the rotation (3, 3) of a pose.
        """
        turn = None if rotation is None else np.asarray(rotation, dtype=np.float64).tolist()
        directions = np.frombuffer(_native.rays(self._json(), turn), dtype=np.float64)
        return directions.reshape(self.height, self.width, 3)

    def project(self, points: npt.ArrayLike) -> F64:
        """Image coordinates (..., 2) of points (..., 3) on the camera's axes; NaN where it sees none."""
        given = rows(points, 3, "points")
        pixels = np.frombuffer(_native.project(self._json(), given.tobytes()), dtype=np.float64)
        return pixels.reshape(given.shape[:-1] + (2,))

    def unproject(self, pixels: npt.ArrayLike) -> F64:
        """Unit directions (..., 3) on the camera's axes of image coordinates (..., 2)."""
        given = rows(pixels, 2, "pixels")
        found = np.frombuffer(_native.unproject(self._json(), given.tobytes()), dtype=np.float64)
        return found.reshape(given.shape[:-1] + (3,))

    def resized(self, width: int, height: int) -> Camera:
        """The same camera with images of another size."""
        return Camera._of_record(json.loads(_native.resized(self._json(), (width, height))))

    @staticmethod
    def _of_record(record: dict[str, Any]) -> Camera:
        return Camera(**record)

    def _json(self) -> str:
        return json.dumps({name: value for name, value in vars(self).items() if value is not None})


@dataclass(frozen=True)
class Pose:
    """Where a camera is and how it is turned: x_world = rotation @ x_camera + centre."""

    #: Camera-to-world rotation as a quaternion (w, x, y, z).
    rotation_wxyz: tuple[float, float, float, float]
    #: Camera centre (3) in world units.
    centre: F64
    #: The same rotation as a matrix (3, 3).
    rotation: F64

    @property
    def camera_to_world(self) -> F64:
        """The pose as a matrix (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation, self.centre
        return matrix

    @property
    def world_to_camera(self) -> F64:
        """The inverse of the pose as a matrix (4, 4)."""
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = self.rotation.T, -self.rotation.T @ self.centre
        return matrix

    @staticmethod
    def _of_record(record: dict[str, Any]) -> Pose:
        wxyz = record["rotation_wxyz"]
        rotation = np.array(_native.rotation_matrix(wxyz))
        return Pose((wxyz[0], wxyz[1], wxyz[2], wxyz[3]), np.array(record["centre"]), rotation)
