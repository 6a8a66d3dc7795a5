"""A scene's frames, objects, poses and distances as a clip of NAG with its configuration, and names of its views.

    OUT/images/00000.png ...          the frames
    OUT/masks/img_00000_ov_0.png ...  at each pixel the number of its object, from 1; objects that overlap in any frame
                                      are in files of their own (ov_1 ...), and every frame has all of these
    OUT/depth/00000.tiff ...          f32: from the image plane, along the ray of the pixel
    OUT/poses.json                    the record of its camera: poses, focal length in widths, principal point
    CONFIG                            its configuration of a clip of DAVIS with the paths and switches of this one

Its camera stands in the middle of the image plane, a focal length ahead of the optical centre. What is nearer than that
plane is not drawn. So the world is scaled: the nearest of what moves is two focal lengths away. The world begins at
the first camera. The outermost pixels have their centres on the edges of the image, at 0 and at the width: focal length
and principal point are those of that grid. Needs nothing but Python.
"""

import argparse
import json
import math
import struct
import zlib
from array import array
from pathlib import Path

from scene_files import distances, grey, rotation, write_grey

MARKED = bytes(128) + b"\1" * 128
# Its flow has a point for every ten frames, and none for five; its planes are placed without the outer 15 pixels.
FEWEST_FRAMES, BORDER = 6, 15
# Its planes are made from frames of at most this longer side, and an object has to have some pixels there.
START_SIDE, LEAST_SIDE = 1080, 3
MOST_OBJECTS = 255
# Share of the known pixels of objects that are nearer than what counts as the nearest.
NEAR = 0.01
# Distance from the image plane of what is nearer than it.
CLOSEST = 1e-3
MOST_PIXELS_OFF = 0.5


def median(values):
    return sorted(values)[len(values) // 2]


def check_frames(frames, data):
    if len(frames) < FEWEST_FRAMES:
        raise SystemExit(f"{data} must have at least {FEWEST_FRAMES} posed frames, got {len(frames)}")
    times = [frame["time_seconds"] for frame in frames]
    gaps = [after - before for before, after in zip(times, times[1:])]
    if min(gaps) <= 0:
        place = gaps.index(min(gaps))
        found = f"{times[place]} and then {times[place + 1]} s"
        raise SystemExit(f"{data} must have one frame at a time, got {found}: of several cameras import one")
    if max(gaps) > 1.5 * min(gaps):
        print(f"frames count as equally spaced; they are {min(gaps):.3g} to {max(gaps):.3g} s apart")
    for frame in frames:
        if not frame.get("depth_prior") and not frame.get("depth"):
            raise SystemExit(
                f"{frame['image']} has no distances, by which objects are placed: omnilife curate attach SCENE "
                "--depth-prior FOLDER --depth-prior-unit UNITS"
            )
    without = sum(not frame.get("depth_prior") for frame in frames)
    if without:
        print(f"{without} of {len(frames)} frames have no depth prior: their true distances are taken")
    if any(frame.get("ignore_mask") for frame in frames):
        print("ignored regions are trained on like all else")


def lens(camera, data):
    """Returns the one focal length and the principal point on its grid, pixels."""
    width, height = camera["width"], camera["height"]
    if min(width, height) <= 2 * BORDER:
        raise SystemExit(f"{data} must have sides of more than {2 * BORDER} pixels, got {width}x{height}")
    across, down = camera["fx"] * width / (width - 1), camera["fy"] * height / (height - 1)
    focal = (width * across + height * down) / (width + height)
    off = max(width * abs(focal / across - 1), height * abs(focal / down - 1)) / 2
    if off > MOST_PIXELS_OFF:
        raise SystemExit(f"{data} must have square pixels: with one focal length its edges are {off:.2f} pixels off")
    if off > 0.01:
        print(f"with one focal length for both axes, the edges of the image are {off:.2f} pixels off")
    middle = [(camera["cx"] - 0.5) * width / (width - 1), (camera["cy"] - 0.5) * height / (height - 1)]
    return focal, middle


def poses(frames, scale, ahead):
    """Returns the matrices of the cameras, from each to the first; their origins lie ahead of the optical centres."""
    turns = [rotation(frame["pose"]["rotation_wxyz"]) for frame in frames]
    places = [
        [scale * value + ahead * row[2] for value, row in zip(frame["pose"]["centre"], turn)]
        for frame, turn in zip(frames, turns)
    ]
    first = list(zip(*turns[0]))
    matrices = []
    for turn, place in zip(turns, places):
        offset = [value - begin for value, begin in zip(place, places[0])]
        columns = [*zip(*turn), offset]
        rows = [[sum(a * b for a, b in zip(row, column)) for column in columns] for row in first]
        matrices.append([*rows, [0.0, 0.0, 0.0, 1.0]])
    return matrices


def boxed(box, camera):
    """Returns the mask of a box: pixels that have their centres in it."""
    sides = []
    for begin, length, end in zip(box[:2], box[2:], (camera["width"], camera["height"])):
        sides.append([min(max(math.ceil(edge - 0.5), 0), end) for edge in (begin, begin + length)])
    (left, right), (top, bottom) = sides
    width = camera["width"]
    line = bytes(left) + b"\1" * (right - left) + bytes(width - right)
    return bytes(top * width) + line * (bottom - top) + bytes((camera["height"] - bottom) * width)


def marked(path, camera):
    """Returns the mask of a file: 1 where it is white."""
    width, height, pixels = grey(path, 8)
    if (width, height) != (camera["width"], camera["height"]):
        raise SystemExit(f"{path} must be of the camera's size, got {width}x{height}")
    return pixels.translate(MARKED)


def as_number(mask):
    return int.from_bytes(mask, "little")


def masks_of(frames, data, camera):
    """Returns the packed masks by frame of each object; without objects what moves is one."""
    if not any(frame.get("objects") or frame.get("boxes") for frame in frames):
        if not any(frame.get("mask") for frame in frames):
            raise SystemExit(f"{data} has no masks, without which it has no objects")
        print("what moves is one object")
        found = [frame.get("mask") and zlib.compress(marked(data / frame["mask"], camera), 1) for frame in frames]
        return {"moving": found}
    found, boxes, outside = {}, 0, 0
    for index, frame in enumerate(frames):
        shapes = {name: boxed(box, camera) for name, box in frame.get("boxes", {}).items()}
        files = frame.get("objects", {})
        boxes += len(shapes.keys() - files.keys())
        shapes |= {name: marked(data / file, camera) for name, file in files.items()}
        together = 0
        for name, mask in shapes.items():
            together |= as_number(mask)
            found.setdefault(name, [None] * len(frames))[index] = zlib.compress(mask, 1)
        if frame.get("mask"):
            outside += bin(as_number(marked(data / frame["mask"], camera)) & ~together).count("1")
    if boxes:
        print(f"{boxes} masks are the boxes of their objects")
    if outside:
        print(f"{outside} pixels that move belong to no object and stay in the background")
    return found


def sides(mask, width):
    """Returns the width and height of a mask's box."""
    if 1 not in mask:
        return 0, 0
    top, bottom = mask.find(1) // width, mask.rfind(1) // width
    columns = 0
    for row in range(top, bottom + 1):
        columns |= as_number(mask[row * width : (row + 1) * width])
    line = columns.to_bytes(width, "little")
    return line.rfind(1) - line.find(1) + 1, bottom - top + 1


def large_enough(masks, camera):
    """Leaves objects out whose largest mask is too small for a plane."""
    least = LEAST_SIDE * max(1, max(camera["width"], camera["height"]) / START_SIDE)
    kept = {}
    for name, packed in masks.items():
        largest = max((zlib.decompress(mask) for mask in packed if mask), key=lambda mask: mask.count(1))
        size = sides(largest, camera["width"])
        if min(size) < least:
            print(f"object {name} is left out: its largest mask is {size[0]}x{size[1]} pixels")
        else:
            kept[name] = packed
    return kept


def grouped(masks, frames):
    """Returns the names of the objects in groups in which none overlaps another in any frame."""
    clashing = set()
    for index in range(frames):
        seen = [(name, as_number(zlib.decompress(of[index]))) for name, of in masks.items() if of[index]]
        for place, (name, mask) in enumerate(seen):
            clashing |= {frozenset((name, other)) for other, its in seen[:place] if mask & its}
    groups = []
    for name in masks:
        free = (group for group in groups if all(frozenset((name, other)) not in clashing for other in group))
        group = next(free, None)
        if group is None:
            groups.append([name])
        else:
            group.append(name)
    return groups


def write_masks(masks, frames, camera, folder):
    """Writes the number of each pixel's object, and returns that of groups."""
    groups = grouped(masks, frames)
    numbers = {name: number for number, name in enumerate(masks, start=1)}
    size = camera["width"] * camera["height"]
    for index in range(frames):
        for place, group in enumerate(groups):
            pixels = 0
            for name in group:
                if masks[name][index]:
                    pixels |= as_number(zlib.decompress(masks[name][index])) * numbers[name]
            file = folder / f"img_{index:05}_ov_{place}.png"
            write_grey(file, camera["width"], camera["height"], pixels.to_bytes(size, "little"))
    return len(groups)


class Depths:
    """Distances of the frames along the optical axis, and those that objects have in them."""

    def __init__(self, frames, data, camera):
        self.sources = [frame.get("depth_prior") or frame["depth"] for frame in frames]
        self.data, self.camera, self.rays = data, camera, {}

    def lengths(self, size):
        """Returns the lengths of the rays of all pixels of such an image, up to a distance of 1 along the axis."""
        if size not in self.rays:
            (width, height), camera = size, self.camera
            step, rise = camera["width"] / width, camera["height"] / height
            across = [((column + 0.5) * step - camera["cx"]) / camera["fx"] for column in range(width)]
            down = [((row + 0.5) * rise - camera["cy"]) / camera["fy"] for row in range(height)]
            self.rays[size] = [math.sqrt(x * x + y * y + 1) for y in down for x in across]
        return self.rays[size]

    def read(self, index):
        """Returns the size of a frame's distances, and their values along the axis; 0 where none is known."""
        source = self.sources[index]
        width, height, values = distances(self.data / source["file"])
        unit = source["unit"]
        if source.get("convention", "ray") == "z":
            return (width, height), [value * unit for value in values]
        return (width, height), [value * unit / ray for value, ray in zip(values, self.lengths((width, height)))]

    def within(self, packed, size):
        """Returns the pixels of such an image that a mask marks."""
        mask, (width, height), camera = zlib.decompress(packed), size, self.camera
        if size != (camera["width"], camera["height"]):
            columns = [int((column + 0.5) / width * camera["width"]) for column in range(width)]
            starts = [int((row + 0.5) / height * camera["height"]) * camera["width"] for row in range(height)]
            mask = [mask[start + column] for start in starts for column in columns]
        return [place for place, value in enumerate(mask) if value]

    def survey(self, masks):
        """Returns the median of each object in each frame, or nothing, and the nearest distance of all."""
        medians, samples = {name: [None] * len(self.sources) for name in masks}, []
        for index in range(len(self.sources)):
            size, values = self.read(index)
            for name, packed in masks.items():
                places = self.within(packed[index], size) if packed[index] else []
                known = sorted(values[place] for place in places if values[place])
                if known:
                    medians[name][index] = known[len(known) // 2]
                    samples += known[:: max(1, len(known) // 1000)]
        samples.sort()
        return medians, samples[int(NEAR * len(samples))] if samples else None

    def write(self, masks, medians, scale, ahead, folder):
        """Writes distances from the image plane along the rays, filled where none is known."""
        filled = moved = 0
        for index in range(len(self.sources)):
            size, values = self.read(index)
            known = [value for value in values if value]
            rest, objects = median(known) if known else 1.0, set()
            for name, packed in masks.items():
                places = self.within(packed[index], size) if packed[index] else []
                own = medians[name][index] or median([value for value in medians[name] if value])
                objects.update(places)
                filled += sum(not values[place] for place in places)
                for place in places:
                    values[place] = values[place] or own
            rays = self.lengths(size)
            values = [(scale * (value or rest) - ahead) * ray for value, ray in zip(values, rays)]
            moved += sum(values[place] < CLOSEST for place in objects)
            write_tiff(folder / f"{index:05}.tiff", *size, array("f", [max(value, CLOSEST) for value in values]))
        if filled:
            print(f"{filled} pixels of objects have no known distance, and get the median of their object")
        if moved:
            print(f"{moved} pixels of objects are nearer than its image plane, and are moved behind it")


def write_tiff(path, width, height, values):
    """Writes f32 values as an uncompressed TIFF of one strip."""
    entries = [(256, 4, width), (257, 4, height), (258, 3, 32), (259, 3, 1), (262, 3, 1), (273, 4, 0), (277, 3, 1)]
    entries += [(278, 4, height), (279, 4, 4 * len(values)), (339, 3, 3)]
    begin = 8 + 2 + 12 * len(entries) + 4
    head = struct.pack("<2sHIH", b"II", 42, 8, len(entries))
    for tag, kind, value in entries:
        head += struct.pack("<HHII", tag, kind, 1, begin if tag == 273 else value)
    path.write_bytes(head + bytes(4) + struct.pack(f"<{len(values)}f", *values))


def configured(path, values):
    """Returns the text of a configuration with some of its values replaced."""
    kept, found, is_replaced = [], [], False
    for line in path.read_text().splitlines():
        key = line[2:].split(":")[0]
        if line.startswith("  ") and line[2:3] not in (" ", "-", "#", ""):
            is_replaced = key in values
            if is_replaced:
                found.append(key)
                kept.append(f"  {key}: {json.dumps(values[key])}")
        elif not line.startswith("  "):
            is_replaced = False
        if not is_replaced:
            kept.append(line)
    for key in values:
        if found.count(key) != 1:
            raise SystemExit(f"{path} must have {key} once, got {found.count(key)}: it is of another version")
    return "\n".join(kept) + "\n"


def write_images(frames, data, folder):
    for index, frame in enumerate(frames):
        suffix = Path(frame["image"]).suffix.lower()
        if suffix not in (".png", ".jpg", ".jpeg"):
            raise SystemExit(f"{frame['image']} must be a .png or .jpg")
        (folder / f"{index:05}{suffix}").symlink_to((data / frame["image"]).resolve())


def prepare(arguments):
    data, out = arguments.data, arguments.out
    scene = json.loads((data / "scene.json").read_text())
    camera = scene["camera"]
    if camera["model"] != "pinhole":
        raise SystemExit(f"{data} must have perspective frames, got {camera['model']}")
    frames = [frame for frame in scene["frames"] if frame.get("pose")]
    check_frames(frames, data)
    focal, middle = lens(camera, data)
    masks = large_enough(masks_of(frames, data, camera), camera)
    depths = Depths(frames, data, camera)
    medians, near = depths.survey(masks)
    for name in [name for name in masks if not any(medians[name])]:
        print(f"object {name} is left out: no distance is known where it is")
        del masks[name]
    if not 0 < len(masks) <= MOST_OBJECTS:
        raise SystemExit(f"{data} must have 1 to {MOST_OBJECTS} objects with masks and distances, got {len(masks)}")
    ahead = focal / camera["width"]
    scale = 2 * ahead / near
    for name in ("images", "masks", "depth"):
        (out / name).mkdir(parents=True)
    write_images(frames, data, out / "images")
    groups = write_masks(masks, len(frames), camera, out / "masks")
    depths.write(masks, medians, scale, ahead, out / "depth")
    record = {
        "__class__": "nag.config.pinhole_camera_config.PinholeCameraConfig",
        "resolution": [camera["width"], camera["height"]],
        "focal_length": ahead,
        "principal_point": middle,
        "times": [index / (len(frames) - 1) for index in range(len(frames))],
        "position": poses(frames, scale, ahead),
    }
    (out / "poses.json").write_text(json.dumps(record))
    values = {
        "data_path": str(out.resolve()),
        "output_path": str(arguments.model.resolve()),
        "pinhole_camera_config": "{data_path}/poses.json",
        "name": "scene",
        "seed": arguments.seed,
        "normalize_camera": False,
        "max_image_size": None,
        "env_file": None,
        "experiment_logger": "tensorboard",
        "final_evaluation_metrics": [],
        "final_mask_evaluation_metrics": [],
    }
    arguments.config.write_text(configured(arguments.code / "config/davis/blackswan.yaml", values))
    print(f"frames: {len(frames)}, objects: {len(masks)}, groups of masks: {groups}, scale of the world: {scale:.6g}")


def views(arguments):
    """Names views by their order: theirs have as many digits as the last one needs."""
    found = sorted(arguments.data.glob("*_t.png"), key=lambda path: int(path.stem[:-2]))
    if not found:
        raise SystemExit(f"{arguments.data} has no views")
    arguments.out.mkdir()
    for index, view in enumerate(found):
        (arguments.out / f"{index:05}.png").symlink_to(view.resolve())


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    for name, run in [("prepare", prepare), ("views", views)]:
        command = commands.add_parser(name)
        command.set_defaults(run=run)
        for option in ["data", "out"] + ["code", "model", "config"] * (run is prepare):
            command.add_argument(f"--{option}", type=Path, required=True)
        if run is prepare:
            command.add_argument("--seed", type=int, default=42)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
