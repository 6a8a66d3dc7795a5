"""A scene of four small frames, written without the command."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import Optional

import numpy as np
from street import write_png

from omnilife import Camera, Frame, Pose, Scene, Split

ERP = Camera("erp", 8, 4)
PINHOLE = Camera("pinhole", 6, 4, fx=4.0, fy=5.0, cx=3.0, cy=2.0)


class Small:
    """Frames 0 to 3, of which 0 has masks and 3 no pose. Frame i is at (i, 2, 3) and looks along +x of the world."""

    def __init__(self, camera: Camera) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="omnilife-tests-"))
        generator = np.random.default_rng(0)
        width, height = camera.size
        blocks = generator.integers(0, 256, (4, height // 2, width // 2, 3), np.uint8)
        #: Each pixel of half the size is a block of four equal ones.
        self.images = blocks.repeat(2, axis=1).repeat(2, axis=2)
        self.mask = np.zeros((height, width), bool)
        self.mask[:2, 2:4] = True
        self.ignored = np.zeros((height, width), bool)
        self.ignored[3, 1] = True
        write_png(self.folder / "mask.png", 255 * self.mask.astype(np.uint8))
        write_png(self.folder / "ignored.png", 255 * self.ignored.astype(np.uint8))
        for index, image in enumerate(self.images):
            write_png(self.folder / f"{index}.png", image)
        frames = [self._frame(camera, index) for index in range(4)]
        self.scene = Scene(self.folder / "scene.json", "small", camera, "metres", frames, None, {})
        self.split = Split(
            self.folder / "split.json", "small", "per-scene/2", "hash", [0, 2], [1], {}
        )

    def remove(self) -> None:
        shutil.rmtree(self.folder)

    def _frame(self, camera: Camera, index: int) -> Frame:
        # A quarter turn about the axis that points down takes forward to the right.
        half = np.sqrt(0.5)
        record = {"rotation_wxyz": [half, 0.0, half, 0.0], "centre": [float(index), 2.0, 3.0]}

        def first(name: str) -> Optional[Path]:
            return self.folder / name if index == 0 else None

        return Frame(
            index=index,
            time_seconds=0.2 * index,
            camera=camera,
            pose=None if index == 3 else Pose._of_record(record),
            image_path=self.folder / f"{index}.png",
            mask_path=first("mask.png"),
            ignore_mask_path=first("ignored.png"),
            class_paths={},
            object_paths={},
            depth=None,
            depth_prior=None,
        )
