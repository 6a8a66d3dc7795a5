"""The configuration, with its placeholders, and the record of the camera."""

import json
import os
import re
from pathlib import Path

import geometry


def scalar(text):
    try:
        return json.loads(text)
    except ValueError:
        return text


def read(path):
    """Returns the values by their key; those of several lines as these lines."""
    first, *lines = Path(path).read_text().splitlines()
    assert first == "NAGConfig:"
    found, key = {}, None
    for line in lines:
        if re.match(r"  [a-z_]", line):
            key, value = line[2:].split(":", 1)
            assert key not in found, f"{key} twice"
            found[key] = scalar(value.strip()) if value.strip() else []
        else:
            found[key].append(line)
    assert found.pop("__class__") == "nag.config.nag_config.NAGConfig"
    return found


def placed(text, values):
    """Returns a path without its placeholders."""

    def value(match):
        kind, _, name = match.group(1).rpartition(":")
        return os.environ[name] if kind == "env" else str(values[name])

    return re.sub(r"{([^}]*)}", value, text)


def prepare(values):
    """Replaces placeholders; what it reads must exist, and the folder of its output is made."""
    for name in ("data_path", "images_path", "masks_path", "depths_path", "pinhole_camera_config"):
        values[name] = Path(placed(values[name], values))
        assert values[name].exists(), f"Path for {name} {values[name]} does not exist."
    values["output_path"] = Path(placed(values["output_path"], values))
    values["output_path"].mkdir(parents=True, exist_ok=True)
    assert values["boxes_path"] is None and not values["use_distance_quantiles"]
    assert values["experiment_logger"] == "tensorboard", "wandb asks for an account"
    for name in ("final_evaluation_metrics", "final_mask_evaluation_metrics"):
        assert not any("LPIPS" in str(metric) for metric in values[name]), "weights of LPIPS would be fetched"
    return values


class Camera:
    """Poses from camera to world, and the lens; the class is that of the record."""

    def __init__(self, path, size, frames, is_made_relative):
        assert path.name.split(".")[1] == "json", path
        record = json.loads(path.read_text())
        assert record.pop("__class__") == "nag.config.pinhole_camera_config.PinholeCameraConfig"
        self.width, self.height = size
        self.focal, scale = record["focal_length"], [1, 1]
        middle = record.get("principal_point") or [self.width / 2, self.height / 2]
        if tuple(record["resolution"]) != size:
            scale = [own / given for own, given in zip(size, record["resolution"])]
        self.middle = [place * by for place, by in zip(middle, scale)]
        assert not record.get("skew") and not record.get("lens_distortion")
        self.poses = record["position"]
        assert len(self.poses) == frames, f"{len(self.poses)} poses for {frames} frames"
        for pose in self.poses:
            assert len(pose) == 4 and pose[3] == [0, 0, 0, 1]
            geometry.check_rotation([row[:3] for row in pose[:3]])
        # It takes turns from the first one and places less the first one, which fits where that is the world's origin.
        first = [[float(row == column) for column in range(4)] for row in range(4)]
        is_first = all(abs(a - b) < 1e-6 for row, its in zip(self.poses[0], first) for a, b in zip(row, its))
        assert is_first or not is_made_relative, "places and turns are made relative apart"

    def point(self, frame, pixel, distance):
        """Returns the place along the ray of a pixel, in the camera and in the world."""
        x, y = ((place - middle) / (self.focal * self.width) for place, middle in zip(pixel, self.middle))
        length = (x * x + y * y + 1) ** 0.5
        local = [x * self.focal + distance * x / length, y * self.focal + distance * y / length, distance / length]
        return local, [sum(a * b for a, b in zip(row, [*local, 1])) for row in self.poses[frame][:3]]
