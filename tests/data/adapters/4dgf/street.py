"""The data parser of street scenes: metadata, scale, split, points, and checks that boxes hold what images show."""

import argparse
import math
import pickle
import struct
from pathlib import Path

import geometry
import images
import numpy
from waymo import apply, inverse, product

# Metres that each box grows along each side.
LARGER = 0.25
# y down, z forward in the columns of y up, z back.
TURN = [[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]


def options(words):
    def truth(word):
        return {"True": True, "False": False}[word]

    parser = argparse.ArgumentParser()
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--train-split-fraction", type=float, default=0.9)
    parser.add_argument("--load-pointclouds", type=truth, default=False)
    parser.add_argument("--remove-nonrigid", type=truth, default=True)
    parser.add_argument("--orient-center-poses", type=truth, default=True)
    parser.add_argument("--add-background-points", type=truth, default=True)
    return parser.parse_args(words)


def rows_of(array, *shape):
    assert isinstance(array, numpy.ndarray) and array.shape == shape, f"{array.shape} is not {shape}"
    return array.tolist()


def in_box(point, box, larger=0.0):
    x, y, z = (value - middle for value, middle in zip(point, box))
    cosine, sine = math.cos(-box[6]), math.sin(-box[6])
    place = [cosine * x - sine * y, sine * x + cosine * y, z]
    return all(abs(at) < side / 2 + larger for at, side in zip(place, box[3:6]))


class Scene:
    def __init__(self, found):
        with open(found.data, "rb") as file:
            self.images, self.annotations, bounds, self.clouds, unit = pickle.load(file)
        self.fraction = found.train_split_fraction
        assert found.load_pointclouds and not found.remove_nonrigid, "points are random, and people static"
        assert not found.orient_center_poses, "boxes would be tilted"
        assert unit == 1
        self.time()
        low, high = (bounds.tolist()[:3], bounds.tolist()[3:])
        assert len(high) == 3 and all(a < b for a, b in zip(low, high))
        self.scale = 2 / max(b - a for a, b in zip(low, high))
        self.boxes = [self.boxes_of(note) for note in self.annotations]
        self.pixels = {}
        assert any(self.boxes), "object_gaussians is None"
        for image in self.images:
            self.check_image(image, low, high)
            # One without a file would be opened too.
            assert (image.mask_path is None) == (self.images[0].mask_path is None), "masks of all images or of none"
            if found.add_background_points:
                # Whole steps of pixels; their size is divided by this.
                image.height // (max(image.width, image.height) * 0.005 // 2)

    def time(self):
        seconds = [image.timestamp for image in self.images]
        length = max(seconds) - min(seconds)
        for one in [*self.images, *self.annotations]:
            at = one.timestamp / length * 2 - 1
            assert -1.2 <= at <= 1.2, f"Timestamps must be normalized, got {at}."

    def boxes_of(self, note):
        count = len(note.boxes.tolist())
        boxes, ids = rows_of(note.boxes, count, 7), rows_of(note.box_ids, count)
        kinds = rows_of(note.class_ids, count)
        assert note.box_ids.dtype == note.class_ids.dtype == numpy.int64 and set(kinds) <= {0, 1}
        assert len(set(ids)) == count and all(side > 0 for box in boxes for side in box[3:6])
        return [([self.scale * value for value in box[:6]] + box[6:], name) for box, name in zip(boxes, ids)]

    def check_image(self, image, low, high):
        rows = rows_of(image.pose, 4, 4)
        geometry.check_rotation(rows)
        assert rows[3] == [0, 0, 0, 1] and rows[2][1] > 0.5, "the second axis of a camera is up, and so is z"
        assert all(a <= row[3] <= b for a, row, b in zip(low, rows, high))
        width, height, self.pixels[image.image_path] = images.read(image.image_path)
        assert (width, height) == (image.width, image.height)
        if image.mask_path:
            assert images.read(image.mask_path)[:2] == (width, height), "Mask and image have different shapes."

    def split(self, name):
        """Returns the places of the images of a split among all, in its order."""
        moments = sorted({image.frame_id for image in self.images})
        train = kept = every = set(range(len(moments)))
        if self.fraction > 0.5 and self.fraction != 1:
            step = math.floor(1 / (1 - self.fraction))
            kept = set(range(step, len(moments), step))
            train = every - kept
        elif self.fraction <= 0.5:
            train = set(range(0, len(moments), math.floor(1 / self.fraction)))
            kept = every - train
        assert abs(len(train) - math.ceil(self.fraction * len(moments))) <= 1, "Train split is not correct"
        own = {moments[place] for place in (train if name == "train" else kept)}
        # Of the views that are kept apart, it looks for the objects of all others.
        stay = [note for note in self.annotations if (note.frame_id in own) == (name == "train")]
        if not stay:
            raise ValueError("need at least one array to concatenate")
        ids = {one for note in stay for one in note.box_ids.tolist()}
        assert ids == set(range(len(ids))), f"{ids} are not consecutive"
        order = sorted(own)
        return [place for moment in order for place, one in enumerate(self.images) if one.frame_id == moment]

    def check_points(self, train):
        """Refuses clouds that the images of their moment do not show, or whose objects are not in their boxes."""
        counts = {}
        for cloud, note, boxes in zip(self.clouds, self.annotations, self.boxes):
            assert (cloud.sequence_id, cloud.frame_id) == (note.sequence_id, note.frame_id), "corresponding order"
            own = [self.images[place] for place in train if self.images[place].frame_id == cloud.frame_id]
            if not own:
                continue
            coloured = [(point, self.colours(point, own)) for point in self.points(cloud)]
            for box, name in boxes:
                found = count(coloured, box, LARGER / 2 * self.scale)
                counts[name] = [a + b for a, b in zip(counts.get(name, [0] * 4), found)]
        assert sorted(counts) == list(range(len(counts))), "ids must be contiguous starting from 0."
        # Rays of the LiDAR and of the camera part at the edges of what is in front.
        for name, (held, near, others, inside) in counts.items():
            assert inside and held >= 0.97 * near, f"object {name} has {held} of its {near} points in its boxes"
            assert others <= 0.05 * inside, f"object {name} has {others} of {inside} points in its boxes from elsewhere"

    def points(self, cloud):
        columns, count = geometry.columns(Path(cloud.points_path))
        assert columns == [("float", axis) for axis in "xyz"] and count
        _, _, body = Path(cloud.points_path).read_bytes().partition(b"end_header\n")
        return [[self.scale * value for value in point] for point in struct.iter_unpack("<3f", body)]

    def colours(self, point, own):
        """Returns the colours of a point in images that have it in the middle of a pixel; two or more by chance."""
        found, tried = [], []
        for image in own:
            rows = [[*row[:3], self.scale * row[3]] for row in image.pose.tolist()[:3]] + [[0, 0, 0, 1]]
            x, y, z = apply(inverse(product(rows, TURN)), point)
            (fx, _, cx), (_, fy, cy), _ = rows_of(image.intrinsics, 3, 3)
            # The first pixel has its middle at a half.
            column, row = (fx * x / z + cx, fy * y / z + cy) if z > 0 else (-1, -1)
            tried.append((column, row))
            is_seen = 0 <= column < image.width and 0 <= row < image.height
            if is_seen and all(abs(at % 1 - 0.5) < 0.05 for at in (column, row)):
                found.append(self.pixels[image.image_path][int(row)][3 * int(column) : 3 * int(column) + 3])
        assert found, f"{tried} is no middle of a pixel of an image of its moment"
        return found


def count(coloured, box, larger):
    """Returns points of an object's colour in its larger box and around it, and others and all in its own box."""
    within = [in_box(point, box) for point, _ in coloured]
    found = [0, 0, 0, sum(within)]
    first = next((colours[0] for (_, colours), is_in in zip(coloured, within) if is_in), None)
    for (point, colours), is_in in zip(coloured, within) if first else []:
        # Objects of the drive are of one colour each, which nothing else has.
        alike = [max(abs(a - b) for a, b in zip(first, colour)) < 60 for colour in colours]
        found[2] += is_in and not any(alike)
        if all(alike) and math.dist(point, box[:3]) < max(box[3:6]):
            found[0] += in_box(point, box, larger)
            found[1] += 1
    return found
