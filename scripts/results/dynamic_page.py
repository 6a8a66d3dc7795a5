"""Puts the tables of scripts/results/dynamic into docs/results/dynamic.md, between its two markers.

    python3 dynamic_page.py FOLDER PAGE SCENE... --real SCENE...

FOLDER is what scripts/results/dynamic filled, with a folder per SCENE. Curves go beside the page and
into docs/images.
"""

import json
import shutil
import sys
from pathlib import Path

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
METHODS = ["odgs", "deformable", "periodic", "omni4dgs", "omni4dgs-plus"]
ABLATED = ["temporal-opacity", "temporal-motion", "velocity-decomposition", "dynamic-mask", "motion-regularization"]
# Heading, views, metric, digits.
SCORES = [("Input PSNR", "input_views", "psnr", 3), ("Input SSIM", "input_views", "ssim", 4),
          ("PSNR", "novel_views", "psnr", 3), ("SSIM", "novel_views", "ssim", 4),
          ("LPIPS-VGG", "novel_views", "lpips-vgg", 4), ("Static PSNR", "novel_views", "psnr-static", 3),
          ("Dynamic PSNR", "novel_views", "psnr-dynamic", 3)]


class Run:
    """A run with its scores."""

    def __init__(self, folder):
        self.folder = folder
        self.result = json.loads((folder / "score/result.json").read_text())
        self.perceptual = json.loads((folder / "lpips/result.json").read_text())
        self.record = json.loads((folder / "run/run.json").read_text())
        self.seconds = sum(map(float, (folder / "time").read_text().split()))

    def score(self, views, metric):
        record = self.perceptual if metric.startswith("lpips") else self.result
        return (record[views].get(metric) or {}).get("mean")


def runs(folder, name):
    """The runs of a name, one per seed."""
    return [Run(path) for path in sorted(folder.glob(f"{name}.*")) if (path / "lpips/result.json").exists()]


def spread(values, digits):
    """The mean, and half of the range where there are several."""
    values = [value for value in values if value is not None]
    if not values:
        return "-"
    mean = sum(values) / len(values)
    half = (max(values) - min(values)) / 2
    return f"{mean:.{digits}f}" + (f" ± {half:.{digits}f}" if len(values) > 1 else "")


def table(rows):
    """A table of names with their runs."""
    headings = [heading for heading, *_ in SCORES]
    headings += ["Iterations", "Primitives", "Training, CPU s", "Memory, MB"]
    lines = ["| Method | " + " | ".join(headings) + " |", "|---" + "|---:" * len(headings) + "|"]
    for name, found in rows:
        if not found:
            continue
        cells = [spread([run.score(views, metric) for run in found], digits) for _, views, metric, digits in SCORES]
        cells += [spread([run.record[key] for run in found[:1]], 0) for key in ("iterations", "primitives")]
        cells += [spread([run.record["training_cpu_seconds"] for run in found], 0),
                  spread([run.record["peak_memory_bytes"] / 1e6 for run in found], 0)]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def still(folder):
    """A scene in which nothing moves, with the CPU time of whole commands."""
    methods = {name: runs(folder, name) for name in ("odgs", "omni4dgs-plus")}
    lines = ["| Method | PSNR | SSIM | Training, CPU s | Whole command, CPU s, seed by seed |", "|---|---:|---:|---:|---:|"]
    for name, found in methods.items():
        times = ", ".join(f"{run.seconds:.1f}" for run in found)
        lines.append(f"| {name} | {spread([run.score('novel_views', 'psnr') for run in found], 3)} | "
                     f"{spread([run.score('novel_views', 'ssim') for run in found], 4)} | "
                     f"{spread([run.record['training_cpu_seconds'] for run in found], 1)} | {times} |")
    ratios = [planned.seconds / plain.seconds for plain, planned in zip(*methods.values())]
    evidence = next(part["reason"] for part in methods["omni4dgs-plus"][0].record["plan"]
                    if part["component"] == "temporal-opacity")
    lines.append("\nTime of the whole command, planning in it, over that of `odgs`, seed by seed: " + ", ".join(f"{ratio:.3f}" for ratio in ratios) +
                 f". What the plan says: {evidence}.")
    return "\n".join(lines)


def machine():
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{len(names)} threads of {names[0]}" if names else "an unknown processor"


def curves(folder, page):
    """Copies table and drawings; gives the Markdown that shows them."""
    shutil.copy(folder / "curves/points.csv", page.with_name("dynamic-curves.csv"))
    images = page.parent.parent / "images"
    text = ["[Every point as CSV](dynamic-curves.csv).\n"]
    for number, drawing in enumerate(sorted((folder / "curves").glob("curve-*.svg"))):
        shutil.copy(drawing, images / f"dynamic-curve-{number}.svg")
        text.append(f"![PSNR of novel views over CPU seconds of training](../images/dynamic-curve-{number}.svg)\n")
    text.append((folder / "curves.md").read_text().strip())
    return "\n".join(text)


def main():
    folder, page, scenes = Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:]
    real = scenes.index("--real")
    scenes, real = scenes[:real], scenes[real + 1:]
    first = runs(folder / scenes[0], "odgs")[0]
    parts = [BEGIN, f"{first.record['iterations']} iterations, images of "
             f"{'x'.join(map(str, first.result['scored_size']))}, one thread per run, {machine()}, shared with other "
             "work: CPU seconds compare the rows of a table, roughly. Where a method was run with several seeds, "
             "the mean and half of the range stand here. Scores are of novel views unless it says input.\n"]
    for scene in scenes:
        rows = [(name, runs(folder / scene, name)) for name in METHODS]
        parts += [f"**{scene}**\n", table(rows), ""]
    for wide in runs(folder / "wide", "odgs"):
        rows = [(name, runs(folder / "wide", name)) for name in METHODS]
        parts += ["### Twice the width\n", f"`{scenes[-1]}` at {'x'.join(map(str, wide.result['scored_size']))}, at "
                  "most twice as many Gaussians.\n", table(rows), ""]
    if real:
        parts += ["### Real footage\n"]
    for scene in real:
        rows = [(name, runs(folder / scene, name)) for name in METHODS]
        parts += [f"**{scene}**\n", table(rows), ""]
    parts += ["### Where nothing moves\n", f"The cameras and points of `{scenes[-1]}`, every frame a render of the static Gaussians of a run "
              "(`scripts/results/still_scene.py`), without masks: the plan has to find out.\n",
              still(folder / "still"), ""]
    rows = [("full", runs(folder / scenes[0], "omni4dgs-full"))]
    rows += [(f"without {name}", runs(folder / scenes[0], f"omni4dgs-without-{name}")) for name in ABLATED]
    parts += ["### Ablation\n", f"`omni4dgs` on `{scenes[0]}`, one component less at a time, as "
              "`omnilife bench ablate` does it.\n", table(rows), ""]
    parts += ["### Error against run time\n", curves(folder, page), END]
    text = page.read_text()
    before, rest = text.split(BEGIN, 1)
    page.write_text(before + "\n".join(parts) + rest.split(END, 1)[1])


main()
