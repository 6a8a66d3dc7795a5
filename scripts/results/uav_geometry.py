#!/usr/bin/env python3
"""Compares stereo and structure from motion of a rendered flight with its true geometry.

  uav_geometry.py dense RENDERING DENSE      distances of `omnilife curate dense`
  uav_geometry.py poses RENDERING SCENE      poses of a scene.json, after its world is brought to the true one

RENDERING holds tracks.json and depth/NNNN.png as uav_scene.py takes them. Prints JSON. Needs NumPy and
Pillow.
"""

import argparse
import json
from pathlib import Path

import numpy as np
from PIL import Image


def dense(rendering, folder):
    """Shares of the pixels that see something: known, within 1 % of the truth; of those known, off by 5 %."""
    record = json.loads((folder / "dense.json").read_text())
    scale = json.loads((rendering / "tracks.json").read_text())["depth_scale"]
    seen = known = close = wrong = 0
    for frame in record["frames"]:
        found = np.load(folder / frame["distances"])
        truth = Image.open(rendering / f"depth/{frame['frame']:04}.png")
        truth = np.asarray(truth.resize(found.shape[::-1], Image.NEAREST), float) / scale
        there = truth > 0
        kept = there & (found > 0)
        error = np.abs(found / np.where(there, truth, 1) - 1)
        seen, known = seen + there.sum(), known + kept.sum()
        close, wrong = close + (kept & (error < 0.01)).sum(), wrong + (kept & (error > 0.05)).sum()
    return {"frames": len(record["frames"]), "known": known / seen, "within_1_percent": close / seen,
            "wrong_of_known": wrong / known, "points": record["point_count"]}


def rotation(wxyz):
    w, x, y, z = wxyz
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


def poses(rendering, file):
    """Errors after the world is turned by rotations, then moved and scaled by centres: centres of a straight
    flight say nothing of the roll about it."""
    scene, truth = (json.loads(path.read_text()) for path in (file, rendering / "tracks.json"))
    times = np.array([frame["time"] for frame in truth["frames"]])
    posed = [frame for frame in scene["frames"] if frame["pose"]]
    exact = [np.array(truth["frames"][np.abs(times - frame["time_seconds"]).argmin()]["c2w"]) for frame in posed]
    found = [rotation(frame["pose"]["rotation_wxyz"]) for frame in posed]
    sum_of_turns = sum(true[:3, :3] @ own.T for own, true in zip(found, exact))
    u, _, vt = np.linalg.svd(sum_of_turns)
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    cosines = [(np.trace(true[:3, :3].T @ turn @ own) - 1) / 2 for own, true in zip(found, exact)]
    degrees = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    own = np.array([frame["pose"]["centre"] for frame in posed])
    true = np.array([matrix[:3, 3] for matrix in exact])
    own, true = (own - own.mean(0)) @ turn.T, true - true.mean(0)
    metres = np.linalg.norm(own * (own * true).sum() / (own * own).sum() - true, axis=1)
    return {"frames": len(scene["frames"]), "posed": len(posed), "metres": float(np.median(metres)),
            "degrees": float(np.median(degrees)), "focal": scene["camera"]["fx"] / scene["camera"]["width"],
            "true_focal": truth["camera"]["fx"] / truth["camera"]["width"],
            "wall_seconds": scene["pose_source"]["wall_seconds"]}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    measures = {"dense": dense, "poses": poses}
    parser.add_argument("measure", choices=measures)
    parser.add_argument("rendering", metavar="RENDERING", type=Path)
    parser.add_argument("result", metavar="DENSE|SCENE", type=Path)
    arguments = parser.parse_args()
    print(json.dumps(measures[arguments.measure](arguments.rendering, arguments.result), default=float))
