#!/usr/bin/env python3
"""Writes the exact paths of the vehicles of a rendered panoramic street, as omnilife/tracks/1.

  street_tracks.py RENDERING SPLIT OUT

RENDERING holds poses.json with the centres of what moves, as scripts/fixtures/street.py takes it; SPLIT is the
split.json that is trained on. Needs NumPy.
"""

import argparse
import json
from pathlib import Path

import numpy as np

# Length, width and height of the renderer's cars and vans, metres.
DIMENSIONS = {"car": (4.3, 1.8, 1.5), "van": (5.6, 2.1, 2.4)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("rendering", "split", "out"):
        parser.add_argument(name, metavar=name.upper(), type=Path)
    arguments = parser.parse_args()
    rendering, split, out = arguments.rendering, arguments.split, arguments.out
    truth, split = (json.loads(path.read_text()) for path in (rendering / "poses.json", split))
    frames = truth["frames"]
    times = [frame["time"] for frame in frames]
    tracks = []
    for number, thing in enumerate(frames[0]["dynamic"]):
        kind = thing["name"][:3]
        if kind not in DIMENSIONS:
            continue
        length, width, height = DIMENSIONS[kind]
        # The rendering's centre is 0.7 m up, whatever the vehicle's height.
        centres = np.array([frame["dynamic"][number]["center"] for frame in frames]) + [0, 0, height / 2 - 0.7]
        moved = np.linalg.norm(centres - centres[0], axis=1).max()
        if moved < 1:
            continue
        steps = np.gradient(centres, times, axis=0)
        headings = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])).tolist()
        tracks.append({
            "id": thing["id"], "class": "vehicle", "dimensions": [length, width, height],
            "path": {"centre": {"degree": 1, "knots": [times[0], *times, times[-1]], "coefficients": centres.tolist()},
                     "heading_seconds": times, "headings": headings},
            "detections": len(split["input_views"]), "displacement": float(moved)})
    record = {
        "schema": "omnilife/tracks/1", "scene": split["scene"], "frames": split["input_views"],
        "image_size": [truth["width"], truth["height"]], "up": [0, 0, 1], "metres_per_unit": 1,
        "stages": [{"stage": "detector", "method": "exact", "reason": "rendered", "wall_seconds": 0}],
        "detections": [], "tracks": tracks, "warnings": []}
    out.write_text(json.dumps(record, indent=1) + "\n")


if __name__ == "__main__":
    main()
