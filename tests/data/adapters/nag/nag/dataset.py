"""The clip: images, masks and depths by the index in their names."""

import math
import re
import struct

import images


def indexed(folder, pattern):
    """Returns the files by the numbers in their names."""
    found = {}
    for file in folder.iterdir():
        match = re.search(pattern, file.name)
        if match:
            numbers = {key: int(value) for key, value in match.groupdict().items()}
            found[numbers["index"], numbers.get("ov_index", 0)] = file
    return found


def read_tiff(path):
    """Returns width, height and values of an uncompressed TIFF of one channel of f32."""
    data = path.read_bytes()
    mark, number, place = struct.unpack("<2sHI", data[:8])
    assert (mark, number) == (b"II", 42), path
    (count,) = struct.unpack("<H", data[place : place + 2])
    tags = {}
    for entry in range(count):
        begin = place + 2 + 12 * entry
        tag, kind, values, _ = struct.unpack("<HHII", data[begin : begin + 12])
        assert values == 1 and (not tags or tag > max(tags)), "tags rise"
        tags[tag] = struct.unpack("<H" if kind == 3 else "<I", data[begin + 8 : begin + (10 if kind == 3 else 12)])[0]
    assert (tags[258], tags[259], tags[277], tags[339]) == (32, 1, 1, 3), f"{path} is no image of floats"
    width, height = tags[256], tags[257]
    assert tags[278] == height and tags[279] == 4 * width * height
    return width, height, struct.unpack(f"<{width * height}f", data[tags[273] : tags[273] + tags[279]])


class Clip:
    def __init__(self, values):
        self.images = indexed(values["images_path"], values["images_filename_pattern"])
        masks = indexed(values["masks_path"], values["masks_filename_pattern"])
        depths = indexed(values["depths_path"], values["depths_filename_pattern"])
        assert self.images and masks and depths, "No images, masks or depth images found"
        indices = sorted({index for files in (self.images, masks, depths) for index, _ in files})
        groups = sorted({group for _, group in masks})
        for index in indices:
            assert (index, 0) in self.images and (index, 0) in depths, f"Frame contains NA values: {index}"
            # One of its versions fails here by a name that is not defined, others allow it.
            assert all((index, group) in masks for group in groups), f"frame {index} lacks a mask"
        assert len(indices) > 1 and indices == list(range(indices[0], indices[0] + len(indices)))
        self.files = [self.images[index, 0] for index in indices]
        self.size = images.read(self.files[0])[:2]
        limit = values["max_image_size"]
        assert limit is None or limit >= max(self.size), "'int' object is not iterable"
        self.depths = [self.depth(depths[index, 0]) for index in indices]
        self.masks = {}
        for place, index in enumerate(indices):
            for group in groups:
                self.add(place, masks[index, group], group)
        assert self.masks, "no object"

    def depth(self, path):
        width, height, values = read_tiff(path)
        assert all(map(math.isfinite, values)), path
        return width, height, values

    def add(self, place, path, group):
        """Adds the pixels of a file to those of their objects."""
        width, height, rows = images.read(path)
        assert (width, height) == self.size, path
        values = b"".join(row[::3] for row in rows)
        for number in set(values) - {0}:
            of_group, frames = self.masks.setdefault(number, (group, {}))
            assert of_group == group, f"object {number} is in two groups"
            frames[place] = [index for index, value in enumerate(values) if value == number]
