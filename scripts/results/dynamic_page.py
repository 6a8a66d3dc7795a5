"""Puts the tables of scripts/results/dynamic into docs/results/dynamic.md, between its two markers.

    python3 dynamic_page.py FOLDER PAGE

FOLDER is what scripts/results/dynamic filled. Curves go beside the page and into docs/images.
"""

import json
import shutil
import sys
from collections import defaultdict
from pathlib import Path

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
ORDER = ["odgs", "deformable", "periodic", "omni4dgs", "omni4dgs, plan full", "omni4dgs-plus",
         "omni4dgs-plus, plan full"]
# Heading, views, metric, digits.
SCORES = [("Input PSNR", "input_views", "psnr", 3), ("Input SSIM", "input_views", "ssim", 4),
          ("PSNR", "novel_views", "psnr", 3), ("SSIM", "novel_views", "ssim", 4),
          ("LPIPS-VGG", "novel_views", "lpips-vgg", 4), ("Static PSNR", "novel_views", "psnr-static", 3),
          ("Dynamic PSNR", "novel_views", "psnr-dynamic", 3)]


class Run:
    def __init__(self, folder):
        self.result = json.loads((folder / "score/result.json").read_text())
        self.run = json.loads((folder / "run/run.json").read_text())

    def score(self, views, metric):
        return (self.result[views].get(metric) or {}).get("mean")


def runs_of(results, suffix=""):
    """Runs by scene and method, one per seed."""
    found = defaultdict(lambda: defaultdict(list))
    for record in sorted(results.glob("**/score/result.json")):
        if (record.parent.parent / "run/run.json").exists():
            run = Run(record.parent.parent)
            found[run.result["scene"]][run.result["method"] + suffix].append(run)
    return found


def spread(values, digits):
    """The mean, and half of the range where there is one."""
    values = [value for value in values if value is not None]
    if not values:
        return "-"
    mean = sum(values) / len(values)
    half = (max(values) - min(values)) / 2
    return f"{mean:.{digits}f}" + (f" ± {half:.{digits}f}" if len(values) > 1 else "")


def scene_table(methods):
    names = [name for name in ORDER if name in methods]
    headings = [heading for heading, *_ in SCORES] + ["Gaussians", "Training, CPU s", "Memory, MB"]
    lines = ["| Method | " + " | ".join(headings) + " |", "|---" + "|---:" * len(headings) + "|"]
    for name in names:
        runs = methods[name]
        cells = [spread([run.score(views, metric) for run in runs], digits)
                 for _, views, metric, digits in SCORES]
        cells += [spread([run.result["gaussians"] for run in runs], 0),
                  spread([run.run["training_cpu_seconds"] for run in runs], 0),
                  spread([run.run["peak_memory_bytes"] / 1e6 for run in runs], 0)]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def still_table(folder):
    """A scene in which nothing moves: scores, and processor time of the whole command."""
    seconds = {}
    for method in ("odgs", "omni4dgs-plus"):
        times = sorted((folder / "still-runs").glob(f"{method}.*/time"))
        seconds[method] = [sum(map(float, time.read_text().split())) for time in times]
    lines = ["| Method | PSNR | SSIM | Whole command, CPU s, per seed |", "|---|---:|---:|---:|"]
    for method in seconds:
        runs = [Run(path) for path in sorted((folder / "still-runs").glob(f"{method}.*"))]
        times = ", ".join(f"{value:.1f}" for value in seconds[method])
        lines.append(f"| {method} | {spread([run.score('novel_views', 'psnr') for run in runs], 3)} | "
                     f"{spread([run.score('novel_views', 'ssim') for run in runs], 4)} | {times} |")
    plain, planned = seconds.values()
    ratios = sorted(second / first for first, second in zip(plain, planned))
    lines.append("\nTime over that of `odgs`, seed by seed: " + ", ".join(f"{ratio:.3f}" for ratio in ratios) + ".")
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
        text.append(f"![PSNR of novel views over processor seconds of training](../images/dynamic-curve-{number}.svg)\n")
    text.append((folder / "curves.md").read_text().strip())
    return "\n".join(text)


def main():
    folder, page = Path(sys.argv[1]), Path(sys.argv[2])
    found = runs_of(folder / "results")
    for scene, methods in runs_of(folder / "full", ", plan full").items():
        found[scene].update(methods)
    any_run = next(run for methods in found.values() for runs in methods.values() for run in runs)
    parts = [BEGIN, f"{any_run.run['iterations']} iterations, images of "
             f"{'x'.join(map(str, any_run.result['scored_size']))}, one thread per run, {machine()}, shared with other "
             "work: processor seconds compare the rows of a table. Where a method has several seeds, the mean and "
             "half of the range stand here.\n"]
    for scene in sorted(found):
        parts += [f"**{scene.split('/')[0]}**, PSNR and SSIM of novel views unless it says input\n",
                  scene_table(found[scene]), ""]
    parts += ["### Where nothing moves\n", still_table(folder), ""]
    parts += ["### Ablation\n", (folder / "ablation/ablation.md").read_text().strip(), ""]
    parts += ["### Error against run time\n", curves(folder, page), END]
    text = page.read_text()
    before, rest = text.split(BEGIN, 1)
    page.write_text(before + "\n".join(parts) + rest.split(END, 1)[1])


main()
