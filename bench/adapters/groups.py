"""Groups of a sparse-interpolation split as the scenes of feed-forward methods.

    OUT/frames/            the scene as `omnilife curate export --format hm3d` writes it
    OUT/000, OUT/001, ...  a link to it for every group
    OUT/evaluation_index.json   {"000": {"context": [0, 9], "target": [1, ...]}, ...}

Numbers count the posed frames, as the exported files do. Needs nothing but Python.
"""

import argparse
import json
import os
import subprocess
from pathlib import Path


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--omnilife", required=True)
    parser.add_argument("--scene", type=Path, required=True)
    parser.add_argument("--split", type=Path, required=True)
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    split = json.loads(arguments.split.read_text())
    groups = split.get("groups", [])
    if not groups:
        parser.error(f"{arguments.split}: has no groups; its protocol is {split['protocol']['id']}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    frames = arguments.out / "frames"
    export = ["curate", "export", arguments.scene, "--format", "hm3d", "--out", frames]
    subprocess.run([arguments.omnilife, "--quiet", *map(str, export)], check=True)
    unposed = set(split["unposed"])
    if unposed:
        parser.error(f"{len(unposed)} frames have no pose: their numbers would shift")
    index = {}
    for number, group in enumerate(groups):
        name = f"{number:03}"
        os.symlink("frames", arguments.out / name)
        index[name] = {"context": group["context"], "target": group["novel_views"]}
    (arguments.out / "evaluation_index.json").write_text(json.dumps(index))


if __name__ == "__main__":
    main()
