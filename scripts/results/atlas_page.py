"""Puts the tables of scripts/results/atlas into docs/results/atlas.md, between its two markers.

    atlas_page.py FOLDER

FOLDER is what scripts/results/atlas filled. Needs NumPy and Pillow.
"""

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
PAGE = Path(__file__).resolve().parents[2] / "docs/results/atlas.md"
CLIPS = ["blackswan", "car-shadow"]
RUNS = ["auto", "without-flow", "without-view", "without-both"]
METRICS = [("PSNR", "psnr", 2), ("PSNR, background", "psnr-static", 2), ("PSNR, object's box", "psnr-object", 2),
           ("SSIM", "ssim-skimage-uniform", 4), ("LPIPS-alex", "lpips-alex", 4)]


def overlap(run, scene):
    """Intersection over union of alpha T > 1/2 and the visible mask, over all frames."""
    both = either = 0
    for number, frame in enumerate(scene["frames"]):
        found = np.asarray(Image.open(run / f"matte/{number:06}.png").convert("L")) > 127
        mask = frame["objects"].get("object")
        truth = np.zeros_like(found)
        if mask:
            truth = np.asarray(Image.open(run.parent / "scene" / mask).convert("L")) > 127
        both += (found & truth).sum()
        either += (found | truth).sum()
    return both / max(either, 1)


def table(folder):
    heads = ["Run", *(title for title, _, _ in METRICS), "Alpha IoU", "Steps", "Training, s", "CPU s", "Memory, MB"]
    lines = [f"**{folder.name}**", "", "| " + " | ".join(heads) + " |", "|---" + "|---:" * (len(heads) - 1) + "|"]
    scene = json.loads((folder / "scene/scene.json").read_text())
    for name in RUNS:
        run = folder / name
        if not (run / "score/result.json").is_file():
            continue
        result = json.loads((run / "score/result.json").read_text())["input_views"]
        record = json.loads((run / "run/run.json").read_text())
        cells = [name]
        for _, metric, digits in METRICS:
            mean = (result.get(metric) or {}).get("mean")
            cells.append("-" if mean is None else f"{mean:.{digits}f}")
        cells += [f"{overlap(run, scene):.3f}", str(record["iterations"]), f"{record['training_seconds']:.0f}",
                  f"{record['training_cpu_seconds'] or 0:.0f}", f"{record['peak_memory_bytes'] / 1e6:.0f}"]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main():
    folder = Path(sys.argv[1])
    tables = [table(folder / clip) for clip in CLIPS if (folder / clip).is_dir()]
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    PAGE.write_text(before + BEGIN + "\n" + "\n\n".join(tables) + "\n" + END + after)


if __name__ == "__main__":
    main()
