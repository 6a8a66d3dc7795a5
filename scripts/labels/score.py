#!/usr/bin/env python3
"""Scores what detectors found in a clip against its labels.

    scripts/labels/score.py masks tests/data/footage-labels/CLIP.json SEQUENCE...
    scripts/labels/score.py operator tests/data/footage-labels/CLIP.json SEQUENCE...
    scripts/labels/score.py overlays tests/data/footage-labels/CLIP.json ANALYSIS.json...
    scripts/labels/score.py boundaries tests/data/footage-labels/CLIP.json BOUNDARIES.json
    scripts/labels/score.py motion tests/data/footage-labels/CLIP.json SEQUENCE...

SEQUENCE is a folder with sequence.json and dynamic-masks (`omnilife curate masks`), operator (`omnilife curate
operator`) or annotation.json (`omnilife curate annotate`). Prints one line per result; README.md of the labels defines them. Needs NumPy and Pillow.
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
    return "-" if whole == 0 else f"{part / whole:.3f}"


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
    print(f"{labels['clip']}: {scored} of {len(labels['frames'])} labelled frames have a mask")
    for kind, (hit, wrong, missed) in sums.items():
        if hit + missed == 0:
            print(f"  {kind}: not labelled in these frames")
            continue
        print(f"  {kind}: IoU {share(hit, hit + wrong + missed)}, precision {share(hit, hit + wrong)}, "
              f"recall {share(hit, hit + missed)}")
    print(f"  marked of the background: {share(marked, seen)}")


def operator(labels, paths):
    sums, found, frames = np.zeros(3), 0, 0
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
        print(f"  {path}: {record['finding']}, evidence {record['evidence']:.2f}, IoU {share(own[0], own.sum())}")
    hit, wrong, missed = sums
    print(f"{labels['clip']}: {found} of {len(paths)} sequences have a mask; over {frames} frames IoU "
          f"{share(hit, hit + wrong + missed)}, precision {share(hit, hit + wrong)}, recall {share(hit, hit + missed)}")


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
    hits, truths, right, finds, ious = 0, 0, 0, 0, []
    for path in paths:
        analysis = json.loads(path.read_text())
        report, reach = analysis["overlays"], analysis["range"]
        if report is None or report["unjudged"]:
            print(f"{path}: not judged: {report and report['unjudged']}")
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
                hits, truths, right = hits + is_hit, truths + 1, right + is_hit
                ious += [overlap / whole] * int(is_hit)
                print(f"  shot {shot['first']}-{shot['last']}: {name} {'found' if is_hit else 'missed'}, "
                      f"IoU {share(overlap, whole)}")
            for name in sorted(set(found) - set(true)):
                print(f"  shot {shot['first']}-{shot['last']}: {name} reported, not labelled")
            finds += len(found)
    print(f"{labels['clip']}: precision {share(right, finds)}, recall {share(hits, truths)}, "
          f"mean IoU of what is found {share(sum(ious), len(ious))}")


def gap(a, b):
    return max(a["begin_seconds"] - b["end_seconds"], b["begin_seconds"] - a["end_seconds"], 0)


def boundaries(labels, paths):
    for path in paths:
        found, hits = json.loads(path.read_text())["boundaries"], 0
        left = [one for one in found if one["kind"] != "seamless-traversal"]
        reported = len(left)
        for true in labels["boundaries"]:
            near = min(left, key=lambda one: gap(true, one), default=None)
            if near and gap(true, near) <= TOLERANCE_SECONDS:
                left.remove(near)
                hits += 1
            else:
                print(f"  missed {true['kind']} at {true['begin_seconds']:.3f} s")
        for one in left:
            print(f"  false {one['kind']} at {one['begin_seconds']:.3f} s")
        print(f"{labels['clip']}: precision {share(hits, reported)}, recall {share(hits, len(labels['boundaries']))}")


def motion(labels, paths):
    right = judged = 0
    for path in paths:
        reach = json.loads((path / "sequence.json").read_text())["range"]
        measured = json.loads((path / "annotation.json").read_text())["ego_motion"]["measured"]
        truth = {frame["camera"] for frame in labels["frames"]
                 if frame["camera"] and reach["begin_seconds"] <= frame["seconds"] <= reach["end_seconds"]}
        if measured is None or len(truth) != 1:
            print(f"  {path}: not scored: measured {measured and measured['class']}, labels {sorted(truth)}")
            continue
        says = "still" if measured["class"] == "static" else "moving"
        judged, right = judged + 1, right + (says in truth)
        print(f"  {path}: measured {measured['class']}, labels {truth.pop()}")
    print(f"{labels['clip']}: {right} of {judged} sequences right")


def main():
    tasks = {task.__name__: task for task in (masks, operator, overlays, boundaries, motion)}
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("task", choices=tasks)
    parser.add_argument("labels", type=pathlib.Path)
    parser.add_argument("paths", type=pathlib.Path, nargs="+")
    options = parser.parse_args()
    labels = json.loads(options.labels.read_text())
    if options.task == "overlays" and labels["layout"] == "rectilinear":
        sys.exit("score: overlays are places on the sphere, and this clip is perspective")
    tasks[options.task](labels, options.paths)


if __name__ == "__main__":
    main()
