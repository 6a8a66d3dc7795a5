#!/usr/bin/env python3
"""Scores what detectors found in a clip against its labels.

    scripts/labels/score.py masks tests/data/footage-labels/CLIP.json SEQUENCE...
    scripts/labels/score.py operator tests/data/footage-labels/CLIP.json SEQUENCE...
    scripts/labels/score.py overlays tests/data/footage-labels/CLIP.json ANALYSIS.json...
    scripts/labels/score.py boundaries tests/data/footage-labels/CLIP.json BOUNDARIES.json
    scripts/labels/score.py motion tests/data/footage-labels/CLIP.json SEQUENCE...

SEQUENCE is a folder with sequence.json and dynamic-masks (`omnilife curate masks`), operator (`omnilife curate
operator`) or annotation.json (`omnilife curate annotate`). Prints one line per result; README.md of the labels defines
them. Needs NumPy and Pillow.

Each task is a function of the labels and paths. It returns the lines and a dictionary of numbers, in which a share of
nothing is None.
"""

import argparse
import json
import math
import pathlib
import sys

import numpy as np
from PIL import Image, ImageDraw

TOLERANCE_SECONDS = 0.1
GRID = (1024, 512)
# Of the smaller of two regions that are taken for the same.
LEAST_OVERLAP = 0.5


def share(part, whole):
    return None if whole == 0 else float(part / whole)


def shown(number):
    return "-" if number is None else f"{number:.3f}"


def of_regions(hit, wrong, missed):
    """Returns how well marked regions agree with true ones, from the areas of both, of one alone, of the other alone."""
    return {"iou": share(hit, hit + wrong + missed), "precision": share(hit, hit + wrong),
            "recall": share(hit, hit + missed)}


def as_text(regions):
    return f"IoU {shown(regions['iou'])}, precision {shown(regions['precision'])}, recall {shown(regions['recall'])}"


def drawn(regions, size):
    """Returns the union of the polygons as a mask of a size (width, height)."""
    image = Image.new("1", size)
    for region in regions:
        ImageDraw.Draw(image).polygon([(x * size[0] - 0.5, y * size[1] - 0.5) for x, y in region["points"]], fill=1)
    return np.array(image)


def weights(labels, size):
    """Returns the solid angle of each row of a sphere's pixels, up to a factor; 1 for perspective images."""
    if labels["layout"] == "rectilinear":
        return np.ones((size[1], 1))
    return np.cos((np.arange(size[1]) + 0.5) / size[1] * np.pi - np.pi / 2)[:, None]


def of_kind(frame, kind):
    return [region for region in frame["regions"] if region["kind"] == kind]


def masks(labels, paths):
    found = []
    for path in paths:
        entries = json.loads((path / "sequence.json").read_text())["frames"]["entries"]
        found += [(entry["time_seconds"], path / "dynamic-masks" / f"{pathlib.Path(entry['file']).stem}.png")
                  for entry in entries]
    near = 0.5 / labels["frames_per_second"]
    sums = {kind: np.zeros(3) for kind in ("moves", "operator")}
    scored, marked, seen = 0, 0.0, 0.0
    for frame in labels["frames"]:
        at, file = min(found, key=lambda one: abs(one[0] - frame["seconds"]), default=(math.inf, None))
        if abs(at - frame["seconds"]) > near:
            continue
        with Image.open(file) as image:
            mask = np.array(image.convert("L")) > 127
        size = (mask.shape[1], mask.shape[0])
        moves = of_kind(frame, "moves")
        truth = {"moves": drawn([region for region in moves if not region.get("rests")], size),
                 "operator": drawn(of_kind(frame, "operator"), size)}
        rests = drawn([region for region in moves if region.get("rests")], size)
        ignored = drawn(of_kind(frame, "ignore") + of_kind(frame, "overlay"), size) | rests
        ignored &= ~(truth["moves"] | truth["operator"])
        area = np.broadcast_to(weights(labels, size), mask.shape)
        # What carries the camera counts neither for nor against masks of moving content, and the other way around.
        for kind, other in (("moves", "operator"), ("operator", "moves")):
            counts = ~ignored & ~(truth[other] & ~truth[kind])
            sums[kind] += [area[part & counts].sum()
                           for part in (mask & truth[kind], mask & ~truth[kind], ~mask & truth[kind])]
        free = ~ignored & ~truth["moves"] & ~truth["operator"]
        marked, seen, scored = marked + area[mask & free].sum(), seen + area[free].sum(), scored + 1
    record = {"frames": scored, "background": share(marked, seen)}
    lines = [f"{labels['clip']}: {scored} of {len(labels['frames'])} labelled frames have a mask"]
    for kind, (hit, wrong, missed) in sums.items():
        is_labelled = hit + missed > 0
        record[kind] = of_regions(hit, wrong, missed) if is_labelled else None
        lines.append(f"  {kind}: {as_text(record[kind]) if is_labelled else 'not labelled in these frames'}")
    return lines + [f"  marked of the background: {shown(record['background'])}"], record


def operator(labels, paths):
    lines, sums, found, frames = [], np.zeros(3), 0, 0
    for path in paths:
        reach = json.loads((path / "sequence.json").read_text())["range"]
        record = json.loads((path / "operator" / "operator.json").read_text())
        size = GRID
        mask = np.zeros(GRID[::-1], bool)
        if record["finding"] == "found":
            with Image.open(path / "operator" / record["mask"]) as image:
                mask = np.array(image.convert("L")) > 127
            size = (mask.shape[1], mask.shape[0])
        area, own = np.broadcast_to(weights(labels, size), mask.shape), np.zeros(3)
        for frame in labels["frames"]:
            if not reach["begin_seconds"] <= frame["seconds"] <= reach["end_seconds"]:
                continue
            truth = drawn(of_kind(frame, "operator"), size)
            counts = ~drawn(of_kind(frame, "ignore"), size) | truth
            own += [area[part & counts].sum() / area.sum()
                    for part in (mask & truth, mask & ~truth, ~mask & truth)]
            frames += 1
        sums, found = sums + own, found + (record["finding"] == "found")
        lines.append(f"  {path}: {record['finding']}, evidence {record['evidence']:.2f}, "
                     f"IoU {shown(share(own[0], own.sum()))}")
    regions = of_regions(*sums)
    lines.append(f"{labels['clip']}: {found} of {len(paths)} sequences have a mask; over {frames} frames "
                 f"{as_text(regions)}")
    return lines, {"found": found, "sequences": len(paths), "is_labelled": sums[0] + sums[2] > 0, **regions}


def cap(overlay):
    """Returns the rectangle of an overlay, or the disc on the sphere with its centre and solid angle, as a mask of
    GRID."""
    longitude = ((np.arange(GRID[0]) + 0.5) / GRID[0] * 2 - 1) * np.pi
    latitude = (0.5 - (np.arange(GRID[1]) + 0.5) / GRID[1])[:, None] * np.pi
    east, north = math.radians(overlay["longitude_degrees"]), math.radians(overlay["latitude_degrees"])
    if "extent_degrees" in overlay:
        across, along = (np.radians(side / 2) for side in overlay["extent_degrees"])
        east_of = (longitude - east + np.pi) % (2 * np.pi) - np.pi
        return (np.abs(latitude - north) <= along) & (np.abs(east_of) <= across)
    cosine = np.sin(latitude) * math.sin(north) + np.cos(latitude) * math.cos(north) * np.cos(longitude - east)
    return cosine >= 1 - overlay["solid_angle_steradians"] / (2 * np.pi)


def stays_in(overlay, shot):
    """Returns true if an overlay's times overlap a shot; one without times is taken to stay always."""
    ranges = overlay.get("ranges") or [shot]
    return any(one["begin_seconds"] < shot["end_seconds"] and shot["begin_seconds"] < one["end_seconds"]
               for one in ranges)


def true_overlays(frames):
    """Returns, for each class that a shot's frames show, the union of its regions as a mask of GRID."""
    found = {}
    for region in (region for frame in frames for region in frame["regions"]):
        name = "rig" if region["kind"] == "operator" else region.get("overlay")
        if name:
            found[name] = found.get(name, False) | drawn([region], GRID)
    return found


def overlays(labels, paths):
    area = np.broadcast_to(weights(labels, GRID), GRID[::-1])
    lines, hits, truths, finds, ious, false = [], 0, 0, 0, [], []
    for path in paths:
        analysis = json.loads(path.read_text())
        report, reach = analysis["overlays"], analysis["range"]
        if report is None or report["unjudged"]:
            lines.append(f"{path}: not judged: {report and report['unjudged']}")
        for shot in labels["shots"]:
            middle = (shot["begin_seconds"] + shot["end_seconds"]) / 2
            if not reach["begin_seconds"] <= middle <= reach["end_seconds"]:
                continue
            found = {}
            for overlay in report["overlays"] if report else []:
                if stays_in(overlay, shot):
                    found[overlay["class"]] = found.get(overlay["class"], False) | cap(overlay)
            true = true_overlays(frame for frame in labels["frames"] if shot["first"] <= frame["frame"] <= shot["last"])
            for name, region in true.items():
                disc = found.get(name, np.zeros_like(region))
                overlap, whole = area[region & disc].sum(), area[region | disc].sum()
                is_hit = overlap > 0 and overlap >= LEAST_OVERLAP * min(area[region].sum(), area[disc].sum())
                hits, truths = hits + is_hit, truths + 1
                ious += [overlap / whole] * int(is_hit)
                lines.append(f"  shot {shot['first']}-{shot['last']}: {name} {'found' if is_hit else 'missed'}, "
                             f"IoU {shown(share(overlap, whole))}")
            for name in sorted(set(found) - set(true)):
                steradians = share(area[found[name]].sum() * 4 * math.pi, area.sum())
                false.append((name, steradians))
                lines.append(f"  shot {shot['first']}-{shot['last']}: {name} reported, not labelled, "
                             f"{steradians:.3f} sr")
            finds += len(found)
    record = {"precision": share(hits, finds), "recall": share(hits, truths), "iou": share(sum(ious), len(ious)),
              "found": hits, "labelled": truths, "false": false}
    lines.append(f"{labels['clip']}: precision {shown(record['precision'])}, recall {shown(record['recall'])}, "
                 f"mean IoU of what is found {shown(record['iou'])}")
    return lines, record


def gap(a, b):
    return max(a["begin_seconds"] - b["end_seconds"], b["begin_seconds"] - a["end_seconds"], 0)


def boundaries(labels, paths):
    lines, reported, hits = [], 0, 0
    for path in paths:
        found = json.loads(path.read_text())["boundaries"]
        left = [one for one in found if one["kind"] != "seamless-traversal"]
        reported += len(left)
        for true in labels["boundaries"]:
            near = min(left, key=lambda one: gap(true, one), default=None)
            if near and gap(true, near) <= TOLERANCE_SECONDS:
                left.remove(near)
                hits += 1
            else:
                lines.append(f"  missed {true['kind']} at {true['begin_seconds']:.3f} s")
        lines += [f"  false {one['kind']} at {one['begin_seconds']:.3f} s" for one in left]
    record = {"precision": share(hits, reported), "recall": share(hits, len(labels["boundaries"]) * len(paths)),
              "found": hits, "labelled": len(labels["boundaries"]), "false": reported - hits}
    lines.append(f"{labels['clip']}: precision {shown(record['precision'])}, recall {shown(record['recall'])}")
    return lines, record


def motion(labels, paths):
    lines, right, judged = [], 0, 0
    for path in paths:
        reach = json.loads((path / "sequence.json").read_text())["range"]
        measured = json.loads((path / "annotation.json").read_text())["ego_motion"]["measured"]
        truth = {frame["camera"] for frame in labels["frames"]
                 if frame["camera"] and reach["begin_seconds"] <= frame["seconds"] <= reach["end_seconds"]}
        if measured is None or measured["class"] == "unknown" or len(truth) != 1:
            lines.append(f"  {path}: not scored: measured {measured and measured['class']}, labels {sorted(truth)}")
            continue
        says = "still" if measured["class"] == "static" else "moving"
        judged, right = judged + 1, right + (says in truth)
        lines.append(f"  {path}: measured {measured['class']}, labels {truth.pop()}")
    lines.append(f"{labels['clip']}: {right} of {judged} sequences right")
    return lines, {"right": right, "judged": judged, "sequences": len(paths)}


TASKS = {task.__name__: task for task in (masks, operator, overlays, boundaries, motion)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=TASKS)
    parser.add_argument("labels", type=pathlib.Path)
    parser.add_argument("paths", type=pathlib.Path, nargs="+")
    options = parser.parse_args()
    labels = json.loads(options.labels.read_text())
    if options.task == "overlays" and labels["layout"] == "rectilinear":
        sys.exit("score: overlays are places on the sphere, and this clip is perspective")
    print("\n".join(TASKS[options.task](labels, options.paths)[0]))


if __name__ == "__main__":
    main()
