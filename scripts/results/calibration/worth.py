#!/usr/bin/env python3
"""What each decision of a plan is worth on the clips of the calibration set: the cost of a wrong one.

    python3 worth.py OUT [--groups set,unseen,blind] [--iterations 1000] [--jobs 2]

OUT is a folder that measure.py has filled. Every clip is trained with `omni4dgs-plus` as the plan says, and once
more for each component with the other decision, in as much CPU time: a first run tells the pace of its steps, a
second one takes as many as fit. Novel views as written to PNG files are compared with the frames.
Prints what using each component is worth on every clip, how often plans decide against that, and what it costs;
runs that are there are not made again. Needs $OMNILIFE, the program, and a Python with NumPy and Pillow.
"""

import argparse
import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from PIL import Image

from clips import GROUPS, clips
from measure import COMPONENTS, made, run, used

# Components that go with one: without lives there are no seeds of what moves, and no losses on them.
WITH = {"motion": ["temporal-opacity", "temporal-motion"]}
WITHOUT = {"motion": ["temporal-opacity", "temporal-motion", "dynamic-mask", "mask-seeds"]}
# Difference that seeds of such runs make, dB: a component that is worth less may be used or left out.
SPREAD = 0.1
# Share of the CPU time by which two runs may differ and count as equally long.
SAME_TIME = 0.02


def psnr(sequence, predictions):
    """Mean PSNR of predicted views, dB."""
    frames = json.loads((sequence / "scene.json").read_text())["frames"]
    values = []
    for file in sorted(predictions.iterdir()):
        shown = np.asarray(Image.open(sequence / frames[int(file.stem)]["image"]).convert("RGB"), float)
        predicted = np.asarray(Image.open(file).convert("RGB"), float)
        values.append(-10 * np.log10(np.mean(((predicted - shown) / 255) ** 2)))
    return float(np.mean(values))


def trained(options, clip, name, extra, iterations):
    """PSNR of novel views, CPU seconds of planning and of steps on one core, and the components that were used."""
    sequence = options.out / "datasets" / clip.name / "videos" / clip.name / "seq-000"
    folder = made(options.out / "worth" / f"{clip.name}-{name}-{iterations}", lambda part: run(
        os.environ["OMNILIFE"], "--quiet", "reconstruct", "train", sequence / "scene.json", "--split",
        sequence / "split.json", "--method", "omni4dgs-plus", "--iterations", iterations, "--seed", 0,
        "--trace-views", 0, "--out", part, *extra))
    record = json.loads((folder / "run.json").read_text())
    planning = record["planning_cpu_seconds"]
    steps = record["training_cpu_seconds"] - planning
    return psnr(sequence, folder / "predictions/novel"), (planning, steps), used(record)


def trained_within(options, clip, name, extra, seconds):
    """PSNR of novel views after as many iterations as fit into these CPU seconds, and those of the full schedule."""
    value, (planning, steps), _ = trained(options, clip, name, extra, options.iterations)
    iterations = max(1, round((seconds - planning) / steps * options.iterations))
    if abs(iterations / options.iterations - 1) > SAME_TIME:
        value, _, _ = trained(options, clip, name, extra, iterations)
    return value, planning + steps


def other_decision(decision, is_used):
    """Arguments that turn a decision around."""
    if is_used:
        return [word for one in WITHOUT.get(decision, [COMPONENTS[decision]]) for word in ("--without", one)]
    return [word for one in WITH.get(decision, [COMPONENTS[decision]]) for word in ("--with", one)]


def measured(options, clip):
    """By decision: whether the plan uses the component, what using it is worth in dB at equal CPU time, and by what
    factor it lengthens as many iterations."""
    plan_psnr, parts, components = trained(options, clip, "plan", [], options.iterations)
    plan_seconds = sum(parts)
    found = {}
    for decision, component in COMPONENTS.items():
        is_used = component in components
        other = other_decision(decision, is_used)
        other_psnr, other_seconds = trained_within(options, clip, decision, other, plan_seconds)
        gain, factor = plan_psnr - other_psnr, plan_seconds / other_seconds
        found[decision] = (is_used, gain, factor) if is_used else (is_used, -gain, 1 / factor)
    return plan_psnr, plan_seconds, found


def clips_table(rows):
    """What using each component is worth on every clip; what the plan uses is marked."""
    lines = [f"| Clip | Moves | Poses | Exposure | Surfaces | Footage | PSNR, dB | CPU s | {' | '.join(COMPONENTS)} |",
             "|---|---|---|---|---|---|---:|---:|" + "---:|" * len(COMPONENTS)]
    for clip, (value, seconds, found) in rows:
        gains = [f"**{gain:+.2f}**" if is_used else f"{gain:+.2f}" for is_used, gain, _ in found.values()]
        levels = (clip.motion, clip.poses, clip.exposure, clip.surfaces, clip.footage)
        lines.append(f"| {clip.name} | {' | '.join(levels)} | {value:.2f} | {seconds:.1f} | {' | '.join(gains)} |")
    return lines


def decisions_table(rows):
    """How often the plan decides against a gain, or for nothing, and what that costs."""
    lines = ["| Component | Group | Worth it, used | Worth it, left out | Costs quality, used | Neither, used | Neither or "
             "costs, left out | Lost by wrong decisions, mean and largest, dB | Training longer by, where used |",
             "|---|---|---:|---:|---:|---:|---:|---:|---:|"]
    for decision, component in COMPONENTS.items():
        for group in GROUPS:
            found = [by[decision] for clip, (_, _, by) in rows if clip.group == group]
            if not found:
                continue
            count = lambda test: sum(map(test, found))
            lost = [abs(gain) if is_used != (gain > 0) and abs(gain) >= SPREAD else 0.0 for is_used, gain, _ in found]
            factors = [factor for _, _, factor in found]
            counts = (count(lambda one: one[0] and one[1] >= SPREAD), count(lambda one: not one[0] and one[1] >= SPREAD),
                      count(lambda one: one[0] and one[1] <= -SPREAD),
                      count(lambda one: one[0] and abs(one[1]) < SPREAD),
                      count(lambda one: not one[0] and one[1] < SPREAD))
            lines.append(f"| {component} | {group} | {' | '.join(map(str, counts))} | {np.mean(lost):.2f}, {max(lost):.2f} "
                         f"| {100 * (np.median(factors) - 1):.0f} % |")
    return lines


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--groups", type=lambda names: names.split(","), default=GROUPS)
    parser.add_argument("--iterations", type=int, default=1000)
    parser.add_argument("--jobs", type=int, default=2, help="trainings at a time, each on one core")
    options = parser.parse_args()
    os.environ["RAYON_NUM_THREADS"] = "1"
    (options.out / "worth").mkdir(exist_ok=True)
    with ThreadPoolExecutor(options.jobs) as pool:
        chosen = clips(options.groups)
        rows = list(zip(chosen, pool.map(lambda clip: measured(options, clip), chosen)))
    print("\n".join([*decisions_table(rows), "", *clips_table(rows)]))


if __name__ == "__main__":
    main()
