#!/usr/bin/env python3
"""Counts how often given poses are called contradicted by their panoramas, as they are and written by mistake.

    OMNILIFE=PROGRAM given_poses.py SEQUENCE...

A SEQUENCE is a posed folder of a data set. Its poses are given anew as they are, and in every variant below, to a copy
of the folder, by `omnilife curate poses`. Prints for each the share of agreeing pairs, and the line on the poses where
there is one.
"""

import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

PROGRAM = os.environ["OMNILIFE"]
CONTRADICTED = "the images contradict the poses"


def matrix(pose):
    w, x, y, z = pose["rotation_wxyz"]
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def quaternion(m):
    """Shepperd's method."""
    trace = m[0][0] + m[1][1] + m[2][2]
    diagonal = [trace, m[0][0], m[1][1], m[2][2]]
    largest = diagonal.index(max(diagonal))
    if largest == 0:
        q = [1 + trace, m[2][1] - m[1][2], m[0][2] - m[2][0], m[1][0] - m[0][1]]
    else:
        i = largest - 1
        j, k = (i + 1) % 3, (i + 2) % 3
        q = [m[k][j] - m[j][k], 0, 0, 0]
        q[1 + i] = 1 + 2 * m[i][i] - trace
        q[1 + j] = m[i][j] + m[j][i]
        q[1 + k] = m[i][k] + m[k][i]
    length = sum(value * value for value in q) ** 0.5
    return [value / length for value in q]


def product(a, b):
    return [[sum(a[i][k] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]


def apply(m, v):
    return [sum(m[i][k] * v[k] for k in range(3)) for i in range(3)]


def diagonal(*values):
    return [[values[i] if i == j else 0 for j in range(3)] for i in range(3)]


def pose(rotation, centre):
    return {"rotation_wxyz": quaternion(rotation), "centre": centre}


def inverted(one):
    back = [list(row) for row in zip(*matrix(one))]
    return pose(back, [-value for value in apply(back, one["centre"])])


def in_axes(*signs):
    return lambda one: pose(product(matrix(one), diagonal(*signs)), one["centre"])


def z_up(one):
    """The camera's axes are right, forward and up."""
    return pose(product(matrix(one), [[1, 0, 0], [0, 0, -1], [0, 1, 0]]), one["centre"])


def mirrored(one):
    mirror = diagonal(-1, 1, 1)
    return pose(product(product(mirror, matrix(one)), mirror), apply(mirror, one["centre"]))


def each(change):
    return lambda poses: [one and change(one) for one in poses]


def shuffled(poses):
    poses = poses[:]
    random.Random(0).shuffle(poses)
    return poses


VARIANTS = {
    "as they are": each(lambda one: one),
    "other units": each(lambda one: pose(matrix(one), [37 * value for value in one["centre"]])),
    "inverted": each(inverted),
    "y and z reversed": each(in_axes(1, -1, -1)),
    "half a turn": each(in_axes(-1, 1, -1)),
    "upside down": each(in_axes(-1, -1, 1)),
    "z up": each(z_up),
    "mirrored": each(mirrored),
    "inverted, y and z reversed": each(lambda one: inverted(in_axes(1, -1, -1)(one))),
    "last frame first": lambda poses: poses[::-1],
    "shuffled": shuffled,
    "three frames late": lambda poses: poses[:3] + poses[:-3],
}


def validation(sequence, scene, poses):
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "video" / sequence.name
        copy.mkdir(parents=True)
        shutil.copy(sequence / "sequence.json", copy)
        shutil.copytree(sequence / "frames", copy / "frames")
        frames = [
            {"time_seconds": frame["time_seconds"], "pose": one}
            for frame, one in zip(scene["frames"], poses)
            if one is not None
        ]
        record = {"schema": "omnilife/poses/1", "frames": frames, "scale": scene["scale"]}
        file = Path(folder) / "given.json"
        file.write_text(json.dumps(record))
        words = [PROGRAM, "--quiet", "curate", "poses", str(copy), "--poses", str(file)]
        ended = subprocess.run(words, capture_output=True, text=True)
        if ended.returncode:
            sys.exit(f"{sequence}: {ended.stderr}")
        return json.loads((copy / "scene.json").read_text())["validation"]


def main():
    for sequence in map(Path, sys.argv[1:]):
        scene = json.loads((sequence / "scene.json").read_text())
        poses = [frame["pose"] for frame in scene["frames"]]
        for name, change in VARIANTS.items():
            found = validation(sequence.resolve(), scene, change(poses))
            share = found["measures"].get("agreeing_pairs_share")
            lines = [line for line in found["problems"] if CONTRADICTED in line]
            told = lines[0].split(": ", 1)[1] if lines else "-"
            print(f"{scene['id']:28} {name:28} {'not told' if share is None else f'{share:.2f}':9} {told}", flush=True)


if __name__ == "__main__":
    main()
