#!/usr/bin/env python3
"""What temporal parameters and harmonics are worth on the clips of the calibration set, whatever a plan says.

    python3 worth.py OUT [--iterations 600]

OUT is a folder that measure.py has filled. Every clip is trained with `omni4dgs-plus` as a static method and
with all that moves, and glossy ones with harmonics and without; novel views as written to PNG files are compared
with the frames. Prints one row per clip, and how often plans use parameters of time where they are worth it; runs
that are there are not made again. Needs $OMNILIFE, the program, and a Python with NumPy and Pillow.
"""

import argparse
import json
import os
from pathlib import Path

import numpy as np
from PIL import Image

from clips import clips
from measure import COMPONENTS, made, run, used

STATIC = [word for one in ("temporal-opacity", "temporal-motion", "dynamic-mask", "mask-seeds") for word in ("--without", one)]
TEMPORAL = ["--with", "temporal-opacity", "--with", "temporal-motion"]
COLOUR = "view-dependent-colour"
# Gain from which parameters of time are worth their price, dB: seeds of such runs differ by a tenth.
WORTH = 0.15


def psnr(sequence, predictions):
    """Mean PSNR of predicted views, dB."""
    frames = json.loads((sequence / "scene.json").read_text())["frames"]
    values = []
    for file in sorted(predictions.iterdir()):
        shown = np.asarray(Image.open(sequence / frames[int(file.stem)]["image"]).convert("RGB"), float)
        predicted = np.asarray(Image.open(file).convert("RGB"), float)
        values.append(-10 * np.log10(np.mean(((predicted - shown) / 255) ** 2)))
    return float(np.mean(values))


def trained(options, clip, name, extra):
    """PSNR of novel views and CPU seconds of a training."""
    sequence = options.out / "datasets" / clip.name / "videos" / clip.name / "seq-000"
    folder = made(options.out / "worth" / f"{clip.name}-{name}-{options.iterations}", lambda part: run(
        os.environ["OMNILIFE"], "--quiet", "reconstruct", "train", sequence / "scene.json", "--split",
        sequence / "split.json", "--method", "omni4dgs-plus", "--iterations", options.iterations, "--seed", 0,
        "--trace-views", 0, "--out", part, *extra))
    record = json.loads((folder / "run.json").read_text())
    return psnr(sequence, folder / "predictions/novel"), record["training_cpu_seconds"]


def decided(options, clip):
    """Whether the plan that measure.py made of a clip uses parameters of time."""
    record = json.loads((options.out / "plans" / f"{clip.name}-0" / "run.json").read_text())
    return COMPONENTS["motion"] in used(record)


def decisions(pairs):
    """The table of decisions: pairs of half, gain in dB, and whether time was used."""
    lines = ["", f"| Half | Worth {WORTH} dB and used | Worth it, left out | Not worth it, used | Not worth it, left out |",
             "|---|---:|---:|---:|---:|"]
    for half in ("set", "unseen"):
        found = [(gain >= WORTH, is_used) for of, gain, is_used in pairs if of == half]
        counts = [found.count(pair) for pair in ((True, True), (True, False), (False, True), (False, False))]
        lines.append(f"| {half} | {' | '.join(map(str, counts))} |")
    return "\n".join(lines)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--iterations", type=int, default=600)
    options = parser.parse_args()
    (options.out / "worth").mkdir(exist_ok=True)
    print("| Clip | Moves | Surfaces | Footage | Static, dB | CPU s | Temporal, dB | CPU s | Harmonics, dB |")
    print("|---|---|---|---|---:|---:|---:|---:|---:|")
    pairs = []
    for clip in clips():
        static, static_seconds = trained(options, clip, "static", STATIC)
        temporal, temporal_seconds = trained(options, clip, "temporal", TEMPORAL)
        harmonics = "-"
        if clip.surfaces == "glossy":
            with_harmonics, _ = trained(options, clip, "sh", ["--with", COLOUR])
            without, _ = trained(options, clip, "nosh", ["--without", COLOUR])
            harmonics = f"{with_harmonics - without:+.2f}"
        print(f"| {clip.name} | {clip.motion} | {clip.surfaces} | {clip.footage} | {static:.2f} | {static_seconds:.1f} "
              f"| {temporal:.2f} ({temporal - static:+.2f}) | {temporal_seconds:.1f} | {harmonics} |", flush=True)
        pairs.append((clip.half, temporal - static, decided(options, clip)))
    print(decisions(pairs))


if __name__ == "__main__":
    main()
