"""A scene's frames, masks and poses as a clip of OmnimatteRF.

    OUT/rgb_1x/00000.png ...             the frames, and the last one twice more
    OUT/masks/mask/00/00000.png ...      the masks, black for frames where nothing moves
    OUT/poses.json                       camera_angle_x, and per frame pose (OpenGL axes), near and far

Its data set ends two frames before its images do: one for the flow to the next, one by its own count. Without the
copies the last two frames would have no view. Near and far are those of the points that a frame sees. Needs nothing
but Python.
"""

import argparse
import json
import math
from pathlib import Path

import ply
from scene_files import rotation, write_black

# Shares of the points in view that are nearer than near and far.
NEAR, FAR = 0.01, 0.99
COPIES = 2


def bounds(points, rows, centre, camera):
    """Returns near and far of a frame, or nothing if it sees no points."""
    depths = []
    for point in points:
        offset = [point[axis] - centre[index] for index, axis in enumerate("xyz")]
        x, y, z = (sum(rows[row][column] * offset[row] for row in range(3)) for column in range(3))
        if z <= 0:
            continue
        column, row = camera["fx"] * x / z + camera["cx"], camera["fy"] * y / z + camera["cy"]
        if 0 <= column < camera["width"] and 0 <= row < camera["height"]:
            depths.append(z)
    depths.sort()
    return [depths[round(share * (len(depths) - 1))] for share in (NEAR, FAR)] if depths else None


def cameras(data, camera, frames):
    if not (data / "points.ply").is_file():
        raise SystemExit(f"{data} has no points, by which near and far are found")
    points = ply.read(data / "points.ply")
    found = []
    for frame in frames:
        rows, centre = rotation(frame["pose"]["rotation_wxyz"]), frame["pose"]["centre"]
        # Its cameras have y up and z back.
        matrix = [[row[0], -row[1], -row[2], place] for row, place in zip(rows, centre)] + [[0, 0, 0, 1]]
        found.append(({"transform_matrix": matrix}, bounds(points, rows, centre, camera)))
    seen = [pair for _, pair in found if pair]
    if not seen:
        raise SystemExit(f"{data} has no points in view of its frames")
    every = [min(near for near, _ in seen), max(far for _, far in seen)]
    for entry, pair in found:
        entry["near"], entry["far"] = pair or every
    return [entry for entry, _ in found]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    data, out = arguments.data, arguments.out
    record = json.loads((data / "poses.json").read_text())
    camera = record["camera"]
    if camera["model"] != "pinhole":
        parser.error(f"{data} must have perspective frames, got {camera['model']}")
    if abs(camera["fx"] / camera["fy"] - 1) > 1e-6:
        parser.error(f"{data} must have square pixels, of which it knows one angle alone")
    middle = [2 * camera["cx"] / camera["width"], 2 * camera["cy"] / camera["height"]]
    if any(abs(place - 1) > 1e-6 for place in middle):
        parser.error(f"{data} must have its principal point in the middle of the image")
    frames = [frame for frame in record["frames"] if frame["pose"]]
    images = sorted((data / "rgb").iterdir())
    if len(images) != len(frames):
        parser.error(f"{data} has {len(images)} images and {len(frames)} poses")
    centres = {tuple(frame["pose"]["centre"]) for frame in frames}
    if len(centres) < 2:
        parser.error(f"{data} must have a camera that moves: its world is scaled by the path")
    if not (data / "mask").is_dir():
        parser.error(f"{data} has no masks, without which its layers do not part")
    masks = out / "masks/mask/00"
    masks.mkdir(parents=True)
    (out / "rgb_1x").mkdir()
    poses = cameras(data, camera, frames)
    for number in range(len(images) + COPIES):
        image = images[min(number, len(images) - 1)]
        (out / f"rgb_1x/{number:05}{image.suffix}").symlink_to(image.resolve())
        mask = data / "mask" / f"{image.stem}.png"
        if mask.is_file():
            (masks / f"{number:05}.png").symlink_to(mask.resolve())
        else:
            write_black(masks / f"{number:05}.png", camera["width"], camera["height"])
    poses += [poses[-1]] * COPIES
    angle = 2 * math.atan(camera["width"] / (2 * camera["fx"]))
    (out / "poses.json").write_text(json.dumps({"camera_angle_x": angle, "frames": poses}, indent=1))


if __name__ == "__main__":
    main()
