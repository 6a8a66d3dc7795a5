"""Makes a scene in which nothing moves: masked pixels of its frames are replaced by renders.

    python3 still_scene.py SCENE_JSON RENDERS OUT

RENDERS has an image per frame, named as its frame (000012.png): the static Gaussians alone. Masks are
grown by some pixels for what compression and antialiasing leave around them. The new scene has no
masks. Needs NumPy and Pillow.
"""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

GROWTH_PIXELS = 4


def main():
    scene_file, renders, out = (Path(argument) for argument in sys.argv[1:])
    scene = json.loads(scene_file.read_text())
    (out / "frames").mkdir(parents=True)
    for number, frame in enumerate(scene["frames"]):
        image = Image.open(scene_file.parent / frame["image"]).convert("RGB")
        if frame.get("mask"):
            mask = Image.open(scene_file.parent / frame["mask"]).convert("L").resize(image.size)
            grown = mask.filter(ImageFilter.MaxFilter(2 * GROWTH_PIXELS + 1))
            render = Image.open(renders / f"{number:06}.png").convert("RGB")
            hole = np.asarray(grown)[..., None] > 0
            image = Image.fromarray(np.where(hole, np.asarray(render), np.asarray(image)))
        frame["image"] = f"frames/{number:06}.png"
        frame["mask"] = None
        image.save(out / frame["image"])
    if scene.get("points"):
        shutil.copy(scene_file.parent / scene["points"], out / "points.ply")
        scene["points"] = "points.ply"
    scene["id"] += "-still"
    (out / "scene.json").write_text(json.dumps(scene, indent=2) + "\n")


main()
