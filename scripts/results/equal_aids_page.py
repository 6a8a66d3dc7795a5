"""Puts the tables of scripts/results/equal_aids into docs/results/benchmark.md, between its two markers.

    python3 scripts/results/equal_aids_page.py FOLDER PAGE

FOLDER is what scripts/results/equal_aids filled.
"""

import csv
import sys
from collections import defaultdict
from pathlib import Path
from statistics import mean

from benchmark_page import METHODS, Run, machine

BEGIN, END = "<!-- equal aids: begin -->", "<!-- equal aids: end -->"
# Heading, metric, digits, sign of better scores.
SCORES = [("PSNR", "psnr", 2, 1), ("dynamic PSNR", "psnr-dynamic", 2, 1), ("SSIM", "ssim", 4, 1),
          ("LPIPS-VGG", "lpips-vgg", 4, -1)]
AIDS = {"default": "aids", "bare": "none"}
# CPU seconds of training at which methods are compared.
TIMES = [10, 20, 30]


def grid(headings, rows):
    lines = ["| " + " | ".join(headings) + " |", "|---|---|" + "---:|" * (len(headings) - 2)]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def by_scene(runs, value):
    """The mean over seeds of each scene; scenes in which a run has no such value are left out."""
    values = defaultdict(list)
    for run in runs:
        values[run.scene].append(value(run))
    return {scene: mean(found) for scene, found in values.items() if None not in found}


def best(cells, sign):
    """The texts of the cells, the best one bold; a missing value is a dash."""
    known = [value for value, _ in cells if value is not None]
    most = max((sign * value for value in known), default=None)
    return [text if value is None or sign * value < most else f"**{text}**" for value, text in cells]


def column(groups, value, digits, sign):
    """Cells of one column: means over the scenes that all methods with these aids have."""
    found = [by_scene(runs, value) for runs in groups]
    scenes = set.intersection(*map(set, found)) if found else set()
    means = [mean(values[scene] for scene in scenes) if scenes else None for values in found]
    cells = [(each, "-" if each is None else f"{each:.{digits}f}") for each in means]
    return best(cells, sign) if sign else [text for _, text in cells]


def scores(runs):
    """A row for each method with and without aids: means over scenes."""
    rows = []
    for aids, title in AIDS.items():
        groups = [[run for run in runs[aids] if run.method.removesuffix("-without-aids") == method] for method in METHODS]
        columns = [column(groups, lambda run, metric=metric: run.score("novel_views", metric), digits, sign)
                   for _, metric, digits, sign in SCORES]
        columns.append(column(groups, Run.cpu_seconds, 0, 0))
        rows += [[method, title, *cells] for method, *cells in zip(METHODS, *columns)]
    return grid(["Method", "Aids", *(heading for heading, *_ in SCORES), "CPU s"], rows)


def points_of(folder, protocol):
    """PSNR over CPU seconds of each run, by method with its aids, scene and seed."""
    curves = defaultdict(list)
    with open(folder / f"curves/{protocol}/points.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["psnr_db"]:
                curves[row["method"], row["scene"], row["seed"]].append((float(row["seconds"]), float(row["psnr_db"])))
    return {run: sorted(points) for run, points in curves.items()}


def at(points, seconds):
    """The PSNR of the last point at or before so many seconds; none before the first one."""
    before = [psnr for time, psnr in points if time <= seconds]
    return before[-1] if before else None


def times(curves):
    """A row for each method with and without aids: mean PSNR at equal CPU time over scenes and seeds."""
    rows = []
    for suffix, title in (("", "aids"), ("-without-aids", "none")):
        groups = [{key[1:]: points for key, points in curves.items() if key[0] == method + suffix} for method in METHODS]
        columns = []
        for seconds in TIMES:
            found = [{run: at(points, seconds) for run, points in group.items()} for group in groups]
            common = [run for run in (found[0] if found else []) if all(values.get(run) is not None for values in found)]
            means = [mean(values[run] for run in common) if common else None for values in found]
            columns.append(best([(each, "-" if each is None else f"{each:.2f}") for each in means], 1))
        rows += [[method, title, *cells] for method, *cells in zip(METHODS, *columns)]
    return grid(["Method", "Aids", *(f"PSNR at {seconds} s" for seconds in TIMES)], rows)


def scenes(runs):
    """PSNR of each scene with aids, with half of the range over seeds."""
    names = sorted({run.scene for run in runs})
    rows = []
    for method in METHODS:
        cells = []
        for scene in names:
            values = [run.score("novel_views", "psnr") for run in runs if run.scene == scene and run.method == method]
            values = [value for value in values if value is not None]
            half = (max(values) - min(values)) / 2 if values else 0
            cells.append("-" if not values else f"{mean(values):.2f}" + (f" ± {half:.2f}" if len(values) > 1 else ""))
        rows.append([method, "aids", *cells])
    return grid(["Method", "Aids", *names], rows)


def main():
    folder, page = Path(sys.argv[1]), Path(sys.argv[2])
    parts, every = [], []
    for protocol in ("per-scene", "sparse-interpolation"):
        runs = {aids: [Run(file) for file in sorted((folder / "results" / protocol / aids).glob("**/score/result.json"))]
                for aids in AIDS}
        every += runs["default"] + runs["bare"]
        seeds = sorted({run.seed for run in runs["default"]})
        of_seeds = "one seed" if len(seeds) == 1 else f"{len(seeds)} seeds"
        parts += [f"**Protocol `{protocol}`**, novel views, means over scenes, {of_seeds}:", scores(runs),
                  "At equal CPU time, by the last point of each curve at or before it:", times(points_of(folder, protocol)),
                  "By scene:", scenes(runs["default"])]
        for aids, title in (("default", "with the aids of both"), ("bare", "without aids")):
            for method in METHODS[:3]:
                text = (folder / f"compare-{protocol}-{aids}-{method}.txt").read_text().strip()
                parts += [f"`omni4dgs-plus` against `{method}`, {title}, {protocol}:", f"```\n{text}\n```"]
    commits = sorted({run.record["versions"].get("omnilife commit", "?") for run in every})
    iterations = sorted({run.record["iterations"] for run in every})
    title = (f"{' and '.join(map(str, iterations))} iterations, {machine()}, one core per run; commit "
             f"{', '.join(commits)}. {len(every)} runs.")
    before, rest = page.read_text().split(BEGIN, 1)
    _, after = rest.split(END, 1)
    page.write_text(before + BEGIN + "\n" + "\n\n".join([title, *parts]) + "\n" + END + after)


if __name__ == "__main__":
    main()
