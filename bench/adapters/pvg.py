"""A perspective scene as a sequence of one camera in the layout in which PVG keeps Waymo, and its views by number.

    OUT/calib/000000.txt ...      five projections and five transforms from LiDAR to camera, all of this one camera
    OUT/pose/000000.txt ...       camera to world, 4 x 4: the camera stands for the vehicle
    OUT/image_0/000000.png ...    the frames
    OUT/sky_0/000000.png ...      black: no sky is known
    OUT/velodyne/000000.bin       x, y, z, 0, 0, 0 in f32, in the vehicle's axes: each frame has its part of the points

Its code holds every n-th frame out, counted from the n-th, and no other split can be stated. Needs nothing but Python.
"""

import argparse
import struct
from pathlib import Path

from scene_files import rotation, write_black

EVERY = 5


def numbers(values):
    return " ".join(repr(float(value)) for value in values)


def prepare(arguments):
    data, out = arguments.data, arguments.out
    model = data / "sparse/0"
    _, kind, *values = (model / "cameras.txt").read_text().split()
    if kind != "PINHOLE":
        raise SystemExit(f"{data} has a camera of type {kind}; five perspective cameras at most can be read")
    width, height, fx, fy, cx, cy = map(float, values)
    images = [line.split(" ", 9) for line in (model / "images.txt").read_text().split("\n")[::2] if line]
    novel = set((data / "test.txt").read_text().split("\n"))
    for number, image in enumerate(images, start=1):
        if (image[9] in novel) != (number % EVERY == 0):
            raise SystemExit(f"{image[9]}: every {EVERY}th posed frame must be a novel view, and no other")
        if not image[9].endswith(".png"):
            raise SystemExit(f"{image[9]} is not a .png")
    points = [line.split()[1:4] for line in (model / "points3D.txt").read_text().split("\n") if line]
    points = [[float(value) for value in point] for point in points]
    for name in ["calib", "pose", "image_0", "sky_0", "velodyne"]:
        (out / name).mkdir(parents=True)
    projection = [fx, 0, cx, 0, 0, fy, cy, 0, 0, 0, 1, 0]
    identity = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
    lines = [f"P{camera}: {numbers(projection)}" for camera in range(5)]
    lines += [f"Tr_velo_to_cam_{camera}: {numbers(identity)}" for camera in range(5)]
    for index, image in enumerate(images):
        name = f"{index:06}"
        turn = rotation(map(float, image[1:5]))
        shift = [float(value) for value in image[5:8]]
        centre = [-sum(turn[k][axis] * shift[k] for k in range(3)) for axis in range(3)]
        rows = [numbers([turn[0][axis], turn[1][axis], turn[2][axis], centre[axis]]) for axis in range(3)]
        (out / f"calib/{name}.txt").write_text("\n".join(lines) + "\n")
        (out / f"pose/{name}.txt").write_text("\n".join([*rows, "0 0 0 1"]) + "\n")
        (out / f"image_0/{name}.png").symlink_to((data / "images" / image[9]).resolve())
        write_black(out / f"sky_0/{name}.png", int(width), int(height))
        own = [
            [sum(turn[row][k] * point[k] for k in range(3)) + shift[row] for row in range(3)]
            for point in points[index :: len(images)]
        ]
        (out / f"velodyne/{name}.bin").write_bytes(b"".join(struct.pack("<6f", *point, 0, 0, 0) for point in own))


def views(arguments):
    """Names views by their order: theirs have the number of the frame times five."""
    found = sorted(arguments.data.glob("*.png"), key=lambda path: int(path.stem))
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
        for option in ["data", "out"]:
            command.add_argument(f"--{option}", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
