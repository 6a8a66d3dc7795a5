"""A scene of traffic as the metadata that map4d, the code of 4DGF, reads of every data set.

    OUT/metadata.pkl            images, boxes of objects, bounds, point clouds, and the unit of depth images
    OUT/points/000000.ply ...   a moment's points, in the world: the distances of its frames, without colours
    OUT/masks/000000.png ...    black where a frame is ignored, of all frames if one has such a mask
    OUT/street.txt              the options of its data parser that depend on the scene

A moment is the time of a label with the frames around it, whose LiDAR is from then, or the time of frames without a
label. Boxes and points are of the moment; frames keep their own times, for which 4DGF interpolates the boxes. The world
is in metres, z up, and begins at the mean place of the cameras. A box is x, y, z of its middle, width, length, height
and its turn about z; at 0 its length lies along y. Objects are vehicles, which are rigid, and people, which deform.

The data parser keeps some moments apart for evaluation, and fails where it keeps none or trains on all of them. So the
last moment stands there once more, a step later, and is the one that it keeps: it trains on all frames. Needs the
environment of map4d: its classes of metadata, and numpy.
"""

import argparse
import itertools
import json
import math
import pickle
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import ply
from drivestudio import box, points_of
from map4d.data.parser.typing import AnnotationInfo, ImageInfo, PointCloudInfo
from scene_files import rotation

# Classes of tracks, and their numbers there.
CLASSES = {"vehicle": 0, "person": 1}
# Space below and above the points, metres, as its script for Waymo adds it to their bounds.
BELOW, ABOVE = 1.0, 10.0
# Least longer side of images, pixels, for its points of the background: below, it divides by a step of 0 pixels.
BACKGROUND_SIDE = 400


def turned(rows, vector):
    """Returns a vector after a rotation by rows."""
    return [sum(a * b for a, b in zip(row, vector)) for row in rows]


def upright(up):
    """Returns the rows of the smallest rotation that turns a unit vector to z."""
    x, y, z = up
    if z < 1e-9 - 1:
        return [[1, 0, 0], [0, -1, 0], [0, 0, -1]]
    part = 1 / (1 + z)
    return [[1 - x * x * part, -x * y * part, -x], [-x * y * part, 1 - y * y * part, -y], [x, y, z]]


class World:
    """A world in metres with z up, from that of the scene."""

    def __init__(self, tracks, frames):
        self.rows, self.metres, self.origin = upright(tracks["up"]), tracks["metres_per_unit"], [0.0] * 3
        places = [self.place(frame["pose"]["centre"]) for frame in frames]
        self.origin = [sum(values) / len(places) for values in zip(*places)]

    def place(self, point):
        return [self.metres * value - begin for value, begin in zip(turned(self.rows, point), self.origin)]

    def camera(self, pose):
        """Returns the columns right, down and ahead of a camera as rows, and its place."""
        axes = zip(*rotation(pose["rotation_wxyz"]))
        return [turned(self.rows, axis) for axis in axes], self.place(pose["centre"])


@dataclass
class Source:
    """An export, its masks of pixels to use by the frame's image, and the world that it comes into."""

    data: Path
    lens: dict
    masks: dict
    world: World


def image_of(frame, source, notes):
    """Returns an image with its camera, whose axes are right, up and back."""
    (right, down, ahead), place = source.world.camera(frame["pose"])
    columns = [right, [-value for value in down], [-value for value in ahead], place]
    pose = [[column[row] for column in columns] for row in range(3)] + [[0, 0, 0, 1]]
    lens, mask = source.lens, source.masks.get(frame["image"])
    matrix = [[lens["fx"], 0, lens["cx"]], [0, lens["fy"], lens["cy"]], [0, 0, 1]]
    return ImageInfo(
        image_path=str((source.data / frame["image"]).resolve()),
        width=lens["width"],
        height=lens["height"],
        pose=np.array(pose, dtype=np.float64),
        intrinsics=np.array(matrix, dtype=np.float64),
        mask_path=mask and str(mask.resolve()),
        depth_path=None,
        flow_neighbors=None,
        **notes,
    )


def seen(frame, source):
    """Yields the points of a frame's distances in the world."""
    (right, down, ahead), place = source.world.camera(frame["pose"])
    for depth, left, up in points_of(frame["depth_prior"], source.data, source.lens):
        steps = zip(right, down, ahead, place)
        yield [begin + source.world.metres * (depth * c - left * a - up * b) for a, b, c, begin in steps]


def write_points(file, frames, source):
    """Writes the points of a moment; returns the corners of their space and that of the cameras."""
    points = [point for frame in frames for point in seen(frame, source)]
    ply.write(file, [dict(zip("xyz", point)) for point in points], [("float", axis) for axis in "xyz"])
    points += [source.world.place(frame["pose"]["centre"]) for frame in frames]
    return [[choose(values) for values in zip(*points)] for choose in (min, max)]


def box_of(track, tracks, seconds, world):
    """Returns the seven numbers of an object's box at a time, or nothing where its path does not reach."""
    pose = box(track, tracks["up"], seconds)
    if pose is None:
        return None
    length, width, height = (world.metres * side for side in track["dimensions"])
    x, y, _ = turned(world.rows, [row[0] for row in pose[:3]])
    return [*world.place([row[3] for row in pose[:3]]), width, length, height, math.atan2(y, x) - math.pi / 2]


def boxes_of(tracks, times, world):
    """Returns the boxes of each time as (box, number of the object, class); objects are numbered without gaps."""
    found, count = [[] for _ in times], 0
    for track in tracks["tracks"]:
        if track["class"] not in CLASSES:
            print(f"track {track['id']} of class {track['class']} is left out")
            continue
        boxes = [box_of(track, tracks, seconds, world) for seconds in times]
        if not any(boxes):
            print(f"track {track['id']} is left out: its path does not reach the times of the frames")
            continue
        for own, values in zip(found, boxes):
            if values:
                own.append((values, count, CLASSES[track["class"]]))
        count += 1
    return found


def moments_of(frames, tracks):
    """Returns pairs of the time of a moment and its frames."""
    labels = sorted({seconds for track in tracks["tracks"] for seconds in track["path"]["heading_seconds"]})
    # Times of one label in several tracks may differ in their last digits.
    steps = [after - before for before, after in zip(labels, labels[1:]) if after - before > 1e-3]

    def moment(frame):
        own = frame["time_seconds"]
        nearest = min(labels, key=lambda seconds: abs(seconds - own), default=own)
        return nearest if abs(nearest - own) <= min(steps, default=0) / 2 else own

    return [(seconds, list(own)) for seconds, own in itertools.groupby(frames, moment)]


def annotation(boxes, notes):
    values = [value for value, _, _ in boxes]
    return AnnotationInfo(
        boxes=np.array(values, dtype=np.float64).reshape(len(boxes), 7),
        box_ids=np.array([number for _, number, _ in boxes], dtype=np.int64),
        class_ids=np.array([kind for _, _, kind in boxes], dtype=np.int64),
        **notes,
    )


def bounds_of(corners):
    """Returns the two corners of a space around all points, with space below and above them."""
    low, high = [min(values) for values in zip(*corners)], [max(values) for values in zip(*corners)]
    return [*low[:2], low[2] - BELOW, *high[:2], high[2] + ABOVE]


def write_masks(data, out, lens, frames):
    """Writes masks of the pixels to use; returns them by the frame's image, and nothing where no frame has one."""
    if not any(frame.get("ignore_mask") for frame in frames):
        return {}
    # Needed here alone; map4d's environment has it.
    from PIL import Image

    (out / "masks").mkdir()
    files = {}
    for number, frame in enumerate(frames):
        mask = Image.new("L", (lens["width"], lens["height"]), 0)
        if frame.get("ignore_mask"):
            mask = Image.open(data / frame["ignore_mask"]).convert("L")
        file = files[frame["image"]] = out / f"masks/{number:06}.png"
        mask.point(lambda value: 0 if value > 127 else 255).save(file)
    return files


def records(number, moment, boxes, file, later, source):
    """Returns the images, the annotation and the point cloud of a moment, `later` seconds after its own time."""
    seconds, frames = moment
    notes, images = {"sequence_id": 0, "frame_id": number}, []
    for camera, frame in enumerate(frames):
        taken = {"cam_id": camera, "timestamp": frame["time_seconds"] + later}
        images.append(image_of(frame, source, notes | taken))
    notes["timestamp"] = seconds + later
    return images, annotation(boxes, notes), PointCloudInfo(points_path=str(file.resolve()), **notes)


def write(data, out, lens, frames, tracks):
    """Writes masks, points and metadata; returns the number of moments."""
    moments = moments_of(frames, tracks)
    count = len(moments)
    if count < 2:
        raise SystemExit(f"{data} must have frames of two moments or more, got {count}")
    times = [seconds for seconds, _ in moments]
    source = Source(data, lens, write_masks(data, out, lens, frames), World(tracks, frames))
    boxes = boxes_of(tracks, times, source.world)
    if not any(boxes):
        raise SystemExit(f"{data} must have a vehicle or a person of the tracks at the times of its frames, got none")
    files = [out / f"points/{number:06}.ply" for number in range(count)]
    corners = [corner for file, (_, own) in zip(files, moments) for corner in write_points(file, own, source)]
    # Times count from the first frame. The moment for evaluation is the last one again, a step later.
    begin, step = frames[0]["time_seconds"], times[-1] - times[-2]
    found = [records(number, moments[number], boxes[number], files[number], -begin, source) for number in range(count)]
    found.append(records(count, moments[-1], boxes[-1], files[-1], step - begin, source))
    images, annotations, clouds = (list(parts) for parts in zip(*found))
    bounds = np.array(bounds_of(corners), dtype=np.float64)
    with open(out / "metadata.pkl", "wb") as file:
        # Depth images, of which there are none, would be in metres.
        pickle.dump(([image for own in images for image in own], annotations, bounds, clouds, 1.0), file)
    return count


def fraction(count):
    """Returns the share of training at which its parser keeps the last of count + 1 moments, and no other."""
    return 1 - 1 / (count + 0.5)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for option in ["data", "tracks", "out"]:
        parser.add_argument(f"--{option}", type=Path, required=True)
    arguments = parser.parse_args()
    data, out = arguments.data, arguments.out
    scene = json.loads((data / "scene.json").read_text())
    lens = scene["camera"]
    if lens["model"] != "pinhole":
        parser.error(f"{data} must have perspective frames, got {lens['model']}")
    if not arguments.tracks.is_file():
        parser.error(f"{arguments.tracks} is missing: without boxes of vehicles there is nothing that moves")
    frames = [frame for frame in scene["frames"] if frame.get("pose")]
    without = [frame["image"] for frame in frames if not frame.get("depth_prior")]
    if without:
        parser.error(f"{without[0]} has no distances: points of vehicles come from them (curate attach --depth-prior)")
    (out / "points").mkdir(parents=True)
    count = write(data, out, lens, frames, json.loads(arguments.tracks.read_text()))
    has_background = max(lens["width"], lens["height"]) >= BACKGROUND_SIDE
    if not has_background:
        print(f"points of the background are left out: images must have {BACKGROUND_SIDE} pixels along a side for them")
    words = ["--train-split-fraction", repr(fraction(count)), "--add-background-points", str(has_background)]
    (out / "street.txt").write_text(" ".join(words) + "\n")
    print(f"{len(frames)} frames of {count} moments; the last moment stands there once more, for evaluation")


if __name__ == "__main__":
    main()
