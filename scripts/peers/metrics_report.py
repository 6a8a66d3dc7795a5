"""Scores a folder with omnilife and with PyTorch in turn, and prints both as a Markdown table.

    python3 metrics_report.py OMNILIFE FOLDER MODELS ROUNDS METRIC...

omnilife's time is that of the whole process, reading its networks included; PyTorch's begins when
everything is imported and the networks are there.

torchmetrics' SSIM counts the border in, reflected, where scikit-image's leaves it out: the same work,
another number.
"""

import json
import os
import shutil
import statistics
import subprocess
import sys
import time
from pathlib import Path


def ours(omnilife, folder, split):
    out = folder / "scores"
    shutil.rmtree(out, ignore_errors=True)
    command = [omnilife, "--quiet", "bench", "score", "--scene", folder / "scene.json"]
    command += ["--split", split, "--novel-views", folder / "novel", "--method", "shifted"]
    began = time.perf_counter()
    process = subprocess.Popen([*command, "--out", out], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    if status != 0:
        sys.exit("metrics_report: omnilife failed")
    means = json.loads((out / "result.json").read_text())["novel_views"]
    return {
        "wall_seconds": wall,
        "processor_seconds": usage.ru_utime + usage.ru_stime,
        "peak_bytes": usage.ru_maxrss * 1024,
        "means": {metric: summary["mean"] for metric, summary in means.items()},
    }


def peer(folder, models, metrics):
    script = Path(__file__).with_name("torch_metrics.py")
    command = [sys.executable, "-W", "ignore", script, folder, models, *metrics]
    return json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


def main():
    omnilife, folder, models, rounds, *metrics = sys.argv[1:]
    folder = Path(folder)
    split = folder / "asked.json"
    maker = Path(__file__).with_name("metrics_scene.py")
    command = [sys.executable, maker, "ask", folder / "split.json", *metrics]
    split.write_bytes(subprocess.run(command, check=True, capture_output=True).stdout)
    rows = {"omnilife": [], "PyTorch": []}
    for _ in range(int(rounds)):
        rows["omnilife"].append(ours(omnilife, folder, split))
        rows["PyTorch"].append(peer(folder, models, metrics))
    views = len(list((folder / "novel").iterdir()))
    version = rows["PyTorch"][0]["torch"]
    print(f"{', '.join(metrics)}: {views} views, {rounds} rounds in turn, PyTorch {version}\n")
    print("| | wall s a view | processor s a view | peak MB |")
    print("|---|---|---|---|")
    medians = {}
    for name, results in rows.items():
        cells = []
        for quantity in ("wall_seconds", "processor_seconds"):
            values = [result[quantity] / views for result in results]
            medians[name, quantity] = statistics.median(values)
            spread = f"{min(values):.3f} to {max(values):.3f}"
            cells.append(f"{medians[name, quantity]:.3f} ({spread})")
        peak = max(result["peak_bytes"] for result in results) / 1e6
        print(f"| {name} | {cells[0]} | {cells[1]} | {peak:.0f} |")
    ratios = [
        medians["PyTorch", quantity] / medians["omnilife", quantity]
        for quantity in ("wall_seconds", "processor_seconds")
    ]
    print(f"\nPyTorch takes {ratios[0]:.2f} times our wall time, {ratios[1]:.2f} our CPU time")
    apart = {
        metric: abs(rows["omnilife"][0]["means"][metric] - rows["PyTorch"][0]["means"][metric])
        for metric in metrics
    }
    print("Means differ by " + ", ".join(f"{m} {d:.1e}" for m, d in apart.items()))
    if max(difference for metric, difference in apart.items() if "ssim" not in metric) > 1e-3:
        sys.exit("metrics_report: not the same metrics")


if __name__ == "__main__":
    main()
