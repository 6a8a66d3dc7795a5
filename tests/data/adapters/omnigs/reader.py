"""Views of OmniGS: views, extrinsics and intrinsics of one file."""

import json
from pathlib import Path

import geometry
import images


def read(path):
    """Returns (number of the frame, image file) of every view."""
    root = json.loads(path.read_text())
    cameras = {}
    for intrinsic in root["intrinsics"]:
        size = intrinsic["value"]["ptr_wrapper"]["data"]["value0"]
        cameras[intrinsic["key"]] = (size["width"], size["height"])
    poses = {item["key"]: item["value"] for item in root["extrinsics"]}
    found = []
    for item in root["views"]:
        view = item["value"]["ptr_wrapper"]["data"]
        geometry.check_rotation(poses[view["id_pose"]]["rotation"])
        assert len(poses[view["id_pose"]]["center"]) == 3
        size = (view["width"], view["height"])
        assert size == cameras[view["id_intrinsic"]]
        file = Path(root["root_path"]) / view["filename"]
        assert images.read(file)[:2] == size, file
        found.append((item["key"], file))
    return found
