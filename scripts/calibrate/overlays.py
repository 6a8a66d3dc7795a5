#!/usr/bin/env python3
"""Compares overlays judged over a whole video with overlays judged by shot, on clips painted and joined in memory.

    overlays.py TUNNEL CITY

Both are equirectangular videos whose camera moves. Prints for spans of each clip, on which nothing is painted, the
number with something artificial above 0.02 sr; then finds in pairs of shots of which one is painted. A model in NumPy
of `curate/src/overlays` (`stability`, `regions` without grids and patches, `surroundings`, `captions`, `by_shot`) makes
them, of 512x256 images, 0.2 s apart for captions and 0.4 s for what stays. Needs NumPy, Pillow and ffmpeg; takes some
minutes.
"""

import argparse
import itertools
import math

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from captions import AREA, HEIGHT, LATITUDE, WIDTH, captions, grown, regions, samples

LEAST_STEPS = {"whole": 5, "shots": 12}
PROMINENT_STERADIANS = 0.02
LONGITUDE = ((np.arange(WIDTH) + 0.5) / WIDTH - 0.5) * 2 * math.pi
DIRECTION = np.stack([np.outer(np.cos(LATITUDE), np.sin(LONGITUDE)).ravel(), np.repeat(np.sin(LATITUDE), WIDTH),
                      np.outer(np.cos(LATITUDE), np.cos(LONGITUDE)).ravel()], 1)


class Step:
    """Two looked-at frames that follow each other."""

    def __init__(self, before, now):
        gradients = [np.stack([np.roll(level, -1, 1) - level, np.vstack([level[1:], level[-1:]]) - level])
                     for level in (before, now)]
        lengths = [np.hypot(*gradient) for gradient in gradients]
        strength = np.maximum(*lengths)
        self.detailed = strength >= 6
        self.stayed = self.detailed & (np.hypot(*(gradients[1] - gradients[0])) <= 0.35 * strength)
        self.moves = 0 < self.detailed.sum() and self.stayed.sum() <= 0.5 * self.detailed.sum()
        self.gradient, self.length = gradients[1], lengths[1]


def surroundings_move(pixels, detailed, stays):
    marks = np.zeros(WIDTH * HEIGHT, bool)
    marks[pixels] = True
    marks = marks.reshape(HEIGHT, WIDTH)
    around = grown(marks, 8) & ~grown(marks, 1)
    count, staying = (around & detailed).sum(), (around & detailed & stays).sum()
    return 0 < count and count >= 0.05 * around.sum() and staying <= 0.35 * count


def region(pixels, marks):
    """Returns place and size of a region, with its marked pixels' solid angles."""
    area, marked = AREA[pixels], marks.ravel()[pixels]
    direction = area @ DIRECTION[pixels]
    direction /= max(np.linalg.norm(direction), 1e-12)
    return {"pixels": pixels, "area": area.sum(), "direction": direction, "marked": marked,
            "weights": area[marked] / max(area[marked].sum(), 1e-12), "filled": area[marked].sum()}


def standing(steps, least):
    """Returns the regions that stay over steps, as `regions::find`; empty with too few that move."""
    steps = [step for step in steps if step.moves]
    if len(steps) < least:
        return len(steps), []
    gradient, length = sum(step.gradient for step in steps), sum(step.length for step in steps)
    detailed = sum(step.detailed.astype(int) for step in steps)
    stayed = sum(step.stayed.astype(int) for step in steps)
    strength, constancy = length / len(steps), np.hypot(*gradient) / np.maximum(length, 1e-3)
    stayed = np.where(2 * detailed >= len(steps), stayed / np.maximum(detailed, 1), 0)
    marks, found = (strength >= 5) & (stayed >= 0.75), []
    for pixels in regions(marks, 2):
        one = region(pixels, marks)
        if one["area"] < 1e-3 or one["filled"] < 0.05 * one["area"]:
            continue
        of = lambda values: one["weights"] @ values.ravel()[pixels][one["marked"]]
        rows, columns = pixels // WIDTH, len(np.unique(pixels % WIDTH)) / WIDTH
        latitude = math.asin(np.clip(one["direction"][1], -1, 1))
        aspect = columns * 2 * math.cos(latitude) / ((np.ptp(rows) + 1) / HEIGHT)
        is_body = latitude < -0.2 and of(constancy) < 0.93 and one["area"] > 0.25
        if LATITUDE[rows.max()] < math.radians(-78) or is_body:
            name = "rig"
        elif not surroundings_move(pixels, strength >= 5, stayed >= 0.5):
            continue
        else:
            name = "caption" if aspect >= 3 and of(constancy) < 0.93 else "watermark"
        found.append({**one, "class": name, "strength": of(strength), "stayed": of(stayed)})
    return len(steps), found


def same_place(one, other):
    angle = math.acos(np.clip(one["direction"] @ other["direction"], -1, 1))
    return angle <= math.sqrt(max(one["area"], other["area"]) / math.pi)


def passing(frames):
    """Returns the captions that pass within frames, as regions."""
    found = []
    for one in captions(frames):
        top, bottom, left, count = one["at"]
        marks = np.zeros((HEIGHT, WIDTH), bool)
        marks[top:bottom + 1, (left + np.arange(count)) % WIDTH] = True
        found.append({**region(np.flatnonzero(marks), marks), "class": "caption"})
    return found


def judged(frames, mode, is_alone):
    frames = np.array(frames)
    steps = list(itertools.starmap(Step, itertools.pairwise(frames[::2])))
    count, found = standing(steps, LEAST_STEPS[mode])
    if mode == "shots" and not is_alone:
        found = [one for one in found if one["class"] == "rig" or one["strength"] >= 24 or one["stayed"] >= 0.9]
    share = 0.25 if mode == "shots" else 0
    hidden = lambda seen: any(same_place(one, seen) and one["area"] >= share * seen["area"] for one in found)
    return count, found + [seen for seen in passing(frames) if not hidden(seen)]


def prominent(found):
    return [one for one in found if one["class"] != "rig" and one["area"] > PROMINENT_STERADIANS]


def overlap(finds, truth):
    """Returns the IoU of the union of finds with the painted region, on the sphere."""
    union = np.zeros(WIDTH * HEIGHT, bool)
    for one in finds:
        union[one["pixels"]] = True
    truth = grown(truth, 2).ravel()
    return AREA[union & truth].sum() / AREA[union | truth].sum()


def painted(frames, numbers, text, place, size, opacity=1.0, box=None):
    """Returns frames with text at a place of 1024x512 images in these numbers, and the painted region."""
    image = Image.new("L", (2 * WIDTH, 2 * HEIGHT))
    ImageDraw.Draw(image).text(place, text, fill=255, font=ImageFont.load_default(size))
    alpha = np.asarray(image.resize((WIDTH, HEIGHT), Image.BOX), np.float32) / 255 * opacity
    frames = [frame.copy() for frame in frames]
    for frame in (frames[number] for number in numbers):
        if box:
            left, top, right, bottom = box
            frame[top:bottom, left:right] *= 0.35
        frame += (255 - frame) * alpha
    return frames, alpha > 0.1 * opacity


def spans(name, frames):
    steps = list(itertools.starmap(Step, itertools.pairwise(frames[::2])))
    for length in (5, 6, 8, 10, 12, 15):
        starts = range(0, len(steps) - length + 1, max(1, length // 4))
        found = [standing(steps[start:start + length], 5)[1] for start in starts]
        print(f"{name}, {length} steps: something in {sum(bool(prominent(one)) for one in found)} of {len(found)} spans")


def compared(name, shots, truth, painted_shot, totals):
    """Prints the finds in joined shots, of which the painted one has this number."""
    frames = list(itertools.chain(*shots))
    ends = [0, *itertools.accumulate(len(shot) for shot in shots)]
    whole = [judged(frames, "whole", True)]
    by_shot = lambda is_alone: [judged(frames[begin:end], "shots", is_alone)
                                for begin, end in itertools.pairwise(ends)]
    of_shots = by_shot(False)
    if sum(count >= LEAST_STEPS["shots"] for count, _ in of_shots) <= 1:
        of_shots = by_shot(True)
    line = []
    for mode, parts in (("whole", whole), ("shots", of_shots)):
        hits, wrong = [], 0
        for number, (_, found) in enumerate(parts):
            for one in prominent(found):
                is_true = mode == "whole" or number == painted_shot
                is_hit = bool(truth is not None and is_true and overlap([one], truth) > 0.05)
                hits, wrong = hits + [one] * is_hit, wrong + (not is_hit)
        iou = overlap(hits, truth) if hits else 0.0
        totals[mode].append((truth is not None, bool(hits), iou, wrong))
        line.append(f"{mode} IoU {iou:.2f}, {wrong} false")
    print(f"{name}: {'; '.join(line)}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("tunnel")
    parser.add_argument("city")
    options = parser.parse_args()
    clips = {"tunnel": list(samples(options.tunnel)), "city": list(samples(options.city))}
    for name, frames in clips.items():
        spans(name, frames)
    totals = {"whole": [], "shots": []}
    compared("nothing painted", list(clips.values()), None, None, totals)
    texts = {"logo": ("OmniTube", (700, 120), 44), "small logo": ("OmniTube", (700, 330), 18),
             "text at 45 %": ("@wanderer360", (120, 300), 48, 0.45),
             "text at 15 %": ("@wanderer360", (120, 300), 48, 0.15),
             "caption of 1.2 s": ("Oahu, Hawaii", (380, 330), 40), "caption of 1.6 s": ("Oahu, Hawaii", (380, 330), 40),
             "lower third of 3.2 s": ("Jane Doe, engineer", (300, 360), 36, 1.0, (145, 175, 345, 203))}
    lengths = {"caption of 1.2 s": 6, "caption of 1.6 s": 8, "lower third of 3.2 s": 16}
    for first, second in (("tunnel", "city"), ("city", "tunnel")):
        for name, text in texts.items():
            numbers = range(10, 10 + lengths[name]) if name in lengths else range(len(clips[second]))
            shot, truth = painted(clips[second], numbers, *text)
            compared(f"{name} in the second of {first}, {second}", [clips[first], shot], truth, 1, totals)
    shot, truth = painted(clips["city"][:13], range(13), *texts["logo"])
    compared("logo in the second, of 2.4 s", [clips["tunnel"], shot], truth, 1, totals)
    noise = np.random.default_rng(0)
    still = [clips["city"][0] + noise.normal(0, 1, (HEIGHT, WIDTH)).astype(np.float32) for _ in range(36)]
    shot, truth = painted(clips["tunnel"], range(len(clips["tunnel"])), *texts["logo"])
    compared("logo before a still city", [shot, still], truth, 0, totals)
    shot, truth = painted(still, range(len(still)), *texts["logo"])
    compared("logo over a still city", [clips["tunnel"], shot], truth, 1, totals)
    for mode, cases in totals.items():
        true = [case for case in cases if case[0]]
        print(f"{mode}: found {sum(case[1] for case in true)} of {len(true)}, mean IoU "
              f"{sum(case[2] for case in true) / len(true):.3f}, {sum(case[3] for case in cases)} false")


if __name__ == "__main__":
    main()
