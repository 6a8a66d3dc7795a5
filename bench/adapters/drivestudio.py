"""A scene of traffic as drivestudio and EmerNeRF keep Waymo, configurations without human bodies, and names of views.

prepare: the frames of one perspective camera, in the order of time, each a moment of its own:

    OUT/000/images/000_0.jpg ...        the frames, whatever their format
    OUT/000/sky_masks/000_0.png ...     black: no sky is known
    OUT/000/dynamic_masks/000_0.png ... the masks, for their own scores; also in all/, black in human/ and vehicle/
    OUT/000/ego_pose/000.txt ...        vehicle to world, 4 x 4; x forward, y left, z up: the camera stands for it
    OUT/000/extrinsics/0.txt            the identity
    OUT/000/intrinsics/0.txt            fx, fy, cx, cy and no distortion; of images of --intrinsics-of, where it is given
    OUT/000/lidar/000.bin ...           14 f32 a point: its origin and place in the vehicle's axes, then zeros
    OUT/000/instances/*.json            the boxes of tracked objects, and those of each frame
    OUT/size.txt                        height and width of the frames

Points are where the frames have distances. Instances are vehicles, whose nodes are rigid, and people, whose nodes
deform: bodies would need poses that are not known. Without --tracks there are none. Needs nothing but Python.
"""

import argparse
import bisect
import json
import math
import struct
from pathlib import Path

from scene_files import distances, rotation, write_black

# Classes of tracks, and the names of their nodes' classes there.
CLASSES = {"vehicle": "Vehicle", "person": "Cyclist"}
MOST_POINTS = 60_000


def with_place(columns, place):
    """Returns the rows of a 4 x 4 matrix from its columns and its translation."""
    return [[*(column[row] for column in columns), place[row]] for row in range(3)] + [[0, 0, 0, 1]]


def text_of(rows):
    return "\n".join(" ".join(repr(float(value)) for value in row) for row in rows) + "\n"


def points_of(prior, folder, camera):
    """Returns the points of a frame's distances, in the vehicle's axes."""
    width, height, values = distances(folder / prior["file"])
    known = [index for index, value in enumerate(values) if value]
    points = []
    for index in known[:: max(1, math.ceil(len(known) / MOST_POINTS))]:
        column, row = (index % width + 0.5) / width, (index // width + 0.5) / height
        x = (column * camera["width"] - camera["cx"]) / camera["fx"]
        y = (row * camera["height"] - camera["cy"]) / camera["fy"]
        depth = values[index] * prior["unit"]
        if prior["convention"] == "ray":
            depth /= math.sqrt(x * x + y * y + 1)
        points.append((depth, -x * depth, -y * depth))
    return points


def spline(path, seconds):
    """Returns the position on a B-spline, or nothing before its first and after its last instant."""
    degree, knots = path["degree"], path["knots"]
    if not knots[degree] <= seconds <= knots[-degree - 1]:
        return None
    last = len(path["coefficients"]) - 1
    piece = min(bisect.bisect_right(knots, seconds) - 1, last)
    parts = [list(path["coefficients"][piece - degree + number]) for number in range(degree + 1)]
    for level in range(1, degree + 1):
        for number in range(degree, level - 1, -1):
            first = piece - degree + number
            span = knots[first + degree - level + 1] - knots[first]
            share = (seconds - knots[first]) / span if span else 0.0
            parts[number] = [(1 - share) * a + share * b for a, b in zip(parts[number - 1], parts[number])]
    return parts[degree]


def heading(path, seconds):
    """Returns the heading at a time: linear between its samples, the short way around."""
    times, angles = path["heading_seconds"], path["headings"]
    after = bisect.bisect_right(times, seconds)
    if after in (0, len(times)):
        return angles[min(after, len(times) - 1)]
    turn = math.remainder(angles[after] - angles[after - 1], math.tau)
    return angles[after - 1] + turn * (seconds - times[after - 1]) / (times[after] - times[after - 1])


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def box(track, up, seconds):
    """Returns object to world at a time: x is ahead, z up."""
    centre = spline(track["path"]["centre"], seconds)
    if centre is None:
        return None
    along = [1, 0, 0] if abs(up[0]) < max(abs(up[1]), 0.9) else [0, 1, 0]
    part = sum(a * b for a, b in zip(along, up))
    first = [a - part * b for a, b in zip(along, up)]
    length = math.hypot(*first)
    first = [value / length for value in first]
    second, angle = cross(up, first), heading(track["path"], seconds)
    ahead = [math.cos(angle) * a + math.sin(angle) * b for a, b in zip(first, second)]
    return with_place([ahead, cross(up, ahead), up], centre)


def write_instances(tracks, times, out):
    """Writes the boxes of all tracks of known classes; returns their number."""
    infos, seen = {}, {str(number): [] for number in range(len(times))}
    for track in tracks["tracks"]:
        if track["class"] not in CLASSES:
            print(f"track {track['id']} of class {track['class']} is left out")
            continue
        found = [(number, box(track, tracks["up"], seconds)) for number, seconds in enumerate(times)]
        found = [(number, pose) for number, pose in found if pose]
        if not found:
            continue
        name = str(len(infos))
        for number, _ in found:
            seen[str(number)].append(int(name))
        notes = {"frame_idx": [number for number, _ in found], "obj_to_world": [pose for _, pose in found],
                 "box_size": [track["dimensions"]] * len(found)}
        infos[name] = {"id": str(track["id"]), "class_name": CLASSES[track["class"]], "frame_annotations": notes}
    (out / "instances_info.json").write_text(json.dumps(infos))
    (out / "frame_instances.json").write_text(json.dumps(seen))
    return len(infos)


def prepare(arguments):
    data, out = arguments.data, arguments.out / "000"
    scene = json.loads((data / "scene.json").read_text())
    camera = scene["camera"]
    if camera["model"] != "pinhole":
        raise SystemExit(f"{data} must have perspective frames, got {camera['model']}")
    if arguments.tracks and not arguments.tracks.is_file():
        raise SystemExit(f"{arguments.tracks} is missing: without boxes of vehicles there is nothing that moves")
    frames = [frame for frame in scene["frames"] if frame.get("pose")]
    if len(frames) > 1000:
        raise SystemExit(f"{data} has {len(frames)} frames, and 1000 can be numbered")
    without = [frame["image"] for frame in frames if not frame.get("depth_prior")]
    if without:
        raise SystemExit(f"{without[0]} has no distances: points of vehicles come from them (curate attach --depth-prior)")
    masks = ["dynamic_masks", *(f"dynamic_masks/{name}" for name in ("all", "human", "vehicle"))]
    for name in ["images", "sky_masks", "ego_pose", "extrinsics", "intrinsics", "lidar", "instances", *masks]:
        (out / name).mkdir(parents=True, exist_ok=name == masks[0])
    (arguments.out / "size.txt").write_text(f"{camera['height']}, {camera['width']}\n")
    (out / "extrinsics/0.txt").write_text(text_of([[float(row == column) for column in range(4)] for row in range(4)]))
    height, width = arguments.intrinsics_of or (camera["height"], camera["width"])
    scales = [width / camera["width"], height / camera["height"]]
    lens = [camera[name] * scale for name, scale in zip(("fx", "fy", "cx", "cy"), scales * 2)]
    (out / "intrinsics/0.txt").write_text(text_of([[value] for value in lens + [0] * 5]))
    for number, frame in enumerate(frames):
        name = f"{number:03}"
        (out / f"images/{name}_0.jpg").symlink_to((data / frame["image"]).resolve())
        for folder in ["sky_masks", *masks]:
            mask = out / f"{folder}/{name}_0.png"
            if folder in masks[:2] and frame.get("mask"):
                mask.symlink_to((data / frame["mask"]).resolve())
            else:
                write_black(mask, camera["width"], camera["height"])
        rows = rotation(frame["pose"]["rotation_wxyz"])
        right, down, ahead = ([row[column] for row in rows] for column in range(3))
        pose = with_place([ahead, [-value for value in right], [-value for value in down]], frame["pose"]["centre"])
        (out / f"ego_pose/{name}.txt").write_text(text_of(pose))
        points = points_of(frame["depth_prior"], data, camera)
        (out / f"lidar/{name}.bin").write_bytes(b"".join(struct.pack("<14f", 0, 0, 0, *point, *[0] * 8) for point in points))
    times = [frame["time_seconds"] for frame in frames]
    if arguments.tracks and not write_instances(json.loads(arguments.tracks.read_text()), times, out / "instances"):
        raise SystemExit(f"{arguments.tracks} has no vehicle and no person at the times of the frames")


def without_bodies(arguments):
    """Copies a configuration without its nodes of human bodies."""
    lines = arguments.configuration.read_text().splitlines(keepends=True)
    kept, is_left_out = [], False
    for line in lines:
        is_key = line.strip() and not line.lstrip().startswith("#")
        if is_key and len(line) - len(line.lstrip()) <= 2:
            is_left_out = line.split(":")[0].strip() == "SMPLNodes"
        if not is_left_out:
            kept.append(line)
    arguments.out.write_text("".join(kept))


def views(arguments):
    """Names views by their order: theirs have the number of the frame times three."""
    found = sorted(arguments.data.glob(arguments.name), key=lambda path: int(path.stem.rsplit("_", 1)[1]))
    if not found:
        raise SystemExit(f"{arguments.data} has no {arguments.name}")
    arguments.out.mkdir()
    for index, view in enumerate(found):
        (arguments.out / f"{index:03}.png").symlink_to(view.resolve())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    command = commands.add_parser("prepare")
    command.add_argument("--tracks", type=Path)
    command.add_argument("--intrinsics-of", type=int, nargs=2, metavar=("HEIGHT", "WIDTH"))
    command.set_defaults(run=prepare)
    last = commands.add_parser("views")
    last.add_argument("--name", required=True)
    last.set_defaults(run=views)
    for one in (command, last):
        one.add_argument("--data", type=Path, required=True)
    other = commands.add_parser("without-bodies")
    other.add_argument("configuration", type=Path)
    other.set_defaults(run=without_bodies)
    for one in (command, other, last):
        one.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
