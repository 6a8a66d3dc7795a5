"""Puts the tables of scripts/results/panogs into docs/results/panogs.md, between its two markers.

    panogs_page.py FOLDER SECONDS SEEDS

FOLDER is what scripts/results/panogs filled, SECONDS the CPU seconds at which methods were compared, SEEDS those
beside seed 0.
"""

import json
import shutil
import sys
from pathlib import Path

import aids

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
REPOSITORY = Path(__file__).resolve().parents[2]
PAGE = REPOSITORY / "docs/results/panogs.md"
CURVE = REPOSITORY / "docs/images/panogs-curve.svg"
PUBLISHED = REPOSITORY / "leaderboard/published/panogs.json"
COMPONENTS = [
    ("lifted, all samples", "all-samples"), ("lifted, finest samples", "finest-samples"),
    ("and warm-start", "warm-start"), ("and centre refinement", "centres"),
    ("the same, held to the scaffold", "centres-scaffold"),
    ("warm-start, centre and shape refinement: as the plan decides", "plan"),
    ("warm-start and shape refinement, centres stay", "fixed"), ("`odgs`", "odgs"),
    ("as the plan decides, without aids", "plan-bare"), ("`odgs` without aids", "odgs-bare")]
EQUAL_TIME = [("as published: sizes and rotations stay", "panogs"), ("as the plan decides", "plan"),
              ("shape refinement, centres stay", "fixed"), ("`odgs`", "odgs")]


def read(path):
    return json.loads(Path(path).read_text())


def table(heads, rows):
    lines = ["| " + " | ".join(heads) + " |", "|---" + "|---:" * (len(heads) - 1) + "|"]
    return lines + ["| " + " | ".join(row) + " |" for row in rows]


def scores(folder):
    """PSNR, PSNR of what does not move, and SSIM of the novel views."""
    views = read(folder / "result.json")["novel_views"]
    static = views.get("psnr-static")
    return [f"{views['psnr']['mean']:.2f}", f"{static['mean']:.2f}" if static else "-",
            f"{views['ssim']['mean']:.4f}"]


HEADS = ["Run", "Novel PSNR", "static", "SSIM", "Ghosts, %", "Holes, %", "Gaussians", "Iterations", "CPU s",
         "of it planning", "Memory, MB"]


def row(title, folder):
    run = read(folder / "run.json")
    iterations = run["iterations"] if run["iterations"] > 1 else "1, nothing learns"
    known = run.get("surfaces") or {}
    faults = [f"{100 * known[name]:.2f}" if known.get(name) is not None else "-"
              for name in ("ghost_share", "novel_hole_share")]
    return [title, *scores(folder / "score"), *faults, f"{run['primitives']:,}", str(iterations),
            f"{run['training_cpu_seconds']:.1f}", f"{run['planning_cpu_seconds']:.1f}",
            f"{run['peak_memory_bytes'] / 1e6:.0f}"]


def aids_of(folder, runs):
    """The aids of the rows of a table."""
    return aids.lines([(title, read(folder / name / "run.json")) for title, name in runs])


def spread(folder, within, seeds):
    """PSNR of the novel views over seeds: mean and the whole range."""
    rows = []
    for title, name in EQUAL_TIME:
        runs = [folder / f"{name}-{within}"] + [folder / f"{name}-{within}-seed-{seed}" for seed in seeds]
        values = [[float(value) for value in scores(run / "score")] for run in runs]
        columns = list(zip(*values, strict=True))
        text = [f"{sum(column) / len(column):.{digits}f} ({min(column):.{digits}f} to {max(column):.{digits}f})"
                for column, digits in zip(columns, (2, 2, 4), strict=True)]
        rows.append([title, *text])
    return [f"Over the seeds 0, {', '.join(seeds)} at {within} CPU seconds, mean and range:", "",
            *table(["Run", "Novel PSNR", "static", "SSIM"], rows), ""] if seeds else []


def shards(folder):
    """What training in shards takes, ten steps each."""
    rows = []
    for what, name in (("a million", "million"), ("one sample per pixel", "all")):
        for title, number in (("all at once", "1"), ("in 8 shards", "8")):
            run = read(folder / f"{name}-in-{number}" / "run.json")
            steps = run["training_cpu_seconds"] - run["planning_cpu_seconds"]
            rows.append([f"{what}, {title}", f"{run['primitives']:,}", f"{run['peak_memory_bytes'] / 1e9:.2f}",
                         f"{steps / run['iterations']:.2f}", scores(folder / f"{name}-in-{number}" / "score")[0]])
    plan_of = read(folder / "all-in-8/run.json")["plan"]
    reason = next(one["reason"] for one in plan_of if one["component"] == "shards")
    return ["## Shards", "", "Ten steps of the warm-start; the peak is that of the whole process, planning and "
            "evaluation included:", "",
            *table(["Gaussians", "Number", "Peak, GB", "CPU s a step", "Novel PSNR"], rows), "",
            f"What the plan says of the last row: {reason}.", ""]


def near(folders):
    """What the plan says of shards that learn from the views near their own cameras alone."""
    reasons = []
    for folder in folders:
        plan_of = read(folder / "near/run.json")["plan"]
        reason = next(one["reason"] for one in plan_of if one["component"] == "neighbour-views")
        reasons.append(f"- {title_of(folder)}: {reason}")
    return ["## Neighbour views", "", "What the plan says where the component is asked for, with eight shards:", "",
            *reasons, ""]


def title_of(folder):
    return "hall" if folder.name == "components" else folder.name


def further(folder, head, note):
    """Another scene: as published, as the plan decides, and `odgs` beside it, at as many iterations."""
    split = read(folder / "split.json")
    runs = [("as published: sizes and rotations stay", "published"), ("as the plan decides", "plan"),
            ("shape refinement, centres stay", "fixed"), ("`odgs`", "odgs"),
            ("as the plan decides, without aids", "plan-bare"), ("`odgs` without aids", "odgs-bare")]
    return [f"## {head}", "",
            f"{note} {len(split['input_views'])} views given, {len(split['novel_views'])} novel.", "",
            *table(HEADS, [row(title, folder / name) for title, name in runs]), *aids_of(folder, runs), "",
            *plan(folder / "plan"), ""]


def plan(folder):
    """What was decided, and on what evidence."""
    rows = [[f"`{one['component']}`", "yes" if one["used"] else "no", one["reason"]]
            for one in read(folder / "run.json")["plan"]]
    return ["| Component | Used | Why |", "|---|---|---|"] + ["| " + " | ".join(one) + " |" for one in rows]


def levels(asset):
    record = read(asset / "asset.json")
    rows = []
    for level in record["levels"]:
        name = level["name"]
        rows.append([name, f"{level['splats']:,}", f"{level['bytes'] / 1e6:.2f}", f"{level['growth']:.2f}",
                     *scores(asset / "scores" / name.lower())])
    user, system = map(float, asset.with_suffix(".time").read_text().split())
    changes = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in record["changes"].items()
                        if count and name != "dropped_sh_degree")
    notes = [f"All levels took {user + system:.1f} CPU seconds to export ({record['wall_seconds']:.1f} s of wall "
             f"clock). Changed for viewers: {changes or 'nothing'}."]
    notes += [f"{reason[0].upper()}{reason[1:]}." for reason in record["left_out"]]
    heads = ["Level", "Gaussians", "MB", "Growth", "Novel PSNR", "static", "SSIM"]
    return table(heads, rows) + ["", " ".join(notes)]


def curves(file):
    """The table of `bench curve`, its rows, which have the names of methods, named as the runs are."""
    lines = file.read_text().strip().splitlines()
    begin = 1 + next(at for at, line in enumerate(lines) if line.startswith("| ---"))
    end = begin + len(EQUAL_TIME)
    rows = zip(lines[begin:end], EQUAL_TIME, strict=True)
    rows = [f"| {title} |" + line.split("|", 2)[2] for line, (title, _) in rows]
    return lines[:begin] + rows + lines[end:]


def published():
    """The rows of the paper's Table 2: seeds, size and export time."""
    by_number = {one["number"]: one for one in read(PUBLISHED)["tables"]}
    rows = [[one["cells"][0], f"{one['cells'][1]:,}", f"{one['cells'][5]:.2f}", f"{one['cells'][6]:.3f}"]
            for one in by_number[2]["rows"]]
    return table(["PanoGS, Table 2", "Full native", "MB", "Export, s"], rows)


def large(folder):
    every, finest = folder / "every-pixel", folder / "finest-samples"
    scene = read(folder / "scene.json")
    views = len(read(folder / "split.json")["input_views"])
    width, height = scene["camera"]["width"], scene["camera"]["height"]
    pixels = views * width * height
    summary = next(text for text in read(every / "run.json")["warnings"] if " samples of " in text)
    finest_cpu = read(finest / "run.json")["planning_cpu_seconds"]
    return [
        f"## One sample per pixel of {views} panoramas of {width}x{height}", "",
        f"{views} x {width} x {height} = {pixels:,} pixels. {summary[0].upper()}{summary[1:]}. The images are "
        "those of the rendering, enlarged, and the distances refined to them. The rows show the cost of as many "
        "Gaussians as the paper's assets have. The images have no more detail, so their scores tell only the order "
        "of the levels.", "",
        *table(HEADS, [row("one sample per pixel", every), row("finest samples", finest)]), "",
        f"Refinement of distances, normals, lift, and the choice among {views} views take {finest_cpu:.1f} CPU "
        "seconds of planning.", "",
        *levels(folder / "every-pixel-asset"), "", *published()]


def machine():
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{len(names)} threads of {names[0]}" if names else "an unknown CPU"


def main():
    folder, seconds, seeds = Path(sys.argv[1]), sys.argv[2].split(), sys.argv[3].split()
    components, last = folder / "components", seconds[-1]
    split = read(components / "split.json")
    camera = read(components / "scene.json")["camera"]
    shutil.copy(components / "curves/curve-0.svg", CURVE)
    equal = [row(f"{within} CPU s: {title}", components / f"{name}-{within}")
             for within in seconds for title, name in EQUAL_TIME]
    text = [
        f"{len(split['input_views'])} views given, {len(split['novel_views'])} novel, {camera['width']}x"
        f"{camera['height']}, protocol `{split['protocol']['id']}`. Seed 0 where nothing else is said. {machine()}, other work "
        "beside it: CPU seconds (user and system, planning included, evaluation left out) are what compares.", "",
        "## What each component is worth", "",
        *table(HEADS, [row(title, components / name) for title, name in COMPONENTS]),
        *aids_of(components, COMPONENTS), "",
        "## At equal CPU seconds", "",
        "Iterations are those that fit at the pace of the runs above; schedules shrink to them.", "",
        *table(HEADS, equal), "",
        *spread(components, seconds[0], seeds),
        *curves(components / "curves.md"), "",
        f"![Error against CPU seconds](../images/{CURVE.name})", "",
        "The lines are in the order of the rows.", "",
        "## What the plan says", "", *plan(components / f"plan-{last}"), "",
        f"## Levels of detail of the run of {last} CPU seconds with shape refinement", "",
        *levels(components / f"plan-{last}-asset"), "",
        *large(folder / "large"), "", *shards(folder / "large"),
        *near([one for one in (components, folder / "street", folder / "tunnel") if (one / "near").exists()])]
    if (folder / "street/plan").exists():
        text += further(folder / "street", "A street", "`street` is rendered, outdoors.")
    if (folder / "tunnel/plan").exists():
        text += further(folder / "tunnel", "Real footage", "`tunnel` is a walk with a consumer camera. Poses come "
                        "from structure from motion, distances from the sphere sweep of neighbouring views. Ghosts "
                        "and holes need known distances and are not counted.")
    page = PAGE.read_text()
    before, rest = page.split(BEGIN)
    PAGE.write_text(before + BEGIN + "\n" + "\n".join(text) + "\n" + END + rest.split(END)[1])


if __name__ == "__main__":
    main()
