"""Reads configuration, clip and camera, and leaves the true images as its views."""

import argparse
import json
import os
import sys

# Its packages are installed.
sys.path.insert(0, os.getcwd())

import images
from nag import config, dataset

BORDER = 15


def check_planes(clip, camera):
    """Refuses objects of which no plane can be made: a point behind the image plane, a mask without width."""
    width = clip.size[0]
    for number, (_, frames) in clip.masks.items():
        largest = max(frames.values(), key=len)
        columns, rows = {pixel % width for pixel in largest}, {pixel // width for pixel in largest}
        assert max(columns) > min(columns) and max(rows) > min(rows), f"object {number} is a line"
        for frame, pixels in frames.items():
            across, down, values = clip.depths[frame]
            for pixel in pixels:
                column, row = pixel % width, pixel // width
                distance = values[row * down // clip.size[1] * across + column * across // width]
                local, place = camera.point(frame, (column, row), distance)
                assert local[2] > 0, f"object {number} is behind the image plane in frame {frame}"
                assert all(abs(value) < 1e6 for value in place)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--config-path", required=True)
    values = config.prepare(config.read(parser.parse_args().config_path))
    clip = dataset.Clip(values)
    frames = len(clip.files)
    camera = config.Camera(values["pinhole_camera_config"], clip.size, frames, values["normalize_camera"])
    assert round(frames * values["plane_flow_control_points_ratio"]) > 0, "no point of a flow"
    assert round(frames * values["object_rigid_control_points_ratio"]) > 1, "no path"
    assert min(clip.size) > 2 * BORDER, "masks without their borders are empty"
    check_planes(clip, camera)
    out = values["output_path"]
    (out / "config.json").write_text(json.dumps(values, default=str))
    digits = len(str(frames - 1))
    for number, file in enumerate(clip.files):
        images.write(out / f"final/complete/{number:0{digits}}_t.png", images.read(file)[2])


if __name__ == "__main__":
    main()
