#!/usr/bin/env python3
"""Makes the calibration set and counts wrong decisions of a plan on it.

    python3 measure.py GENERATOR OUT [--groups set,unseen,blind] [--page FILE]

Clips are rendered (render.py), given footage, poses and masks (disturb.py), curated, split, and planned for by
`omnilife reconstruct train --iterations 1`, whose record holds the evidence; what is there in OUT is not made
again. Prints a table of what the plan decided of every clip, and false and true positives of every component.
Needs $OMNILIFE, the program, ffmpeg, and the packages that render.py names and Pillow.
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

from clips import GROUPS, clips

FOLDER = Path(__file__).resolve().parent
# What a plan decides, and the component whose use says so.
COMPONENTS = {
    "motion": "temporal-opacity",
    "exposure": "exposure-compensation",
    "poses": "pose-refinement",
    "view-dependence": "view-dependent-colour",
}


def run(*command):
    """Runs a command, whose errors are shown."""
    subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)


def made(folder, make):
    """A folder that `make` writes under another name first."""
    if not folder.exists():
        part = folder.with_name(folder.name + ".part")
        shutil.rmtree(part, ignore_errors=True)
        make(part)
        part.rename(folder)
    return folder


def curated(program, clip, footage, out):
    """The posed sequence of a clip, with its split."""
    run(program, "--quiet", "curate", "build", footage / f"{clip.name}.mp4", "--out", out, "--width", "256",
        "--criteria", "none", "--accept", "erp")
    sequence = out / "videos" / clip.name / "seq-000"
    run(program, "--quiet", "curate", "poses", sequence, "--poses", footage / "poses.json")
    run(program, "--quiet", "bench", "split", sequence / "scene.json", "--protocol", "per-scene", "--out",
        sequence / "split.json")


def evidence(program, clip, generator, out, seed):
    """The run record of a plan on a clip."""
    rendering = made(out / "renderings" / clip.name,
                     lambda part: run(sys.executable, FOLDER / "render.py", generator, clip.name, part))
    footage = made(out / "footage" / clip.name,
                   lambda part: run(sys.executable, FOLDER / "disturb.py", rendering, clip.name, part))
    dataset = made(out / "datasets" / clip.name, lambda part: curated(program, clip, footage, part))
    sequence = dataset / "videos" / clip.name / "seq-000"
    plan = made(out / "plans" / f"{clip.name}-{seed}", lambda part: run(
        program, "--quiet", "reconstruct", "train", sequence / "scene.json", "--split", sequence / "split.json",
        "--method", "omni4dgs-plus", "--iterations", "1", "--seed", seed, "--trace-views", "0", "--out", part))
    return json.loads((plan / "run.json").read_text())


def used(record):
    """The names of the components that a run used."""
    return {one["component"] for one in record["plan"] if one["used"]}


def rows(options):
    """What was decided of every clip: clip, decision by name, record."""
    for clip in clips(options.groups):
        record = evidence(os.environ["OMNILIFE"], clip, options.generator, options.out, options.seed)
        components = used(record)
        yield clip, {name: component in components for name, component in COMPONENTS.items()}, record


def page(found):
    """The tables, as Markdown."""
    lines = ["| Clip | Scene | Moves | Poses | Exposure | Surfaces | Camera | Footage | Masks | Wrong |",
             "|---|---|---|---|---|---|---|---|---|---|"]
    for clip, decided, _ in found:
        wrong = [name + (" used" if decided[name] else " left out") for name, is_there in clip.truth().items()
                 if decided[name] != is_there]
        levels = (clip.motion, clip.poses, clip.exposure, clip.surfaces, clip.camera, clip.footage, clip.masks)
        lines.append(f"| {clip.name} | {clip.scene} | {' | '.join(levels)} | {', '.join(wrong) or '-'} |")
    lines += ["", "| Component | Group | There and used | There, left out | Not there, used | Not there, left out |",
              "|---|---|---:|---:|---:|---:|"]
    for name, component in COMPONENTS.items():
        for group in GROUPS:
            pairs = [(clip.truth()[name], decided[name]) for clip, decided, _ in found if clip.group == group]
            counts = [pairs.count(pair) for pair in ((True, True), (True, False), (False, True), (False, False))]
            if pairs:
                lines.append(f"| {component} | {group} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("generator", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--groups", type=lambda names: names.split(","), default=GROUPS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--page", type=Path, help="write the tables here too")
    options = parser.parse_args()
    for folder in ("renderings", "footage", "datasets", "plans"):
        (options.out / folder).mkdir(parents=True, exist_ok=True)
    text = page(list(rows(options)))
    if options.page:
        options.page.write_text(text)
    print(text, end="")


if __name__ == "__main__":
    main()
