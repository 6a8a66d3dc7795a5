#!/usr/bin/env python3
"""Writes Gaussians in time by docs/reference/gaussians-in-time.md alone, with the standard library.

    gaussians_in_time.py OUT.gtime [COUNT]

The small scene (no COUNT) has each motion and type once: the file that the reader's tests read is
reconstruct/training/src/formats/in_time/peer/peer.gtime. With a COUNT it is a scene for the player: a ground at rest,
a fountain, pulsing lights and two boxes that drive around.
"""

import argparse
import gzip
import json
import math
import random
import struct

C0 = 0.28209479177387814
ORDER = {"u8": 1, "u16": 2, "u24": 3}


def array(name, rows, kind, to="linear"):
    """Returns the header and the bytes of rows of equal width."""
    width = len(rows[0])
    header = {"name": name, "width": width, "type": kind}
    if kind == "f32":
        return header, b"".join(struct.pack(f"<{width}f", *row) for row in rows)
    if to == "exp":
        header["map"] = "exp"
        rows = [[math.log(value) for value in row] for row in rows]
    columns = list(zip(*rows))
    low, high = [min(column) for column in columns], [max(column) for column in columns]
    most = 256 ** ORDER[kind] - 1
    data = bytearray()
    for row in rows:
        for value, least, largest in zip(row, low, high):
            share = (value - least) / (largest - least) if largest > least else 0
            data += round(share * most).to_bytes(ORDER[kind], "little")
    return {**header, "low": low, "high": high}, bytes(data)


def part(motion, gaussians, kinds=("u24", "u16", "u16", "u8", "u16"), further=()):
    """Returns a part of (position, size, rotation, opacity, rgb) and further (name, rows, type, map)."""
    position, size, rotation, opacity, rgb = zip(*gaussians)
    colour = [[(value - 0.5) / C0 for value in row] for row in rgb]
    arrays = [
        array("position", position, kinds[0]),
        array("size", size, kinds[1], "exp"),
        array("rotation", rotation, kinds[2]),
        array("opacity", [[value] for value in opacity], kinds[3]),
        array("colour", colour, kinds[4]),
    ]
    arrays += [array(*entry) for entry in further]
    header = {"count": len(gaussians), "motion": motion, "arrays": [each for each, _ in arrays]}
    return header, b"".join(data for _, data in arrays)


def write(path, parts, seconds, degree=0):
    header = {
        "format": "gaussians-in-time",
        "version": 1,
        "generator": "gaussians_in_time.py",
        "units": {"length": "metre", "time": "second"},
        "frame": {"up": [0, -1, 0], "origin": [10, 20, 30], "scale": 2, "rotation": [1, 0, 0, 0]},
        "time": {"begin": 5, "seconds": seconds, "frames": None},
        "degree": degree,
        "parts": [each for each, _ in parts],
    }
    text = json.dumps(header).encode()
    with open(path, "wb") as file:
        file.write(b"GAUSTIME" + struct.pack("<I", len(text)) + text)
        file.write(gzip.compress(b"".join(data for _, data in parts), 6, mtime=0))


def turn(x, y, z, degrees):
    half = math.radians(degrees) / 2
    return [math.cos(half), *(math.sin(half) * axis for axis in (x, y, z))]


def track(number, points, seconds, turns):
    """Returns an object on straight lines between points at equal times."""
    positions = [points[0]]
    for begin, end in zip(points, points[1:]):
        positions += [[a + (b - a) * k / 3 for a, b in zip(begin, end)] for k in (1, 2, 3)]
    times = [seconds * k / (len(points) - 1) for k in range(len(points))]
    return {"id": number, "times": times, "positions": positions, "rotations": turns}


def small():
    still = [([1, 0, 3], [0.5, 0.25, 0.125], [1, 0, 0, 0], 0.75, [1, 0, 0]), ([-1, 0.5, 4], [0.1, 0.1, 0.1], [0, 0, 1, 0], 1, [0, 1, 0])]
    harmonics = [[0.01 * (k - 4) for k in range(9)], [0.02 * (k - 4) for k in range(9)]]
    moving = [([0, 0, 5], [0.5, 0.5, 0.5], [0.6, 0.8, 0, 0], 0.5, [0, 0, 1])]
    in_time = lambda v, p, s: [("velocity", [v], "f32"), ("peak", [[p]], "f32"), ("duration", [[s]], "f32")]
    objects = [track(3, [[0, 0, 2], [3, 0, 2]], 4, [[1, 0, 0, 0], turn(0, 1, 0, 90)])]
    floats = ("f32",) * 5
    return [
        part({"kind": "static"}, still, further=[("harmonics", harmonics, "f32"), ("unknown", [[1], [2]], "u8")]),
        part({"kind": "linear"}, moving, floats, in_time([1, 0, -0.5], 2, 1)),
        part({"kind": "periodic", "cycle": 2, "least": 0.05}, moving, floats, in_time([0, 1, 0], 1, 0.5)),
        part({"kind": "rigid", "objects": objects}, [([0.5, 0, 0], *moving[0][1:])], floats, [("object", [[0]], "u8")]),
    ]


def large(count):
    draw = random.Random(1)
    around = lambda size: draw.uniform(-size, size)
    round_one = [1, 0, 0, 0]
    share = count // 4
    ground, fountain, lights, boxes = [], [], [], []
    for _ in range(share):
        x, z = around(12), around(12)
        grey = 0.25 + 0.12 * ((math.floor(x) + math.floor(z)) % 2) + around(0.03)
        ground.append(([x, 1.6, z], [0.05, 0.012, 0.05], round_one, 0.9, [grey, grey + 0.05, grey * 0.9]))
    velocities, peaks, lasting = [], [], []
    for _ in range(share):
        angle, speed = around(math.pi), draw.uniform(0.2, 1)
        velocities.append([speed * math.cos(angle), -draw.uniform(0.6, 1.4), speed * math.sin(angle)])
        peaks.append([draw.uniform(-0.5, 8.5)])
        lasting.append([draw.uniform(0.3, 0.7)])
        fountain.append(([around(0.05), 0.4 + around(0.1), 5 + around(0.05)], [0.02] * 3, round_one, 0.8, [0.3, 0.6 + around(0.2), 1]))
    swings, times = [], []
    for _ in range(share):
        angle, height = around(math.pi), around(1.2)
        swings.append([0.6 * math.sin(3 * angle), 0.5, 0.6 * math.cos(3 * angle)])
        times.append([draw.uniform(0, 8)])
        lights.append(([6 * math.sin(angle), height - 0.5, 6 * math.cos(angle)], [0.03, 0.03, 0.03], round_one, 0.7, [1, 0.5 + 0.4 * math.sin(angle), 0.2]))
    numbers = []
    for index in range(count - 3 * share):
        face, sign = draw.randrange(3), draw.choice((-1, 1))
        place = [around(0.8), around(0.4), around(0.5)]
        place[face] = sign * (0.8, 0.4, 0.5)[face]
        size = [0.03, 0.03, 0.03]
        size[face] = 0.006
        shade = 0.55 + 0.2 * face
        colour = [0.9 * shade, 0.15, 0.1] if index % 2 else [0.1, 0.6 * shade, 0.2]
        boxes.append((place, size, turn(0, 0, 1, 0), 0.95, colour))
        numbers.append([index % 2])
    ring = lambda radius, begin: [[radius * math.sin(begin + k * math.pi / 4), 1.2, radius * math.cos(begin + k * math.pi / 4)] for k in range(9)]
    heading = lambda begin: [turn(0, 1, 0, math.degrees(begin) + 45 * k) for k in range(9)]
    objects = [track(0, ring(4, 0), 8, heading(0.39)), track(1, ring(8, 1), 8, heading(1.39))]
    return [
        part({"kind": "static"}, ground),
        part({"kind": "linear"}, fountain, further=[("velocity", velocities, "u16"), ("peak", peaks, "u24"), ("duration", lasting, "u16", "exp")]),
        part({"kind": "periodic", "cycle": 4}, lights, further=[("velocity", swings, "u16"), ("peak", times, "u24")]),
        part({"kind": "rigid", "objects": objects}, boxes, further=[("object", numbers, "u8")]),
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", metavar="OUT.gtime")
    parser.add_argument("count", metavar="COUNT", nargs="?", type=int)
    arguments = parser.parse_args()
    if arguments.count is not None:
        write(arguments.out, large(arguments.count), 8)
    else:
        write(arguments.out, small(), 4, degree=1)
