"""Puts the tables of scripts/results/dynamic into docs/results/dynamic.md, between its two markers.

    python3 dynamic_page.py FOLDER PAGE

FOLDER is what scripts/results/dynamic filled.
"""

import json
import sys
from pathlib import Path

import aids

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
# What a scene without motion is compared with: static Gaussians with the same aids.
PEER = "odgs"
# Heading, views, metric, digits.
SCORES = [("Input PSNR", "input_views", "psnr", 2), ("PSNR", "novel_views", "psnr", 2),
          ("SSIM", "novel_views", "ssim", 4), ("LPIPS-VGG", "novel_views", "lpips-vgg", 4),
          ("Static PSNR", "novel_views", "psnr-static", 2), ("Dynamic PSNR", "novel_views", "psnr-dynamic", 2)]


class Run:
    """A run with its scores."""

    def __init__(self, folder):
        self.folder = folder
        self.result = json.loads((folder / "score/result.json").read_text())
        self.record = json.loads((folder / "run/run.json").read_text())

    def score(self, views, metric):
        return (self.result[views].get(metric) or {}).get("mean")

    def images(self):
        """The predicted images as they lie in their files."""
        return [path.read_bytes() for path in sorted((self.folder / "run/predictions").rglob("*.png"))]

    def decision(self, component):
        return next(part for part in self.record["plan"] if part["component"] == component)


def number(value, digits):
    return "-" if value is None else f"{value:.{digits}f}"


def spread(values, digits):
    """The mean, and half of the range."""
    return f"{sum(values) / len(values):.{digits}f} ± {(max(values) - min(values)) / 2:.{digits}f}"


def ablation(folder):
    """Everything that a method uses on a scene, then everything but one of it."""
    runs = {path.name: Run(path) for path in folder.iterdir() if (path / "score/result.json").exists()}
    full = min(runs, key=len)
    names = [full] + [f"{full}-without-{part['component']}" for part in runs[full].record["plan"] if part["used"]]
    headings = [heading for heading, *_ in SCORES] + ["Iterations", "Gaussians", "Training, CPU s"]
    lines = ["| | " + " | ".join(headings) + " |", "|---" + "|---:" * len(headings) + "|"]
    for name in names:
        run = runs[name]
        cells = [number(run.score(views, metric), digits) for _, views, metric, digits in SCORES]
        cells += [str(run.record["iterations"]), str(run.record["primitives"]), number(run.record["training_cpu_seconds"], 0)]
        label = "all that is used" if name == full else f"without {name.removeprefix(full + '-without-')}"
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def still(folder):
    """A scene in which nothing moves."""
    methods = {}
    for name in ("odgs-without-aids", PEER, "omni4dgs-plus"):
        methods[name] = [Run(path) for path in sorted(folder.glob(f"{name}.*"))]
    lines = ["| Method | PSNR | SSIM | Training with planning, CPU s |", "|---|---:|---:|---:|"]
    for name, found in methods.items():
        scores = [spread([run.score("novel_views", metric) for run in found], digits)
                  for metric, digits in (("psnr", 2), ("ssim", 4))]
        training = spread([run.record["training_cpu_seconds"] for run in found], 1)
        lines.append(f"| {name} | {' | '.join(scores)} | {training} |")
    lines += aids.lines([(f"`{name}`", run.record) for name, found in methods.items() for run in found])
    for name in list(methods)[2:]:
        planned = methods[name][0]
        ratios = [run.record["training_cpu_seconds"] / plain.record["training_cpu_seconds"]
                  for run, plain in zip(methods[name], methods[PEER])]
        used = ", ".join(f"`{part['component']}`" for part in planned.record["plan"] if part["used"]) or "none"
        lines.append(f"\n`{name}`: training time over that of `{PEER}`, seed by seed, " +
                     ", ".join(f"{ratio:.3f}" for ratio in ratios) + f". Components in use: {used}.")
        if all(run.images() == plain.images() for run, plain in zip(methods[name], methods[PEER])):
            planning = [run.record["planning_cpu_seconds"] for run in methods[name]]
            plain = [run.record["training_cpu_seconds"] for run in methods[PEER]]
            share = sum(planning) / sum(plain)
            lines.append(f"Its images are those of `{PEER}` to the bit. Its cost is planning, {spread(planning, 2)} CPU s, "
                         f"{share:.1%} of the other's training. The rest of the ratio is noise of the machine.")
    lines.append(f"\nWhat the plan says of motion: {planned.decision('temporal-opacity')['reason']}.")
    return "\n".join(lines)


def machine():
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{len(names)} cores of an {names[0]}" if names else "an unknown processor"


def main():
    folder, page = Path(sys.argv[1]), Path(sys.argv[2])
    still_runs = folder / "still-runs"
    record = json.loads((next(still_runs.glob("odgs.*")) / "run/run.json").read_text())
    parts = [BEGIN, f"Images of 256x128, protocol `per-scene`, one core per run, {machine()}.\n"]
    for ablated in sorted((folder / "ablations").iterdir()):
        scene, method = ablated.name.split("-", 1)
        parts += [f"**`{method}` on `{scene}`**\n", ablation(ablated), ""]
    parts += ["### Where nothing moves\n", "The cameras and points of `hall`, every frame a render of the static "
              "Gaussians of a run (`scripts/results/still_scene.py`), without masks: the plan has to find out. "
              f"{record['iterations']} iterations.\n", still(still_runs), "", END]
    text = page.read_text()
    before, rest = text.split(BEGIN, 1)
    page.write_text(before + "\n".join(parts) + rest.split(END, 1)[1])


main()
