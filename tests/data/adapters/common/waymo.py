"""The loader of the layout in which drivestudio and EmerNeRF keep Waymo, and what their programs share."""

import json
import re
import struct
from pathlib import Path

import geometry
import images

NODES = {"Vehicle": "RigidNodes", "Pedestrian": "SMPLNodes", "Cyclist": "DeformableNodes"}
# x right, y down, z forward, in the columns of x forward, y left, z up.
FROM_CAMERA = [[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]]


def matrix(path):
    rows = [[float(word) for word in line.split()] for line in path.read_text().splitlines()]
    assert len(rows) == 4 and rows[3] == [0, 0, 0, 1], path
    geometry.check_rotation(rows)
    return rows


def product(a, b):
    return [[sum(a[row][k] * b[k][column] for k in range(4)) for column in range(4)] for row in range(4)]


def inverse(rows):
    turned = [[rows[column][row] for column in range(3)] for row in range(3)]
    place = [-sum(turned[row][k] * rows[k][3] for k in range(3)) for row in range(3)]
    return [[*turned[row], place[row]] for row in range(3)] + [[0, 0, 0, 1]]


def apply(rows, point):
    return [sum(rows[row][k] * point[k] for k in range(3)) + rows[row][3] for row in range(3)]


def nodes(configuration):
    """Returns the names below `model:` of a configuration."""
    model = re.search(r"^model:\n((?:  .*\n|\n)*)", configuration.read_text(), re.MULTILINE).group(1)
    return re.findall(r"^  (\w+):", model, re.MULTILINE)


def settings(words):
    """Returns options NAME=VALUE over those of the data set that they name."""
    found = dict(word.split("=", 1) for word in words)
    assert Path(f"configs/datasets/{found['dataset']}.yaml").is_file(), "read from the code's folder"
    return found


def read(root, size, known=(), intrinsics_of=None):
    """Returns the files of the images, after checks that boxes hold the points of what the images show."""
    size = tuple(size)
    data = root / "000"
    count = len(list((data / "ego_pose").iterdir()))
    camera_to_ego = product(matrix(data / "extrinsics/0.txt"), FROM_CAMERA)
    fx, fy, cx, cy, *distortion = [float(word) for word in (data / "intrinsics/0.txt").read_text().split()]
    assert len(distortion) == 5
    if intrinsics_of:
        scales = [size[0] / intrinsics_of[0], size[1] / intrinsics_of[1]]
        fy, cy, fx, cx = fy * scales[0], cy * scales[0], fx * scales[1], cx * scales[1]
    infos, of_frames = {}, {str(frame): [] for frame in range(count)}
    if known:
        infos = json.loads((data / "instances/instances_info.json").read_text())
        of_frames = json.loads((data / "instances/frame_instances.json").read_text())
        assert sorted(map(int, of_frames)) == list(range(count)) and infos
    start = inverse(matrix(data / "ego_pose/000.txt"))
    boxes = {}
    for name, info in infos.items():
        if NODES[info["class_name"]] == "SMPLNodes":
            assert (data / "humanpose/smpl.pkl").is_file()
        notes = info["frame_annotations"]
        for frame, pose, sides in zip(notes["frame_idx"], notes["obj_to_world"], notes["box_size"]):
            geometry.check_rotation(pose)
            boxes[frame, int(name)] = (inverse(product(start, pose)), sides)
    files, inside = [], dict.fromkeys(map(int, infos), 0)
    for frame in range(count):
        name = f"{frame:03}"
        file = data / f"images/{name}_0.jpg"
        width, height, rows = images.read(file)
        assert (height, width) == size, f"{file} would be resized to {size}"
        kinds = [f"dynamic_masks/{kind}" for kind in ("all", "human", "vehicle")] if known else ["dynamic_masks"]
        for mask in ["sky_masks", *kinds]:
            assert images.read(data / f"{mask}/{name}_0.png")[:2] == (width, height)
        ego = product(start, matrix(data / f"ego_pose/{name}.txt"))
        to_camera = inverse(product(ego, camera_to_ego))
        points = (data / f"lidar/{name}.bin").read_bytes()
        assert points and len(points) % 56 == 0
        colours = {instance: [] for instance in of_frames[str(frame)]}
        for values in struct.iter_unpack("<14f", points):
            assert values[:3] == (0, 0, 0) and values[13] == 0 and -2 < values[3] < 80
            place = apply(ego, values[3:6])
            x, y, z = apply(to_camera, place)
            assert z > 0, "a point behind the camera"
            places = [fx * x / z + cx, fy * y / z + cy]
            column, row = map(int, places)
            assert 0 <= column < width and 0 <= row < height, "a point that its frame does not see"
            # Distances are those of pixels.
            assert all(abs(at % 1 - 0.5) < 0.05 for at in places), f"{places} is no middle of a pixel"
            for instance, found in colours.items():
                to_box, sides = boxes[frame, instance]
                if all(abs(at) < side / 2 for at, side in zip(apply(to_box, place), sides)):
                    found.append(rows[row][3 * column : 3 * column + 3])
        for instance, found in colours.items():
            inside[instance] += len(found)
            # Objects of the drive are of one colour each.
            assert all(max(abs(a - b) for a, b in zip(found[0], colour)) < 90 for colour in found), instance
        files.append(file)
    for instance, points in inside.items():
        is_built = NODES[infos[str(instance)]["class_name"]] in known
        assert points or not is_built, f"instance {instance} has no points, and would be left out"
    return files
