"""The page of scripts/measure/gpu: tables of what lies in its folder, complete or not.

    gpu_page.py FOLDER       prints the page
    gpu_page.py sizes        prints the sizes at which gpu_before.json was counted: kind, Gaussians, columns
    gpu_page.py rays FILE    reads what the bench `atlas` prints; prints a line of JSON for each size of fields
"""

import hashlib
import json
import re
import sys
from pathlib import Path


BEFORE = json.loads((Path(__file__).parent / "gpu_before.json").read_text())
# Rays of a step of the bench `atlas`.
RAYS = 6144
SECONDS = {"ps": 1e-12, "ns": 1e-9, "us": 1e-6, "µs": 1e-6, "μs": 1e-6, "ms": 1e-3, "s": 1.0}
# Steps a second at the large size that the card is held to. Static: the rate that LichtFeld Studio's 3DGUT is reported
# with, 7,000 steps in 113 s with 1,000,000 splats on images of a fisheye of 200 degrees, on a GPU that is not named
# (https://github.com/MrNeRF/LichtFeld-Studio/pull/1777). Dynamic: half of it, a choice.
BARS = {"static": 62, "dynamic": 31}


def read(path):
    """The lines of a file of the bench `steps`."""
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def size_of(row):
    return f"{row['gaussians']:,} at {row['width']}x{row['width'] // 2}"


def table(head, body):
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in body]
    return "\n".join(lines) + "\n"


def milliseconds(seconds):
    return "-" if seconds is None else f"{1e3 * seconds:.2f}"


def rays(text):
    """A line for each size of fields: seconds of a step in the middle of Criterion's interval."""
    value = r"[\d.]+ \S+"
    pattern = re.compile(rf"^nag-gpu/(\w+)\s+time:\s+\[{value} ([\d.]+) (\S+) {value}\]", re.MULTILINE)
    for size, number, unit in pattern.findall(text):
        seconds = float(number) * SECONDS[unit]
        yield {"fields": size, "seconds": seconds, "rays_per_second": RAYS / seconds}


def parts(out):
    """The parts in the order in which they ended, with their states and seconds."""
    paths = sorted((out / "parts").glob("*.json"), key=lambda path: path.stat().st_mtime_ns)
    rows = [json.loads(path.read_text()) for path in paths]
    body = [[row["part"], row["state"], row["seconds"], row["expected_seconds"]] for row in rows]
    return table(["Part", "State", "Seconds", "Expected"], body)


def all_costs(out):
    """The lines of all parts that measured steps, the most important first."""
    return [row for name in ("large", "counted", "costs") for row in read(out / f"{name}.jsonl")]


def form_of(cost):
    """The threads that sum over pixels."""
    if cost["sums_per_splat"]:
        return "a thread per splat"
    threads = cost["subgroup_size"]
    return f"subgroups of {threads} threads at least" if threads else "the memory of workgroups"


def is_chosen(cost):
    """True unless all kernels are the default ones."""
    return cost["sums_per_splat"] or cost["fused_adam"]


def large(out):
    """A step of the large size with every choice of kernels, beside the rate that it is held to."""
    body = []
    for row in read(out / "large.jsonl"):
        cost = row.get("measured")
        if cost is None:
            body.append([row["kind"], size_of(row), row["error"]] + ["-"] * 5)
            continue
        stages = {stage["name"]: stage["seconds"] for stage in cost["stages"]}
        body.append(
            [
                row["kind"],
                size_of(row),
                form_of(cost),
                "one" if cost["fused_adam"] else "separate",
                milliseconds(cost["wall_seconds"]),
                f"{1 / cost['wall_seconds']:.1f}",
                BARS[row["kind"]],
                milliseconds(stages.get("raster backward")),
            ]
        )
    head = [
        "Gaussians",
        "Number, image",
        "sums over pixels by",
        "kernels from splats to Adam",
        "ms a step",
        "steps a second",
        "bar at 1,000,000 and 2048x1024",
        "ms of raster backward",
    ]
    return table(head, body)


def nag(out):
    body = [
        [row["fields"], milliseconds(row["seconds"]), f"{row['rays_per_second']:,.0f}"]
        for row in read(out / "rays.jsonl")
    ]
    return table([f"Fields (two objects, a background, {RAYS:,} rays)", "ms a step", "rays a second"], body)


def device(out):
    """The adapter, in words."""
    for row in all_costs(out):
        if cost := row.get("measured"):
            copied = f"{1e-9 * cost['copied_per_second']:.1f} GB/s"
            return f"On {cost['device']}. It copies {copied}, read and written. Sums over pixels by {form_of(cost)}."
    return "No size was measured."


def densification(cost):
    decided, after = cost["decision_seconds"], cost["device_seconds"]
    return (
        f"{milliseconds(decided + after)} ({milliseconds(decided)} until decided, {milliseconds(after)} after; "
        f"{cost['bytes_read']} bytes read, {cost['made']} made)"
    )


def slowest_stages(cost):
    """The four slowest stages, with their shares of a step and of a copy's bandwidth."""
    stages = [stage for stage in cost["stages"] if stage["seconds"] is not None]
    total = sum(stage["seconds"] for stage in stages) or 1.0
    texts = []
    for stage in sorted(stages, key=lambda stage: -stage["seconds"])[:4]:
        seconds = stage["seconds"]
        share = f"{100 * stage['bytes'] / seconds / cost['copied_per_second']:.0f} %" if seconds else "-"
        texts.append(f"{stage['name']} {100 * seconds / total:.0f} % ({share} of bandwidth)")
    return ", ".join(texts)


def kernels(cost):
    return sum(stage["kernels"] for stage in cost["stages"])


def costs(out, kind):
    """One row for each size: costs of a step, and the slowest stages."""
    body = []
    for row in read(out / "costs.jsonl"):
        if row["kind"] != kind:
            continue
        cost = row.get("measured")
        if cost is None:
            body.append([size_of(row), row["error"]] + ["-"] * 7)
            continue
        body.append(
            [
                size_of(row),
                milliseconds(cost["wall_seconds"]),
                f"{1 / cost['wall_seconds']:.1f}",
                kernels(cost),
                f"{cost['bytes_read']:,}",
                *[densification(density) for density in cost["densifications"]],
                milliseconds(cost["cpu_seconds"]),
                slowest_stages(cost),
            ]
        )
    head = [
        "Gaussians, image",
        "ms a step",
        "steps a second",
        "kernels",
        "bytes read back in 1,000 its",
        "ms of a densification that needs more room",
        "within its room",
        "CPU ms a step",
        "slowest stages",
    ]
    return table(head, body)


def counted(out):
    """What is counted, before and now."""
    names = [
        "kernels of a step",
        "bytes read back in 1,000 iterations",
        "host ms of a densification",
        "made for a densification",
    ]
    rows = {row["kind"]: row for row in read(out / "counted.jsonl")}
    body = []
    for kind, before in BEFORE.items():
        body.append([f"{kind}, {size_of(before)}, {before['commit']}"] + [before[name] for name in names])
        row = rows.get(kind, {})
        cost = row.get("measured")
        if cost is None:
            body.append([f"{kind}, now", row.get("error", "not counted")] + ["-"] * 3)
            continue
        larger, within = cost["densifications"]
        ms = [milliseconds(density["decision_seconds"]) for density in (larger, within)]
        body.append(
            [
                f"{kind}, now",
                kernels(cost),
                f"{cost['bytes_read']:,}",
                f"{ms[0]} for more room, {ms[1]} within it ({within['bytes_read']} bytes read)",
                f"{larger['made']} for more room, {within['made']} within it",
            ]
        )
    head = [
        "Gaussians, image, commit",
        "kernels of a step",
        "bytes read back in 1,000 its",
        "ms of a densification until the host goes on",
        "buffers and bind groups made for it",
    ]
    return table(head, body)


def stage_bytes(out):
    """What the buffers of each stage take if each passes once for each kernel."""
    stages, kinds = {}, []
    for row in read(out / "counted.jsonl"):
        if cost := row.get("measured"):
            kinds.append(row["kind"])
            for stage in cost["stages"]:
                cells = [stage["kernels"], f"{1e-6 * stage['bytes']:.1f}"]
                stages.setdefault(stage["name"], {})[row["kind"]] = cells
    none = ["-", "-"]
    body = [
        [name] + [cell for kind in kinds for cell in cells.get(kind, none)] for name, cells in stages.items()
    ]
    return table(["Stage"] + [f"{kind}: {what}" for kind in kinds for what in ("kernels", "MB")], body)


def peer(out):
    """Steps of gsplat on cube faces beside ours."""
    path = out / "gsplat.jsonl"
    if not path.exists():
        return "Left out, or `python3` did not have gsplat, or torch had no GPU.\n"
    ours = {
        (row["gaussians"], row["width"]): milliseconds(row["measured"]["wall_seconds"])
        for row in reversed(all_costs(out))
        if row["kind"] == "static" and row.get("measured") and not is_chosen(row["measured"])
    }
    body = []
    for row in read(path):
        theirs = milliseconds(row["seconds"]) if "seconds" in row else row["error"]
        body.append([size_of(row), ours.get((row["gaussians"], row["width"]), "-"), theirs])
    return table(["Gaussians, image", "ms a step", "gsplat, six faces of a quarter of the columns"], body)


def score(folder):
    path = folder / "score" / "result.json"
    return json.loads(path.read_text()) if path.exists() else None


def mean(result, metric):
    return result["novel_views"][metric]["mean"] if result else None


def number(value, digits=2):
    return "-" if value is None else f"{value:.{digits}f}"


def model_hash(folder):
    """None where there is no model."""
    digest = hashlib.sha256()
    paths = sorted((folder / "run").rglob("*.ply"))
    for path in paths:
        digest.update(path.read_bytes())
    return digest.hexdigest() if paths else None


def compared(out):
    body = []
    for folder in sorted((out / "compared").glob("*")):
        seeds = [mean(score(folder / f"cpu-{seed}"), "psnr") for seed in (0, 1, 2)]
        seeds = [value for value in seeds if value is not None]
        on_gpu = mean(score(folder / "gpu-0"), "psnr")
        hashes = [model_hash(folder / name) for name in ("gpu-0", "gpu-again")]
        twice = "-" if None in hashes else "yes" if hashes[0] == hashes[1] else "no"
        spread = f"{min(seeds):.2f} to {max(seeds):.2f}" if seeds else "-"
        body.append([folder.name, spread, number(on_gpu), twice])
    head = ["Method", "CPU, three seeds, dB", "GPU, seed 0, dB", "the same model twice"]
    return table(head, body)


def long_runs(out):
    body = []
    for folder in sorted((out / "long").glob("*/*")):
        result = score(folder)
        if result is None:
            body.append([folder.parent.name, folder.name] + ["-"] * 6)
            continue
        size = "x".join(str(side) for side in result["scored_size"])
        seconds = result["training_seconds"]
        body.append(
            [
                result["scene"],
                folder.name,
                size,
                result["iterations"],
                result["primitives"],
                f"{seconds:.0f}",
                number(mean(result, "psnr")),
                number(mean(result, "ssim"), 4),
            ]
        )
    head = ["Scene", "Method", "Size", "Iterations", "Gaussians", "Seconds", "PSNR", "SSIM"]
    return table(head, body)


def stability(out, form):
    path = out / f"stability-{form}" / "stability.json"
    if not path.exists():
        return f"Stability catalogue on the adapter, sums by {form}: not finished.\n"
    report = json.loads(path.read_text())
    cases = [row for row in report["rows"] if row["status"] != "not-run"]
    failed = [row["case"] for row in cases if row["status"] == "fail"]
    result = "all pass" if not failed else "failed: " + ", ".join(failed)
    return f"Stability catalogue on the adapter, sums by {form}: {len(cases)} rows, {result}.\n"


def sizes():
    for kind, before in BEFORE.items():
        print(kind, before["gaussians"], before["width"])


def main():
    if sys.argv[1:] == ["sizes"]:
        return sizes()
    if sys.argv[1:2] == ["rays"]:
        for row in rays(Path(sys.argv[2]).read_text()):
            print(json.dumps(row))
        return None
    out = Path(sys.argv[1])
    print(device(out) + "\n")
    print("Parts of the measurement:\n\n" + parts(out))
    for form in ("pixels", "splats"):
        print(stability(out, form))
    print("A step of the large size:\n\n" + large(out))
    print("Neural Atlas Graphs:\n\n" + nag(out))
    print("What is counted, before and now:\n\n" + counted(out))
    print("The same sizes by stage, as if every buffer passed once for each kernel:\n\n" + stage_bytes(out))
    print("Static Gaussians:\n\n" + costs(out, "static"))
    print("Gaussians with times, and all losses of Omni4DGS:\n\n" + costs(out, "dynamic"))
    print("Beside gsplat, static Gaussians (ours with SSIM, gsplat with L1 alone):\n\n" + peer(out))
    print("Scores of short runs on both backends:\n\n" + compared(out))
    print("Long runs on the GPU:\n\n" + long_runs(out))


main()
