"""Puts the tables and images of scripts/results/atlas into docs/results/atlas.md, between its two markers.

    atlas_page.py FOLDER [--plates RENDERING]
    atlas_page.py --largest ATLASES          # prints the object whose atlas is the largest
    atlas_page.py --stripes ATLAS IMAGE      # a picture of stripes of the size of an object's atlas

FOLDER is what scripts/results/atlas filled; RENDERING the sample rendered without its objects. Needs NumPy and Pillow.
"""

import argparse
import csv
import json
from pathlib import Path

import numpy as np
from PIL import Image

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
PAGE = Path(__file__).resolve().parents[2] / "docs/results/atlas.md"
SHEET = PAGE.parent.parent / "images/atlas.jpg"
CLIPS = ["blackswan", "car-shadow"]
METRICS = [("PSNR", "psnr", 2), ("PSNR, background", "psnr-static", 2), ("PSNR, object's box", "psnr-object", 2),
           ("SSIM", "ssim-skimage-uniform", 4), ("LPIPS-alex", "lpips-alex", 4)]
# What leaving a component out changed in the paper (supplement, Table 10), dB.
PUBLISHED = {"flow": -1.98, "view": -3.34, "flow,view": -9.13, "coarse-to-fine": -0.05, "object-rotation": -0.04,
             "mask-loss": -0.11}
# Shares of a run's time at which its quality is told.
SHARES = [0.05, 0.1, 0.2, 0.4, 0.7, 1.0]


def read(path):
    return json.loads(path.read_text())


def pixels(path, mode="RGB"):
    return np.asarray(Image.open(path).convert(mode))


def decibels(squared):
    return -10 * np.log10(squared)


def row(cells):
    return "| " + " | ".join(cells) + " |"


def table(heads, rows):
    return "\n".join([row(heads), "|---" + "|---:" * (len(heads) - 1) + "|", *map(row, rows)])


def scores(folder, views):
    """A run's means under a heading of its result."""
    result = read(folder / "score/result.json")[views] or {}
    means = [(result.get(metric) or {}).get("mean") for _, metric, _ in METRICS]
    return ["-" if mean is None else f"{mean:.{digits}f}" for mean, (_, _, digits) in zip(means, METRICS)]


def overlap(run, folder, scene):
    """Intersection over union of alpha T > 1/2 and the visible mask, over all frames."""
    both = either = 0
    for number, frame in enumerate(scene["frames"]):
        found = pixels(run / f"matte/{number:06}.png", "L") > 127
        mask = frame["objects"].get("object")
        truth = pixels(folder / mask, "L") > 127 if mask else np.zeros_like(found)
        both += (found & truth).sum()
        either += (found | truth).sum()
    return both / max(either, 1)


def costs(record):
    return [str(record["iterations"]), f"{record['training_seconds']:.0f}", f"{record['training_cpu_seconds']:.0f}",
            f"{record['peak_memory_bytes'] / 1e6:.0f}"]


def input_views(out):
    heads = ["Clip", *(title for title, *_ in METRICS), "Alpha IoU", "Steps", "Training, s", "CPU s", "Memory, MB"]
    rows = []
    for clip in CLIPS:
        run, folder = out / clip / "auto", out / clip / "scene"
        rows.append([clip, *scores(run, "input_views"), f"{overlap(run, folder, read(folder / 'scene.json')):.3f}",
                     *costs(read(run / "run/run.json"))])
    return "**Every frame given**\n\n" + table(heads, rows)


def against_time(out):
    rows = []
    for clip in CLIPS:
        with open(out / clip / "auto/run/trace.csv", newline="") as file:
            trace = [{name: float(value) for name, value in line.items() if value} for line in csv.DictReader(file)]
        last = trace[-1]["cpu_seconds"]
        at = [min(trace, key=lambda line: abs(line["cpu_seconds"] - share * last)) for share in SHARES]
        rows.append([clip, *(f"{line['train_psnr_db']:.2f} ({line['cpu_seconds']:.0f} s)" for line in at)])
    heads = ["Clip", *(f"{share:.0%} of the time" for share in SHARES)]
    return "**Error against run time**: PSNR of the rays of the steps before, dB, and CPU seconds\n\n" + table(heads, rows)


def held_out(out):
    heads = ["Clip", "Views", *(title for title, *_ in METRICS), "Steps", "Training, s", "CPU s", "Memory, MB"]
    rows = []
    for clip in CLIPS:
        run = out / clip / "held-out"
        for title, views in (("given", "input_views"), ("held out", "novel_views")):
            rows.append([clip, title, *scores(run, views), *costs(read(run / "run/run.json"))])
    return "**Frames held out**, protocol `per-scene`, a third of the time\n\n" + table(heads, rows)


def ablation(out):
    clip = CLIPS[0]
    runs = {path.name: path for path in (out / clip / "ablation").iterdir() if (path / "score/result.json").exists()}
    full = min(runs, key=len)
    reference = read(runs[full] / "score/result.json")["input_views"]["psnr"]["mean"]
    rows = []
    for name, path in sorted(runs.items(), key=lambda run: len(run[0])):
        left_out = name.removeprefix(full).removeprefix("-without-")
        difference = read(path / "score/result.json")["input_views"]["psnr"]["mean"] - reference
        published = PUBLISHED.get(left_out)
        cells = [f"without {left_out}", f"{difference:+.2f}"] if left_out else ["all", ""]
        rows.append([*cells, "" if published is None else f"{published:+.2f}", *scores(path, "input_views"),
                     *costs(read(path / "run/run.json"))])
    heads = [f"`{clip}`", "Difference, dB", "Published", *(title for title, *_ in METRICS), "Steps", "Training, s",
             "CPU s", "Memory, MB"]
    return "**What each component is worth**, plan full, input views\n\n" + table(heads, rows)


def seam(images):
    """Mean difference of neighbouring columns across the seam, over that of the columns beside it."""
    across = np.mean([np.abs(image[:, 0] - image[:, -1]).mean() for image in images])
    beside = np.mean([np.abs(np.diff(image, axis=1))[:, [0, 1, -2, -1]].mean() for image in images])
    return across / beside


def street(out, plates):
    folder = out / "street"
    scene_folder = Path((folder / "scene").read_text().strip())
    frames = read(scene_folder / "scene.json")["frames"]
    rows = []
    for method in ("nag", "odgs"):
        result = read(folder / method / "score/result.json")["input_views"]
        record = read(folder / method / "run/run.json")
        means = [result[metric]["mean"] for metric in ("psnr", "psnr-dynamic", "psnr-static")]
        predicted = sorted((folder / method / "run/predictions").rglob("*.png"))
        rows.append([f"`{method}`", *(f"{mean:.2f}" for mean in means),
                     f"{seam([pixels(file).astype(float) for file in predicted]):.3f}", *costs(record)])
    shown = [pixels(scene_folder / frame["image"]).astype(float) for frame in frames]
    rows.append(["the images", "", "", "", f"{seam(shown):.3f}", "", "", "", ""])
    heads = ["`street`", "PSNR", "PSNR in masks", "PSNR outside", "Across the seam / beside it", "Steps", "Training, s",
             "CPU s", "Memory, MB"]
    text = "**A panorama**, every frame given\n\n" + table(heads, rows)
    if plates:
        text += "\n\n" + removal(folder, scene_folder, frames, plates)
    return text


def removal(folder, scene_folder, frames, plates):
    """How well the background is known behind what moves, where the clip shows it at some other time."""
    masks = np.array([pixels(scene_folder / frame["mask"], "L") >= 128 for frame in frames])
    is_seen = ~masks.all(axis=0)
    errors = {"the background layer": [], "the median of the frames": []}
    clip = np.array([pixels(scene_folder / frame["image"]) for frame in frames], float)
    median = np.median(clip, axis=0)
    for number, mask in enumerate(masks):
        where = mask & is_seen
        if not where.any():
            continue
        truth = np.asarray(Image.open(plates / f"rgb/{number:04}.png").convert("RGB").resize(mask.shape[::-1], Image.BOX), float)
        layer = pixels(folder / f"background/{number:06}.png").astype(float)
        for name, image in (("the background layer", layer), ("the median of the frames", median)):
            errors[name].append(np.mean(((image - truth)[where] / 255) ** 2))
    rows = [[name, f"{decibels(np.mean(values)):.2f}"] for name, values in errors.items()]
    return ("**Behind what is taken out**: PSNR inside of the masks against the same clip rendered without its "
            "objects\n\n" + table(["", "PSNR"], rows))


def sheet(out):
    """A frame, its render, its layers and its edits, one below the other: where the edited object is largest."""
    folder = out / "street"
    scene_folder = Path((folder / "scene").read_text().strip())
    shown = max(sorted((folder / "matte").glob("*.png")), key=lambda file: pixels(file, "L").sum()).stem
    frame, name = read(scene_folder / "scene.json")["frames"][int(shown)], f"{shown}.png"
    predicted = next((folder / "nag/run/predictions").rglob(name))
    files = [scene_folder / frame["image"], predicted, folder / "background" / name,
             folder / "texture/views" / name, folder / "duplicate/views" / name]
    images = [Image.open(file).convert("RGB") for file in files]
    width, height = images[0].size
    made = Image.new("RGB", (width, height * len(images)))
    for place, image in enumerate(images):
        made.paste(image, (0, place * height))
    made.save(SHEET, quality=85)
    text = (f"frame {int(shown)} of the sample, its render, the background alone, the object with the largest atlas with "
            "stripes for its texture, and with a copy above it")
    return f"![{text[0].upper() + text[1:]}](../images/{SHEET.name})\n\nFrom above: {text}."


def largest(atlas):
    """The object whose atlas is the largest: what is large in the images, and near."""
    nodes = [node for node in read(atlas / "nodes.json") if node["id"] != "background"]
    return max(nodes, key=lambda node: node["width"] * node["height"])["id"]


def stripes(atlas, target):
    width, height = Image.open(atlas).size
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    on = ((x + y) // max(4, min(width, height) // 8)) % 2 == 0
    colours = np.where(on[..., None], [240, 200, 30], [30, 60, 200])
    alpha = np.full((height, width, 1), 255)
    Image.fromarray(np.concatenate([colours, alpha], axis=2).astype(np.uint8), "RGBA").save(target)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, nargs="?")
    parser.add_argument("--plates", type=Path)
    parser.add_argument("--largest", type=Path)
    parser.add_argument("--stripes", type=Path, nargs=2)
    options = parser.parse_args()
    if options.largest:
        print(largest(options.largest))
        return
    if options.stripes:
        stripes(*options.stripes)
        return
    out = options.folder
    parts = [input_views(out), against_time(out), held_out(out), ablation(out), street(out, options.plates), sheet(out)]
    text = PAGE.read_text()
    before, rest = text.split(BEGIN)
    after = rest.split(END)[1]
    PAGE.write_text(before + BEGIN + "\n" + "\n\n".join(parts) + "\n" + END + after)


if __name__ == "__main__":
    main()
