"""Compares two passes of `omnilife bench run` and prints docs/results/benchmark.md.

    python3 scripts/results/benchmark_page.py FOLDER

FOLDER is what scripts/results/benchmark filled. Exits with 1, naming every difference, where the
passes do not have the same scores: the tables of the views byte for byte, and of every result.json
everything but what a run costs.
"""

import csv
import json
import sys
from pathlib import Path

# What differs between two runs that compute the same: time, memory, and who scored.
COSTS = ["training_seconds", "rendering_seconds", "peak_memory_bytes"]
INTRODUCTION = """# The whole benchmark, small

`omnilife bench run` on three scenes, under both protocols, with two methods that train, `sphere-sweep`, the three baselines and a method that is not ours (`scripts/examples/light_field`), twice. It shows that all of it works and that scores repeat. **It ranks nobody**: the budget is {iterations} iterations instead of 30,000, images are {width} pixels wide, and there are {frames} frames a scene, so that neighbours are up to a third of a second apart.

```sh
scripts/setup --sfm --models --example
scripts/results/benchmark RENDERED_HALL TUNNEL_VIDEO
```

`street` is the sample in the repository, `hall` a rendering of the same kind (poses and masks given for both), `tunnel` real footage with poses from structure from motion and without masks. Three videos are far too few for intervals, which stand here because the tables have them. Training times are wall-clock seconds; on a machine that has other work to do they say nothing.
"""


def scores(result):
    record = json.loads(result.read_text())
    for cost in COSTS:
        record.pop(cost, None)
    return json.dumps(record, sort_keys=True)


def differences(first, second):
    """Paths, relative to the passes, whose scores are not the same, and how many were compared."""
    compared, different = 0, []
    files = {path.relative_to(folder) for folder in (first, second) for path in folder.glob("scenes/**/score/*")}
    for file in sorted(files):
        paths = [folder / file for folder in (first, second)]
        if file.name == "result.json":
            same = all(path.exists() for path in paths) and scores(paths[0]) == scores(paths[1])
        elif file.suffix == ".parquet":
            same = all(path.exists() for path in paths) and paths[0].read_bytes() == paths[1].read_bytes()
        else:
            continue
        compared += 1
        if not same:
            different.append(str(file))
    return compared, different


def outcomes(folder):
    with open(folder / "outcomes.csv", newline="") as file:
        return list(csv.DictReader(file))


def machine():
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{len(names)} threads of {names[0]}" if names else "an unknown processor"


def table(path):
    """A table of the leaderboard, its headings two levels down."""
    lines = path.read_text().splitlines()
    return "\n".join("##" + line if line.startswith("#") else line for line in lines).strip()


def main():
    folder = Path(sys.argv[1])
    first, second = folder / "pass-1", folder / "pass-2"
    compared, different = differences(first, second)
    if different or not compared:
        sys.exit("benchmark: not the same scores: " + (", ".join(different) or "none at all"))
    runs = outcomes(first)
    frames, widths, iterations = set(), set(), set()
    for split in first.glob("scenes/**/split.json"):
        record = json.loads(split.read_text())
        if record["protocol"]["id"] == "per-scene":
            frames.add(len(record["input_views"]) + len(record["novel_views"]))
    for result in first.glob("scenes/**/score/result.json"):
        record = json.loads(result.read_text())
        widths.add(record["scored_size"][0])
        iterations.add(record["iterations"])
    print(INTRODUCTION.format(
        iterations=max(filter(None, iterations)), width=max(widths),
        frames=f"{min(frames)} to {max(frames)}"))
    scored = [run for run in runs if run["outcome"] == "scored"]
    print("## Repetition\n")
    print(f"{len(scored)} of {len(runs)} runs were scored. The two passes, in folders of their own, gave the same "
          f"scores: {compared} files, the tables of all views byte for byte, and every `result.json` but for "
          f"{', '.join(f'`{cost}`' for cost in COSTS)}.\n")
    costs = sorted(folder.glob("pass-*.time"))
    if costs:
        minutes = [sum(map(float, cost.read_text().split()[:2])) / 60 for cost in costs]
        print("A pass took " + " and ".join(f"{each:.1f}" for each in minutes) +
              f" processor minutes on {machine()}; the machine was shared with other work.\n")
    notes = [run for run in runs if run["reason"]]
    if notes:
        print("What was not scored:\n")
        for run in notes:
            print(f"- {run['scene']}, {run['protocol']}, {run['method']}: {run['reason']}")
        print()
    for folder_of_protocol in sorted((first / "leaderboard/tables").iterdir()):
        name = folder_of_protocol.name.rsplit("-", 2)[0]
        print(f"## Protocol {name}\n")
        for layout in ("views.md", "feed-forward.md"):
            if (folder_of_protocol / layout).exists():
                print(table(folder_of_protocol / layout) + "\n")


main()
