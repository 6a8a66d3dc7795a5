"""The recognition of a data set, and the reader of D-NeRF's layout."""

import json
import math

import geometry
import images


def read(folder):
    """Returns the image files of the training and the test views."""
    assert not (folder / "sparse").exists(), "would be taken for COLMAP's layout"
    found = []
    for kind in ["train", "test"]:
        contents = json.loads((folder / f"transforms_{kind}.json").read_text())
        assert abs(contents["camera_angle_x"] - math.pi / 2) < 1e-6, contents["camera_angle_x"]
        files = []
        for frame in contents["frames"]:
            assert 0 <= frame["time"] <= 1
            geometry.check_rotation(frame["transform_matrix"][:3])
            assert frame["transform_matrix"][3] == [0, 0, 0, 1]
            file = folder / (frame["file_path"] + ".png")
            width, height, _ = images.read(file)
            assert width == height, f"{file}: both fields of view are the horizontal one"
            files.append((file, frame["time"]))
        found.append(files)
    columns, count = geometry.columns(folder / "points3d.ply")
    names = ["x", "y", "z", "nx", "ny", "nz", "red", "green", "blue"]
    assert [name for _, name in columns] == names and count > 0, columns
    return found
