"""Puts the tables of scripts/results/benchmark into docs/results/benchmark.md, between its two markers.

    python3 scripts/results/benchmark_page.py FOLDER PAGE

FOLDER is what scripts/results/benchmark filled. Exits with 1 where the run that was made twice does not have
the same scores both times.
"""

import json
import shutil
import sys
from pathlib import Path

import aids

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
METHODS = ["odgs", "periodic", "omni4dgs", "omni4dgs-plus"]
# Each as it is, and without the aids that any method can have.
TRAINED = [f"{method}{aids}" for aids in ("", "-without-aids") for method in METHODS]
TWO_VIEW = ["sphere-sweep", "infinity-homography", "cross-fade", "nearest-input"]
# On the first four constants were set, or methods compared, before; nobody had looked at what a method makes
# of the last two.
SCENES = ["street", "hall", "tunnel", "reef", "unseen-00", "unseen-04"]
UNSEEN = SCENES[4:]
# Heading, views, metric, digits.
SCORES = [("Input PSNR", "input_views", "psnr", 2), ("PSNR", "novel_views", "psnr", 2),
          ("SSIM", "novel_views", "ssim", 4), ("LPIPS-VGG", "novel_views", "lpips-vgg", 4),
          ("Static PSNR", "novel_views", "psnr-static", 2), ("Dynamic PSNR", "novel_views", "psnr-dynamic", 2)]
# What differs between two runs that compute the same: time, memory, and who scored.
COSTS = ["training_seconds", "rendering_seconds", "peak_memory_bytes"]


class Run:
    """A run with its scores."""

    def __init__(self, result):
        self.result = json.loads(result.read_text())
        self.record = json.loads((result.parents[1] / "run/run.json").read_text())
        self.method, self.seed = self.result["method"], self.result["seed"]
        self.scene = self.result["scene"].split("/")[0]
        self.protocol = self.result["protocol"].split("/")[0]

    def score(self, views, metric):
        return (self.result[views].get(metric) or {}).get("mean")

    def gap(self):
        both = [self.score(views, "psnr") for views in ("input_views", "novel_views")]
        return None if None in both else both[0] - both[1]

    def cpu_seconds(self):
        return self.record.get("training_cpu_seconds")


def mean(values):
    values = [value for value in values if value is not None]
    return sum(values) / len(values) if values else None


def cell(values, digits):
    """The mean, and half of the range where there are several."""
    values = [value for value in values if value is not None]
    if not values:
        return "-"
    half = (max(values) - min(values)) / 2
    return f"{mean(values):.{digits}f}" + (f" ± {half:.{digits}f}" if len(values) > 1 else "")


def table(runs, methods):
    """One scene: a row per method, over its seeds."""
    headings = [heading for heading, *_ in SCORES] + ["Input less novel PSNR", "Gaussians", "CPU s"]
    lines = ["| Method | " + " | ".join(headings) + " |", "|---" + "|---:" * len(headings) + "|"]
    for method in methods:
        found = [run for run in runs if run.method == method]
        if not found:
            continue
        cells = [cell([run.score(views, metric) for run in found], digits) for _, views, metric, digits in SCORES]
        cells += [cell([run.gap() for run in found], 2),
                  cell([run.record.get("primitives") for run in found[:1]], 0),
                  cell([run.cpu_seconds() for run in found], 0)]
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def summary(runs, methods):
    """Means over the scenes that all of the methods have finished, every scene with the same weight, first
    seed."""
    first = {(run.method, run.scene) for run in runs if run.seed == 0}
    complete = [scene for scene in SCENES if all((method, scene) in first for method in methods
                                                 if any(run.method == method for run in runs))]
    groups = [("all six" if complete == SCENES else f"{len(complete)} scenes", complete)]
    if set(UNSEEN) <= set(complete):
        groups.append(("the two unseen", UNSEEN))
    headings = [f"{heading}, {group}" for group, _ in groups for heading in ("PSNR", "SSIM", "LPIPS-VGG", "CPU s")]
    lines = ["| Method | " + " | ".join(headings) + " |", "|---" + "|---:" * len(headings) + "|"]
    for method in methods:
        if not any(run.method == method for run in runs):
            continue
        cells = []
        for _, scenes in groups:
            found = [run for run in runs if run.method == method and run.scene in scenes and run.seed == 0]
            for metric, digits in (("psnr", 2), ("ssim", 4), ("lpips-vgg", 4)):
                cells.append(f"{mean([run.score('novel_views', metric) for run in found]):.{digits}f}")
            cells.append(cell([mean([run.cpu_seconds() for run in found])], 0))
        lines.append(f"| {method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def scores(result):
    record = json.loads(result.read_text())
    for cost in COSTS:
        record.pop(cost, None)
    return json.dumps(record, sort_keys=True)


def repeated(folder):
    """Whether the run that was made twice has the same scores, all views too; None where it was not yet."""
    pattern = "**/street/**/omni4dgs-plus/seed-0/score/result.json"
    pair = [next((folder / part).glob(pattern), None) for part in ("results/per-scene", "again")]
    if None in pair:
        return None
    views = [file.with_name("frames.csv").read_bytes() for file in pair]
    return scores(pair[0]) == scores(pair[1]) and views[0] == views[1]


def machine():
    names = [line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
             if line.startswith("model name")]
    return f"{len(names)} cores of an {names[0]}" if names else "an unknown machine"


def main():
    folder, page = Path(sys.argv[1]), Path(sys.argv[2])
    same = repeated(folder)
    if same is False:
        sys.exit("benchmark: the run that was made twice has not the same scores")
    results = sorted((folder / "results").glob("**/score/result.json"))
    runs = [Run(result) for result in results if (result.parents[1] / "run/run.json").exists()]
    commits = sorted({run.record["versions"].get("omnilife commit", "?") for run in runs})
    iterations = sorted({run.record["iterations"] for run in runs if run.method in TRAINED})
    parts = [f"{' and '.join(map(str, iterations))} iterations, {machine()}, one core per run; commit "
             f"{', '.join(commits)}. {len(runs)} runs."]
    if same:
        parts[0] += " `omni4dgs-plus` on `street`, trained and scored once more, had the same scores in every view."
    for protocol, heading in (("per-scene", "Protocol per-scene"), ("sparse-interpolation", "Protocol sparse-interpolation")):
        of_protocol = [run for run in runs if run.protocol == protocol]
        if not of_protocol:
            continue
        parts += [f"## {heading}", "Mean over scenes, novel views, seed 0:", summary(of_protocol, TRAINED),
                  *filter(None, aids.lines([(f"`{run.method}`", run.record) for run in of_protocol if run.seed == 0]))]
        if protocol == "sparse-interpolation":
            parts += ["Methods that see two views at a time, a class of their own:", summary(of_protocol, TWO_VIEW)]
        for scene in SCENES:
            found = [run for run in of_protocol if run.scene == scene]
            if not found:
                continue
            parts += [f"**{scene}**", table(found, TRAINED + TWO_VIEW)]
    parts += ["## Error against run time", "[Every point as CSV](benchmark-curves.csv)."]
    shutil.copy(folder / "curves/points.csv", page.with_name("benchmark-curves.csv"))
    for number, image in enumerate(sorted((folder / "curves").glob("*.svg"))):
        name = f"benchmark-curve-{number}.svg"
        shutil.copy(image, page.parents[1] / "images" / name)
        parts.append(f"![PSNR of novel views over CPU seconds of training](../images/{name})")
    parts.append((folder / "curves.md").read_text().strip())
    text = page.read_text()
    before, rest = text.split(BEGIN, 1)
    _, after = rest.split(END, 1)
    page.write_text(before + BEGIN + "\n" + "\n\n".join(parts) + "\n" + END + after)


if __name__ == "__main__":
    main()
