"""The arguments, and the loader of Waymo's layout."""

import argparse
import struct
import sys
from pathlib import Path

import geometry
import images


def settings():
    parser = argparse.ArgumentParser()
    parser.add_argument("--config", type=Path, required=True)
    parser.add_argument("--base_config", type=Path, default=Path("configs/base.yaml"))
    own, others = parser.parse_known_args()
    assert own.config.is_file() and own.base_config.is_file(), "read from the code's folder"
    found = dict(word.split("=", 1) for word in others)
    assert found["lambda_lidar"] == "0", "points that are hidden would be taken for depth"
    return found


def read(found):
    """Returns (number, image file) of the training and the test cameras."""
    root, cameras = Path(found["source_path"]), int(found["cam_num"])
    names = sorted(path.stem for path in (root / "calib").iterdir() if path.suffix == ".txt")
    views = []
    for index, name in enumerate(names):
        pose = [[float(word) for word in line.split()] for line in (root / f"pose/{name}.txt").read_text().splitlines()]
        assert len(pose) == 4 and pose[3] == [0, 0, 0, 1]
        geometry.check_rotation(pose)
        lines = [line.split()[1:] for line in (root / f"calib/{name}.txt").read_text().splitlines()]
        assert all(len(line) == 12 for line in lines[:5] + lines[-5:]) and len(lines) >= 10
        points = (root / f"velodyne/{name}.bin").read_bytes()
        assert len(points) % 24 == 0 and points
        for values in struct.iter_unpack("<6f", points):
            assert values[3:] == (0, 0, 0)
        for camera in range(cameras):
            file = root / f"image_{camera}/{name}.png"
            assert images.read(file)[:2] == images.read(root / f"sky_{camera}/{name}.png")[:2]
            views.append((index * 5 + camera, file))
    hold = int(found["testhold"])
    assert hold != 10, "another rule"
    kinds = [(place // cameras + 1) % hold == 0 for place in range(len(views))]
    return [[view for view, test in zip(views, kinds) if test == wanted] for wanted in (False, True)]


if __name__ == "__main__":
    sys.exit("no program")
