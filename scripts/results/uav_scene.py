#!/usr/bin/env python3
"""Writes a rendered flight over traffic as `omnilife run --projection pinhole` takes it.

  uav_scene.py RENDERING OUT

RENDERING holds tracks.json (camera, poses, objects), rgb/NNNN.jpg, inst/NNNN.png and points.ply. Written
into OUT are flight.mp4 (H.264, one frame per image), poses.json (omnilife/poses/2 with the camera, and
masks of what moves), masks/, points.ply, and boxes.txt: the visible boxes of vehicles as MOT text. What
does not move is in no mask. Needs Pillow and NumPy, and ffmpeg.
"""

import argparse
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
from PIL import Image

# A vehicle that stays within this many metres of where it was first does not move.
LEAST_METRES = 1.0


def quaternion(m):
    """(w, x, y, z) of a rotation matrix."""
    m = np.asarray(m, float)
    w = np.sqrt(max(0.0, 1 + m[0, 0] + m[1, 1] + m[2, 2])) / 2
    x = np.sqrt(max(0.0, 1 + m[0, 0] - m[1, 1] - m[2, 2])) / 2
    y = np.sqrt(max(0.0, 1 - m[0, 0] + m[1, 1] - m[2, 2])) / 2
    z = np.sqrt(max(0.0, 1 - m[0, 0] - m[1, 1] + m[2, 2])) / 2
    x, y, z = (np.copysign(x, m[2, 1] - m[1, 2]), np.copysign(y, m[0, 2] - m[2, 0]),
               np.copysign(z, m[1, 0] - m[0, 1]))
    q = np.array([w, x, y, z])
    return (q / np.linalg.norm(q)).tolist()


def moving_ids(frames):
    """Ids of everything whose centre moves."""
    centres = {}
    for frame in frames:
        for thing in frame["objects"]:
            centres.setdefault(thing["id"], []).append(thing["centre"])
    return {
        key for key, places in centres.items()
        if np.linalg.norm(np.asarray(places) - places[0], axis=1).max() > LEAST_METRES
    }


def true_tracks(truth, moving):
    """What really moves, as omnilife/tracks/1: paths from frame to frame, and the visible boxes."""
    frames = truth["frames"]
    detections, tracks = [], []
    vehicles = {t["id"]: t for t in frames[0]["objects"] if t["class"] == "vehicle" and t["id"] in moving}
    for key, vehicle in sorted(vehicles.items()):
        own = [next(t for t in f["objects"] if t["id"] == key) for f in frames]
        times = [f["time"] for f in frames]
        # The rendering's forward is (-sin yaw, cos yaw); headings count from x.
        headings = np.unwrap([t["yaw"] + np.pi / 2 for t in own]).tolist()
        centres = [t["centre"] for t in own]
        seen = 0
        for number, thing in enumerate(own):
            if thing["box_visible"]:
                left, top, right, bottom = thing["box_visible"]
                seen += 1
                detections.append({
                    "frame": number, "box_pixels": [left, top, right - left, bottom - top],
                    "confidence": 1, "class": "vehicle", "distance": None,
                    "position": thing["centre"], "track": key})
        tracks.append({
            "id": key, "class": "vehicle",
            "dimensions": [vehicle["length"], vehicle["width"], vehicle["height"]],
            "path": {
                "centre": {"degree": 1, "knots": [times[0], *times, times[-1]], "coefficients": centres},
                "heading_seconds": times, "headings": headings},
            "detections": seen,
            "displacement": float(np.linalg.norm(np.asarray(centres) - centres[0], axis=1).max())})
    detections.sort(key=lambda one: one["frame"])
    return {
        "schema": "omnilife/tracks/1", "scene": "flight/seq-000", "frames": list(range(len(frames))),
        "image_size": [truth["camera"]["width"], truth["camera"]["height"]],
        "up": [0, 0, 1], "metres_per_unit": 1,
        "stages": [{"stage": "detector", "method": "exact", "reason": "rendered", "wall_seconds": 0}],
        "detections": detections, "tracks": tracks, "warnings": []}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rendering", metavar="RENDERING", type=Path)
    parser.add_argument("out", metavar="OUT", type=Path)
    arguments = parser.parse_args()
    rendering, out = arguments.rendering, arguments.out
    truth = json.loads((rendering / "tracks.json").read_text())
    camera, frames = truth["camera"], truth["frames"]
    moving = moving_ids(frames)
    (out / "masks").mkdir(parents=True, exist_ok=True)
    posed, boxes = [], []
    for number, frame in enumerate(frames):
        instances = np.asarray(Image.open(rendering / frame["inst"]))
        mask = f"masks/{number:06}.png"
        marked = np.isin(instances, sorted(moving)).astype(np.uint8) * 255
        Image.fromarray(marked).save(out / mask)
        matrix = np.asarray(frame["c2w"])
        posed.append({
            "time_seconds": frame["time"],
            "pose": {"rotation_wxyz": quaternion(matrix[:3, :3]), "centre": matrix[:3, 3].tolist()},
            "mask": mask,
        })
        for thing in frame["objects"]:
            if thing["class"] == "vehicle" and thing["box_visible"]:
                left, top, right, bottom = thing["box_visible"]
                boxes.append(f"{number + 1},{thing['id']},{left},{top},{right - left},{bottom - top},1,1\n")
    (out / "truth.json").write_text(json.dumps(true_tracks(truth, moving), indent=1) + "\n")
    record = {
        "schema": "omnilife/poses/2", "scale": "metres",
        "camera": {key: camera[key] for key in ("model", "width", "height", "fx", "fy", "cx", "cy")},
        "frames": posed, "points": "points.ply",
    }
    (out / "poses.json").write_text(json.dumps(record, indent=1) + "\n")
    (out / "boxes.txt").write_text("".join(boxes))
    shutil.copy(rendering / "points.ply", out / "points.ply")
    subprocess.run(
        ["ffmpeg", "-y", "-loglevel", "error", "-framerate", str(truth["fps"]), "-i",
         str(rendering / "rgb/%04d.jpg"), "-c:v", "libx264", "-crf", "12", "-pix_fmt", "yuv420p",
         str(out / "flight.mp4")], check=True)


if __name__ == "__main__":
    main()
