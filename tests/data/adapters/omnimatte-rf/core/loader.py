"""The arguments, and the data set with its sources: images, flow, masks, cameras."""

import json
import math
import struct
import sys
from pathlib import Path

import geometry
import images


def overrides(words):
    """Returns the values of hydra's overrides by their key."""
    assert all("=" in word for word in words), words
    return dict(word.split("=", 1) for word in words)


def read_flow(path):
    """Returns width and height of a .flo file."""
    data = path.read_bytes()
    magic, width, height = struct.unpack("<fii", data[:12])
    assert abs(magic - 202021.25) < 1e-3, path
    assert len(data) == 12 + 8 * width * height, path
    return width, height


def write_flow(path, width, height):
    path.write_bytes(struct.pack("<fii", 202021.25, width, height) + bytes(8 * width * height))


def listed(folder, *endings):
    return sorted(file for file in folder.glob("*") if file.suffix in endings)


def read(root, sources):
    """Returns the image files of the data points."""
    files = listed(root / "rgb_1x", ".jpg", ".png", ".JPG", ".PNG")
    assert files, "No image file is found"
    size = images.read(files[0])[:2]
    length = len(files)
    for source in sources:
        length = min(length, {"flow": flow, "mask": mask, "blender": blender, "colmap": colmap}[source](root, size))
    return files[: length - 1]


def flow(root, size):
    flows = listed(root / "flow/flow", ".flo")
    assert flows and all(read_flow(file) == size for file in flows)
    confidences = listed(root / "flow/confidence", ".png")
    assert len(confidences) == len(flows)
    assert all(images.read(file)[:2] == size for file in confidences)
    return len(flows)


def mask(root, size):
    content = sorted((root / "masks/mask").iterdir())
    assert content and all(path.is_dir() for path in content), "Cannot determine path content type"
    counts = set()
    for layer in content:
        files = listed(layer, ".png")
        assert all(images.read(file)[:2] == size for file in files)
        counts.add(len(files))
    assert len(counts) == 1 and 0 not in counts
    return counts.pop()


def blender(root, size):
    contents = json.loads((root / "poses.json").read_text())
    assert 0 < contents["camera_angle_x"] < math.pi
    centres = set()
    for frame in contents["frames"]:
        matrix = frame["transform_matrix"]
        geometry.check_rotation(matrix[:3])
        assert matrix[3] == [0, 0, 0, 1]
        assert 0 < frame["near"] < frame["far"]
        centres.add(tuple(row[3] for row in matrix[:3]))
    assert len(centres) > 1, "the largest distance from the middle scales the world"
    return len(contents["frames"])


def colmap(root, size):
    (root / "colmap/poses_bounds.npy").read_bytes()
    raise AssertionError("not written by the adapter")


def sources_of(found):
    return found["data_sources"].strip("[]").split(",")


if __name__ == "__main__":
    sys.exit("no program")
