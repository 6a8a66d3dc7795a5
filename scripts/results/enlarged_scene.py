#!/usr/bin/env python3
"""Makes a larger rendering of some frames of one: images by bicubic interpolation, masks by the nearest pixel.

    python3 enlarged_scene.py RENDERING OUT WIDTH EVERY

RENDERING is a folder of the layout that scripts/fixtures/street.py reads, OUT one that rendered_scene takes
as made once it has the name of the scene: a video, poses.json, masks and points. OUT/depth has the distances
of the frames, at their own size. Every EVERYth frame is there, from the first on. It has no more detail than
RENDERING: it is for counts, sizes and times. Needs ffmpeg and a Python with NumPy and Pillow.
"""

import argparse
import json
import shutil
import sys
from pathlib import Path

import numpy as np
from PIL import Image

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "fixtures"))
import street


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", metavar="RENDERING", type=Path)
    parser.add_argument("out", metavar="OUT", type=Path)
    parser.add_argument("width", metavar="WIDTH", type=int)
    parser.add_argument("every", metavar="EVERY", type=int)
    arguments = parser.parse_args()
    source, out, width, every = arguments.source, arguments.out, arguments.width, arguments.every
    size = (width, width // 2)
    for folder in ("masks", "depth"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    scene = json.loads((source / "poses.json").read_text())
    frames = scene["frames"][::every]
    images = [Image.open(source / frame["rgb"]).convert("RGB") for frame in frames]
    clip = out / f"{scene['scene']}.mp4"
    # Times stay as they were.
    street.FRAMES_PER_SECOND //= every
    street.encode([np.asarray(image.resize(size, Image.Resampling.BICUBIC)) for image in images], clip)
    records = []
    for index, (frame, time_seconds) in enumerate(zip(frames, street.presentation_times(clip), strict=True)):
        mask = f"masks/{index:06d}.png"
        image = Image.open(source / frame["mask"]).convert("L")
        image.resize(size, Image.Resampling.NEAREST).save(out / mask)
        shutil.copy(source / frame["depth"], out / f"depth/{index:06d}.png")
        records.append({"time_seconds": time_seconds, "pose": street.pose(frame["c2w"]), "mask": mask})
    poses = {"schema": "omnilife/poses/1", "scale": "metres", "frames": records, "points": "points.ply"}
    (out / "poses.json").write_text(json.dumps(poses, indent=2) + "\n")
    shutil.copy(source / "points.ply", out / "points.ply")


main()
