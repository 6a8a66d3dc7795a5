"""Makes a scene in which nothing moves: every frame is a render of static Gaussians.

    python3 still_scene.py SCENE_JSON RENDERS OUT

RENDERS has an image per frame, named as its frame (000012.png): the static layer of a run. The new
scene has the cameras and points of the old one, and no masks.
"""

import json
import shutil
import sys
from pathlib import Path


def main():
    scene_file, renders, out = (Path(argument) for argument in sys.argv[1:])
    scene = json.loads(scene_file.read_text())
    (out / "frames").mkdir(parents=True)
    for number, frame in enumerate(scene["frames"]):
        frame["image"] = f"frames/{number:06}.png"
        frame["mask"] = None
        shutil.copy(renders / f"{number:06}.png", out / frame["image"])
    if scene.get("points"):
        shutil.copy(scene_file.parent / scene["points"], out / "points.ply")
        scene["points"] = "points.ply"
    scene["id"] += "-still"
    (out / "scene.json").write_text(json.dumps(scene, indent=2) + "\n")


main()
