"""Another program's reading of a `.splat` of ours, or its conversion of the PLY that it was made of.

usage: read_splats.py ply2splat OURS.splat SCENE.ply
       read_splats.py splat-transform OURS.splat PROGRAM
       read_splats.py alike SCENE.ply OTHER.ply [DEGREES]

`ply2splat` (PyPI) converts the PLY, whose Gaussians the export did not have to change: as many rows, the same
positions up to rounding, sizes, and bytes up to one. `splat-transform` (npm, @playcanvas/splat-transform) converts
ours to a PLY: the same order and positions, logarithms of sizes, colours, and rotations up to a degree. `alike`
compares two PLYs in any order, up to what formats round and to a turn of DEGREES. Prints a line; ends with 3 where the program is missing.
"""

import math
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

ROW = struct.Struct("<6f8B")
C0 = 0.28209479177387814


def rows_of(path):
    return list(ROW.iter_unpack(Path(path).read_bytes()))


def check(condition, text):
    if not condition:
        sys.exit(f"read_splats: {text}")


def near(a, b, tolerance):
    return abs(a - b) <= tolerance * max(1.0, abs(b))


def turned(row):
    """The rotation of a row, with w not negative: a quaternion and its opposite are one rotation."""
    values = [(byte - 128) / 128 for byte in row[10:14]]
    length = math.sqrt(sum(value * value for value in values)) or 1.0
    sign = -1 if values[0] < 0 else 1
    return [sign * value / length for value in values]


def by_ply2splat(ours, ply):
    try:
        import ply2splat
    except ImportError:
        sys.exit(3)
    with tempfile.TemporaryDirectory() as folder:
        theirs = Path(folder) / "theirs.splat"
        ply2splat.convert(str(ply), str(theirs))
        # Rows of one weight may stand in another order.
        expected = sorted(rows_of(theirs))
    found = sorted(rows_of(ours))
    check(len(found) == len(expected), f"{len(found)} rows, ply2splat has {len(expected)}")
    for number, (own, other) in enumerate(zip(found, expected)):
        check(own[:3] == other[:3], f"row {number}: position {own[:3]}, ply2splat has {other[:3]}")
        check(all(near(a, b, 1e-6) for a, b in zip(own[3:6], other[3:6])), f"row {number}: sizes {own[3:6]} {other[3:6]}")
        check(all(abs(a - b) <= 1 for a, b in zip(own[6:], other[6:])), f"row {number}: bytes {own[6:]} {other[6:]}")
    print(f"ply2splat: {len(found)} rows alike")


def ply_of(path):
    head, body = Path(path).read_bytes().split(b"end_header\n", 1)
    names = [line.split()[2] for line in head.decode().splitlines() if line.startswith("property")]
    count = next(int(line.split()[2]) for line in head.decode().splitlines() if line.startswith("element vertex"))
    values = struct.unpack(f"<{count * len(names)}f", body[:4 * count * len(names)])
    return [dict(zip(names, values[row * len(names):(row + 1) * len(names)])) for row in range(count)]


def by_splat_transform(ours, program):
    with tempfile.TemporaryDirectory() as folder:
        theirs = Path(folder) / "theirs.ply"
        ran = subprocess.run([program, str(ours), str(theirs)], capture_output=True, text=True)
        check(ran.returncode == 0, f"{program}: {ran.stderr or ran.stdout}")
        expected = ply_of(theirs)
    found = rows_of(ours)
    check(len(found) == len(expected), f"{len(found)} rows, splat-transform has {len(expected)}")
    for number, (own, other) in enumerate(zip(found, expected)):
        place = (other["x"], other["y"], other["z"])
        check(own[:3] == place, f"row {number}: position {own[:3]}, splat-transform has {place}")
        for axis in range(3):
            check(near(math.log(own[3 + axis]), other[f"scale_{axis}"], 1e-5), f"row {number}: size of axis {axis}")
            colour = 255 * (0.5 + C0 * other[f"f_dc_{axis}"])
            check(abs(own[6 + axis] - colour) < 0.01, f"row {number}: colour {own[6 + axis]} {colour}")
        rotation = [other[f"rot_{axis}"] for axis in range(4)]
        length = math.sqrt(sum(value * value for value in rotation))
        along = abs(sum(a * b / length for a, b in zip(turned(own), rotation)))
        degrees = 2 * math.degrees(math.acos(min(along, 1.0)))
        check(degrees < 1.0, f"row {number}: turned by {degrees} degrees")
    print(f"splat-transform: {len(found)} rows alike")


# What values of a PLY may differ by.
ROUNDED = {"x": 0.02, "y": 0.02, "z": 0.02, "f_dc": 0.0135, "f_rest": 0.067, "opacity": 0.0021, "scale": 0.032}


def alike(scene, other, most_degrees="0.4"):
    expected, found = ply_of(scene), ply_of(other)
    check(len(found) == len(expected), f"{len(found)} Gaussians in place of {len(expected)}")
    for number, own in enumerate(expected):
        nearest = min(found, key=lambda row: sum((row[axis] - own[axis]) ** 2 for axis in "xyz"))
        found.remove(nearest)
        for name, value in own.items():
            kind = name.rsplit("_", 1)[0]
            if kind not in ROUNDED:
                continue
            pair = (value, nearest[name])
            if kind == "opacity":
                pair = tuple(1 / (1 + math.exp(-logit)) for logit in pair)
            check(abs(pair[0] - pair[1]) <= ROUNDED[kind], f"Gaussian {number}: {name} {pair}")
        turns = [[row[f"rot_{axis}"] for axis in range(4)] for row in (own, nearest)]
        lengths = [math.sqrt(sum(part * part for part in turn)) for turn in turns]
        w, x, y, z = turns[1]
        # A half turn about an axis of its own changes no Gaussian.
        same = [(w, x, y, z), (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w)]
        along = max(abs(sum(a * b for a, b in zip(turns[0], turn))) for turn in same) / (lengths[0] * lengths[1])
        degrees = 2 * math.degrees(math.acos(min(along, 1.0)))
        check(degrees < float(most_degrees), f"Gaussian {number}: turned by {degrees} degrees")
    print(f"{other}: {len(expected)} Gaussians alike")


if __name__ == "__main__":
    if sys.argv[1] == "ply2splat":
        by_ply2splat(*sys.argv[2:])
    elif sys.argv[1] == "alike":
        alike(*sys.argv[2:])
    else:
        by_splat_transform(*sys.argv[2:])
