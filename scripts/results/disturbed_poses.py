#!/usr/bin/env python3
"""Makes a posed sequence whose poses are wrong from one whose poses are right.

    scripts/results/disturbed_poses.py SEQ OUT --degrees 0.3 --shift 0.02 [--smooth 8]

SEQ is the folder of a posed sequence (scene.json); OUT gets a scene.json with other poses beside
links to the same images, masks and points. Every frame is turned by a random rotation vector of the
given root mean square angle and moved by a random vector of the given root mean square length (world
units). With --smooth the errors are averaged over so many frames on both sides, and brought to the
same size again: a drift instead of a jitter. With --split only the input views of the split are
disturbed. The same seed gives the same errors, scaled.
"""

import argparse
import json
import os
from pathlib import Path

import numpy as np


def product(a, b):
    """Of two quaternions (w, x, y, z)."""
    w, v, s, u = a[0], a[1:], b[0], b[1:]
    return np.concatenate([[w * s - v @ u], w * u + s * v + np.cross(v, u)])


def quaternion(vector):
    """Of a rotation vector in radians."""
    angle = np.linalg.norm(vector)
    axis = vector / angle if angle > 0 else vector
    return np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])


def errors(random, frames, smooth):
    """One vector per frame, of root mean square length 1 and mean 0."""
    values = random.normal(size=(frames, 3))
    if smooth:
        window = np.exp(-0.5 * (np.arange(-3 * smooth, 3 * smooth + 1) / smooth) ** 2)
        padded = np.pad(values, ((3 * smooth,) * 2, (0, 0)), mode="reflect" if frames > 3 * smooth else "wrap")
        values = np.stack([np.convolve(padded[:, k], window, "valid") for k in range(3)], axis=1)
    values -= values.mean(axis=0)
    return values / np.sqrt((values**2).sum(axis=1).mean())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("sequence", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--degrees", type=float, default=0.0)
    parser.add_argument("--shift", type=float, default=0.0)
    parser.add_argument("--smooth", type=int, default=0)
    parser.add_argument("--split", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()

    scene = json.loads((options.sequence / "scene.json").read_text())
    random = np.random.default_rng(options.seed)
    frames = scene["frames"]
    turns = np.radians(options.degrees) * errors(random, len(frames), options.smooth)
    shifts = options.shift * errors(random, len(frames), options.smooth)
    disturbed = range(len(frames))
    if options.split:
        disturbed = json.loads(options.split.read_text())["input_views"]
    for number in disturbed:
        pose = frames[number]["pose"]
        turned = product(quaternion(turns[number]), np.array(pose["rotation_wxyz"]))
        pose["rotation_wxyz"] = (turned / np.linalg.norm(turned)).tolist()
        pose["centre"] = (np.array(pose["centre"]) + shifts[number]).tolist()
    options.out.mkdir(parents=True, exist_ok=True)
    for entry in options.sequence.iterdir():
        link = options.out / entry.name
        if entry.name not in ("scene.json", ".done") and not link.is_symlink():
            os.symlink(entry.resolve(), link)
    (options.out / "scene.json").write_text(json.dumps(scene, indent=2) + "\n")


if __name__ == "__main__":
    main()
