"""The page of scripts/measure/gpu: tables of what lies in its folder.

    gpu_page.py FOLDER    prints the page
    gpu_page.py sizes     prints the sizes at which gpu_before.json was counted: kind, Gaussians, columns
"""

import hashlib
import json
import re
import sys
from pathlib import Path


BEFORE = json.loads((Path(__file__).parent / "gpu_before.json").read_text())


def rows(text):
    """The tables of a Markdown text, each as rows of cells."""
    tables, table = [], []
    for line in text.splitlines():
        if line.startswith("|"):
            table.append([cell.strip() for cell in line.strip().strip("|").split("|")])
        elif table:
            tables.append(table)
            table = []
    return tables + ([table] if table else [])


def table(head, body):
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    lines += ["| " + " | ".join(str(cell) for cell in row) + " |" for row in body]
    return "\n".join(lines) + "\n"


def costs(out, kind):
    """One row for each size: what `bench renderer` says of a step, and the slowest stages."""
    body, device = [], ""
    for path in sorted(
        out.glob(f"cost-{kind}-*.md"), key=lambda path: [int(n) for n in re.findall(r"\d+", path.stem)]
    ):
        width, count = (int(number) for number in re.findall(r"\d+", path.stem))
        size = f"{count:,} at {width}x{width // 2}"
        text = path.read_text()
        found = rows(text)
        if len(found) < 2:
            body.append([size, text.strip()] + ["-"] * 7)
            continue
        device = text.split("\n\n")[0].replace("\n", " ")
        stages = [(row[0], float(row[1]), row[4]) for row in found[0][2:] if row[1] != "-"]
        total = sum(milliseconds for _, milliseconds, _ in stages) or 1.0
        slowest = sorted(stages, key=lambda stage: -stage[1])[:4]
        slowest = ", ".join(f"{name} {100 * ms / total:.0f} % ({share} of bandwidth)" for name, ms, share in slowest)
        step = {row[0]: row[1] for row in found[1][2:]}
        body.append(
            [
                size,
                step["wall ms of a step"],
                step["steps a second"],
                step["kernels of a step"],
                f"{int(step['bytes read back in 1,000 iterations']):,}",
                step["ms of a densification that needs more room"],
                step["ms of one within its room"],
                step["CPU ms of a step"],
                slowest,
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
    return device, table(head, body)


def densification(text):
    """Of a cell of `bench renderer`: milliseconds until the host goes on, bytes read, and what is made."""
    found = re.search(r"\(([\d.]+) until decided, .*; (\d+) bytes read, (\d+) made\)", text)
    return found.groups() if found else ("-",) * 3


def counted(out):
    """What is counted, before and now."""
    names = [
        "kernels of a step",
        "bytes read back in 1,000 iterations",
        "host ms of a densification",
        "made for a densification",
    ]
    body = []
    for kind, before in BEFORE.items():
        size = f"{before['gaussians']:,} at {before['width']}x{before['width'] // 2}"
        body.append([f"{kind}, {size}, {before['commit']}"] + [before[name] for name in names])
        path = out / f"counted-{kind}.md"
        text = path.read_text() if path.exists() else "not counted"
        found = rows(text)
        if len(found) < 2:
            body.append([f"{kind}, now", text.strip()] + ["-"] * 3)
            continue
        step = {row[0]: row[1] for row in found[1][2:]}
        larger = densification(step["ms of a densification that needs more room"])
        within = densification(step["ms of one within its room"])
        body.append(
            [
                f"{kind}, now",
                step[names[0]],
                f"{int(step[names[1]]):,}",
                f"{larger[0]} for more room, {within[0]} within it ({within[1]} bytes read)",
                f"{larger[2]} for more room, {within[2]} within it",
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
    for kind in BEFORE:
        path = out / f"counted-{kind}.md"
        found = rows(path.read_text()) if path.exists() else []
        if len(found) < 2:
            continue
        kinds.append(kind)
        for row in found[0][2:]:
            stages.setdefault(row[0], {})[kind] = row[2:4]
    none = ["-", "-"]
    body = [
        [name] + [cell for kind in kinds for cell in cells.get(kind, none)] for name, cells in stages.items()
    ]
    return table(["Stage"] + [f"{kind}: {what}" for kind in kinds for what in ("kernels", "MB")], body)


def peer(out):
    """Steps of gsplat on cube faces beside ours."""
    path = out / "gsplat.jsonl"
    if not path.exists():
        return "gsplat was left out: `python3` did not have it, or torch had no GPU.\n"
    body = []
    for line in path.read_text().splitlines():
        row = json.loads(line)
        count, width = row["gaussians"], row["width"]
        ours = rows((out / f"cost-static-{width}-{count}.md").read_text())
        step = {cells[0]: cells[1] for cells in ours[1][2:]} if len(ours) > 1 else {}
        theirs = number(1e3 * row["seconds"]) if "seconds" in row else row["error"]
        body.append([f"{count:,} at {width}x{width // 2}", step.get("wall ms of a step", "-"), theirs])
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
    for folder in sorted((out / "compared").iterdir()):
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


def stability(out):
    report = json.loads((out / "stability" / "stability.json").read_text())
    cases = [row for row in report["rows"] if row["status"] != "not-run"]
    failed = [row["case"] for row in cases if row["status"] == "fail"]
    result = "all pass" if not failed else "failed: " + ", ".join(failed)
    return f"Stability catalogue on the adapter: {len(cases)} rows, {result}.\n"


def sizes():
    for kind, before in BEFORE.items():
        print(kind, before["gaussians"], before["width"])


def main():
    if sys.argv[1:] == ["sizes"]:
        return sizes()
    out = Path(sys.argv[1])
    device, static = costs(out, "static")
    _, dynamic = costs(out, "dynamic")
    failed = (out / "failed.txt").read_text().split()
    print(device + "\n")
    print(stability(out))
    print("What is counted, before and now:\n\n" + counted(out))
    print("The same sizes by stage, as if every buffer passed once for each kernel:\n\n" + stage_bytes(out))
    print("Static Gaussians:\n\n" + static)
    print("Gaussians with times, and all losses of Omni4DGS:\n\n" + dynamic)
    print("Beside gsplat, static Gaussians (ours with SSIM, gsplat with L1 alone):\n\n" + peer(out))
    print("Scores of short runs on both backends:\n\n" + compared(out))
    print("Long runs on the GPU:\n\n" + long_runs(out))
    if failed:
        print("Failed: " + ", ".join(failed) + "\n")


main()
