"""Puts the tables of scripts/results/equal_aids into docs/results/benchmark.md, between its two markers.

    python3 scripts/results/equal_aids_page.py FOLDER PAGE

FOLDER is what scripts/results/equal_aids filled, $OMNILIFE the program that compares.
"""

import csv
import os
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from statistics import mean

from aids import differing
from benchmark_page import Run, cell, machine

BEGIN, END = "<!-- equal aids: begin -->", "<!-- equal aids: end -->"
# The last one is compared with the others.
METHODS = ["odgs", "panogs", "periodic", "omni4dgs", "omni4dgs-plus"]
# Heading, metric, digits, sign of better scores.
SCORES = [("PSNR", "psnr", 2, 1), ("dynamic PSNR", "psnr-dynamic", 2, 1), ("SSIM", "ssim", 4, 1),
          ("LPIPS-VGG", "lpips-vgg", 4, -1)]
AIDS = {"default": "default", "all": "all", "bare": "none"}
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
    for aids, of_aids in runs.items():
        groups = [of_aids[method] for method in METHODS]
        columns = [column(groups, lambda run, metric=metric: run.score("novel_views", metric), digits, sign)
                   for _, metric, digits, sign in SCORES]
        columns.append(column(groups, Run.cpu_seconds, 0, 0))
        rows += [[method, AIDS[aids], *cells] for method, *cells in zip(METHODS, *columns)]
    return grid(["Method", "Aids", *(heading for heading, *_ in SCORES), "CPU s"], rows)


def points_of(folder, protocol, aids):
    """PSNR over CPU seconds of each run with these aids, by method with its aids, scene and seed."""
    curves = defaultdict(list)
    with open(folder / f"curves/{protocol}/{aids}/points.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["psnr_db"]:
                curves[row["method"], row["scene"], row["seed"]].append((float(row["seconds"]), float(row["psnr_db"])))
    return {run: sorted(points) for run, points in curves.items()}


def at(points, seconds):
    """The PSNR of the last point at or before so many seconds; none before the first one."""
    before = [psnr for time, psnr in points if time <= seconds]
    return before[-1] if before else None


def times(runs, folder, protocol):
    """A row for each method with and without aids: mean PSNR at equal CPU time over scenes and seeds."""
    rows = []
    for aids, of_aids in runs.items():
        columns, curves = [], points_of(folder, protocol, aids)
        for seconds in TIMES:
            found = [{(run.scene, run.seed): at(curves[run.method, run.result["scene"], str(run.seed)], seconds)
                      for run in of_aids[method]} for method in METHODS]
            common = [run for run in found[0] if all(values.get(run) is not None for values in found)]
            means = [mean(values[run] for run in common) if common else None for values in found]
            columns.append(best([(each, "-" if each is None else f"{each:.2f}") for each in means], 1))
        rows += [[method, AIDS[aids], *cells] for method, *cells in zip(METHODS, *columns)]
    return grid(["Method", "Aids", *(f"PSNR at {seconds} s" for seconds in TIMES)], rows)


def compare(folder, scenes_of):
    """A row for each other method: `bench compare` of omni4dgs-plus against it in novel views of its scenes."""
    rows = []
    for method, scenes in scenes_of.items():
        with tempfile.TemporaryDirectory() as links:
            for one in (METHODS[-1], method):
                (Path(links) / one).mkdir()
                for scene in scenes:
                    (Path(links) / one / scene).symlink_to((folder / one / "scenes" / scene).resolve())
            command = [os.environ["OMNILIFE"], "--quiet", "bench", "compare", *(Path(links) / one for one in (METHODS[-1], method))]
            text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        cells = []
        for _, metric, digits, _ in SCORES:
            found = re.search(rf"^novel {metric} +\S+ +\S+ +(\S+) +\[(\S+), (\S+)\]", text, re.MULTILINE)
            difference = [f"{float(value):+.{digits}f}" for value in found.groups()] if found else None
            cells.append(f"{difference[0]} [{difference[1]}, {difference[2]}]" if difference else "-")
        rows.append([f"`omni4dgs-plus` less `{method}`", *cells])
    return rows


def comparisons(folder, runs, excluded):
    """Rows of pairs: scenes that both methods have, with default aids those in which both had the same ones."""
    rows = []
    for aids, of_aids in runs.items():
        names = {method: sorted({run.scene for run in found} & {run.scene for run in of_aids[METHODS[-1]]}
                                - {scene for scene, methods in excluded.items() if aids == "default" and method in methods})
                 for method, found in of_aids.items() if method != METHODS[-1]}
        pairs = {method: scenes for method, scenes in names.items() if len(scenes) > 1}
        for (difference, *cells), scenes in zip(compare(folder / aids, pairs), pairs.values()):
            rows.append([difference, AIDS[aids], *cells, str(len(scenes))])
    return grid(["Difference", "Aids", *(heading for heading, *_ in SCORES), "Clips"], rows)


def unequal(of_aids):
    """The scenes in which methods used other aids than omni4dgs-plus: the aids by method."""
    found = defaultdict(lambda: defaultdict(set))
    for one in of_aids[METHODS[-1]]:
        for method in METHODS:
            for other in (run for run in of_aids[method] if (run.scene, run.seed) == (one.scene, one.seed)):
                aids = differing(one.record, other.record)
                if aids:
                    found[one.scene][method].update(aids)
    return found


def scenes(of_aids, aids):
    """PSNR of each scene with aids, with half of the range over seeds."""
    names = sorted({run.scene for run in of_aids[METHODS[-1]]})
    rows = [[method, AIDS[aids], *(cell([run.score("novel_views", "psnr") for run in of_aids[method] if run.scene == scene], 2)
                                   for scene in names)] for method in METHODS]
    return grid(["Method", "Aids", *names], rows)


def without_score(runs):
    """A line on the units of scenes and seeds without a score, which the means leave out; the terminal shows it too."""
    every = {run.scene for of_aids in runs.values() for found in of_aids.values() for run in found}
    seeds = {aids: {run.seed for found in of_aids.values() for run in found} for aids, of_aids in runs.items()}
    missing = [f"`{method}` ({AIDS[aids]}) on {scene}, seed {seed}" for aids, of_aids in runs.items()
               for method, found in of_aids.items()
               for scene, seed in sorted({(scene, seed) for scene in every for seed in seeds[aids]}
                                         - {(run.scene, run.seed) for run in found})]
    if not missing:
        return []
    line = f"Without a score, and left out of the means: {'; '.join(missing)}."
    print(line, file=sys.stderr)
    return [line]


def tables(folder, protocol, runs):
    """The parts of one protocol. Means leave out scenes in which plans gave methods different aids."""
    aided = next(aids for aids in runs if aids != "bare")
    excluded = unequal(runs["default"]) if "default" in runs else {}
    equal = {aids: {method: [run for run in found if aids != "default" or run.scene not in excluded]
                    for method, found in of_aids.items()} for aids, of_aids in runs.items()}
    seeds = {aids: len({run.seed for run in of_aids[METHODS[-1]]}) for aids, of_aids in runs.items()}
    seeds = ", ".join(f"{count} seed{'s' * (count > 1)} with aids {AIDS[aids]}" for aids, count in seeds.items())
    left_out = "; ".join(f"`{scene}` ({', '.join(f'`{method}`' for method in methods)}: "
                         f"{', '.join(sorted(set().union(*methods.values())))})" for scene, methods in excluded.items())
    note = (" Means with default aids leave out scenes in which a method's plan gave it others than that of "
            f"`omni4dgs-plus`, and so does the difference from that method: {left_out}." if excluded else "")
    return [f"**Protocol `{protocol}`**, novel views, means over scenes; {seeds}.{note}",
            scores(equal), *without_score(runs),
            "Paired differences with 95 % intervals over clips:", comparisons(folder / "results" / protocol, runs, excluded),
            "At equal CPU time, by the last point of each curve at or before it:",
            times(equal, folder, protocol),
            "By scene, PSNR:", scenes(runs[aided], aided)]


def main():
    folder, page = Path(sys.argv[1]), Path(sys.argv[2])
    parts, every = [], []
    for protocol in ("per-scene", "sparse-interpolation"):
        runs = {}
        for aids in (aids for aids in AIDS if (folder / "results" / protocol / aids).is_dir()):
            runs[aids] = {method: [Run(file) for file in sorted(
                (folder / "results" / protocol / aids / method).glob("**/score/result.json"))
                if (file.parents[1] / "run/run.json").exists()] for method in METHODS}
            every += [run for found in runs[aids].values() for run in found]
        parts += tables(folder, protocol, runs)
    commits = sorted({run.record["versions"].get("omnilife commit", "?") for run in every})
    iterations = sorted({run.record["iterations"] for run in every})
    title = (f"{' and '.join(map(str, iterations))} iterations, {machine()}, one core per run; commit "
             f"{', '.join(commits)}. {len(every)} runs.")
    before, rest = page.read_text().split(BEGIN, 1)
    _, after = rest.split(END, 1)
    page.write_text(before + BEGIN + "\n" + "\n\n".join([title, *parts]) + "\n" + END + after)


if __name__ == "__main__":
    main()
