#!/usr/bin/env python3
"""Paints passing captions over equirectangular footage and counts those that are found.

    captions.py SET... --tested TESTED... [--seeds N]

Clips are videos whose frames are 0.2 s or less apart, named by path; of `NAME:left` the upper half is taken (stereo
top-bottom). Prints for each clip what is found where nothing is painted, then recall and IoU of rectangles over
captions of random text, size, style, place and time, and false finds, for the clips that set limits and for those that
test them. A model in NumPy of `curate/src/overlays` (`runs`, `captions`) makes them, of 512x256 images. Needs NumPy,
Pillow and ffmpeg; takes a minute for ten painted clips.
"""

import argparse
import math
import subprocess

import numpy as np
from PIL import Image, ImageDraw, ImageFont

WIDTH, HEIGHT = 512, 256
LATITUDE = (0.5 - (np.arange(HEIGHT) + 0.5) / HEIGHT) * math.pi
AREA = np.repeat(2 * math.pi / WIDTH * math.pi / HEIGHT * np.cos(LATITUDE), WIDTH)
SAMPLES_PER_SECOND = 5
LEAST_STROKE, KEPT_SHARE, LEAST_SAMPLES = 14, 0.25, 4
BEGIN_SAMPLES, END_SAMPLES, MOST_BEGINS = 2, 1, 8
LEAST_NEAR, NEAR_PIXELS, REACH_PIXELS, LEAST_PROFILE = 7, 3, 10, 0.2
LEAST_STERADIANS, LEAST_DENSITY, MOST_STERADIANS, LEAST_PURITY, LEAST_CONCENTRATION = 0.012, 0.2, 0.8, 0.3, 0.5
LEAST_ASPECT, MOST_LATITUDE, PROMINENT_STERADIANS = 1.2, 65, 0.02
LONG_SAMPLES, LEAST_SHORT_STRENGTH = 6, 40
AREAS = AREA.reshape(HEIGHT, WIDTH)
TEXTS = ["Oahu, Hawaii", "Jane Doe, engineer", "ANTHONY WALSH", "Day 3: the old harbour", "SUBSCRIBE", "Kyoto 2019",
         "Dr. Lee\nMarine biologist", "www.wander360.com", "We walk up to the gate now", "Entering the tunnel, km 4"]


def samples(clip):
    """Returns the luminance of a clip every 0.2 s."""
    path, _, eye = clip.partition(":")
    half = "crop=iw:ih/2:0:0," if eye else ""
    scale = f"{half}fps={SAMPLES_PER_SECOND},scale={WIDTH}:{HEIGHT}:flags=area+accurate_rnd,format=gray"
    raw = subprocess.check_output(["ffmpeg", "-nostdin", "-v", "error", "-i", path, "-vf", scale, "-f", "rawvideo", "-"])
    return np.frombuffer(raw, np.uint8).reshape(-1, HEIGHT, WIDTH).astype(np.float32)


def grown(marks, reach):
    wide = marks.copy()
    for shift in range(1, reach + 1):
        wide |= np.roll(marks, shift, 1) | np.roll(marks, -shift, 1)
    tall = wide.copy()
    for shift in range(1, reach + 1):
        tall[shift:] |= wide[:-shift]
        tall[:-shift] |= wide[shift:]
    return tall


def regions(marks, reach):
    """Returns the pixels of neighbourhoods of marks that touch, across the seam too."""
    left, found = grown(marks, reach).ravel().tolist(), []
    for start in np.flatnonzero(left).tolist():
        if not left[start]:
            continue
        left[start], border, pixels = False, [start], []
        while border:
            at = border.pop()
            pixels.append(at)
            row, column = divmod(at, WIDTH)
            beside = [row * WIDTH + (column + 1) % WIDTH, row * WIDTH + (column - 1) % WIDTH]
            beside += [at - WIDTH] * (row > 0) + [at + WIDTH] * (row + 1 < HEIGHT)
            for near in beside:
                if left[near]:
                    left[near] = False
                    border.append(near)
        found.append(np.array(pixels))
    return found


class Runs:
    """For each pixel, the run of a constant stroke that goes on and the last that ended."""

    def __init__(self):
        self.mean = np.zeros((2, HEIGHT, WIDTH), np.float32)
        self.count, self.begin = np.zeros((2, HEIGHT, WIDTH), int)
        self.ended_begin, self.ended_end = np.full((2, HEIGHT, WIDTH), -99)
        self.strength, self.ended_strength = np.zeros((2, HEIGHT, WIDTH), np.float32)

    def add(self, number, level):
        gradient = np.zeros_like(self.mean)
        if level is not None:
            gradient = np.stack([np.roll(level, -1, 1) - level, np.vstack([level[1:], level[-1:]]) - level])
        strength = np.hypot(*gradient)
        is_stroke = strength >= LEAST_STROKE
        near = np.hypot(*(gradient - self.mean)) <= KEPT_SHARE * np.maximum(strength, np.hypot(*self.mean))
        goes_on = (self.count > 0) & is_stroke & near
        ends = (self.count >= LEAST_SAMPLES) & ~goes_on
        self.ended_begin[ends], self.ended_end[ends] = self.begin[ends], number - 1
        self.ended_strength[ends] = self.strength[ends]
        self.count = np.where(goes_on, self.count + 1, is_stroke)
        self.begin = np.where(goes_on, self.begin, number)
        self.strength = np.where(goes_on, self.strength + (strength - self.strength) / np.maximum(self.count, 1), strength)
        self.mean = np.where(goes_on, self.mean + (gradient - self.mean) / np.maximum(self.count, 1), gradient)


def near_count(marks):
    wide = np.pad(marks.astype(int), ((NEAR_PIXELS, NEAR_PIXELS), (0, 0)))
    rows = sum(wide[shift:shift + HEIGHT] for shift in range(2 * NEAR_PIXELS + 1))
    return sum(np.roll(rows, shift, 1) for shift in range(-NEAR_PIXELS, NEAR_PIXELS + 1))


def trimmed(values):
    """Returns the first and last value that is not rare."""
    kept, counts = np.unique(values, return_counts=True)
    kept = kept[counts >= LEAST_PROFILE * counts.max()]
    return kept[0], kept[-1]


def rectangle(rows, columns):
    """Returns top, bottom, left and number of columns around pixels, without sparse borders."""
    top, bottom = trimmed(rows)
    columns = np.unique(columns[(rows >= top) & (rows <= bottom)], return_counts=True)
    gaps = np.diff(np.append(columns[0], columns[0][0] + WIDTH))
    seam = columns[0][(gaps.argmax() + 1) % len(gaps)]
    left, right = trimmed(np.repeat((columns[0] - seam) % WIDTH, columns[1]))
    return top, bottom, (seam + left) % WIDTH, right + 1 - left


def groups(runs, number):
    """Returns the strokes that began and ended together, with ends around the last sample but one."""
    end, found = number - 1 - END_SAMPLES, []
    ended = np.abs(runs.ended_end - end) <= END_SAMPLES
    begins, areas = np.unique(runs.ended_begin[ended], return_inverse=True)
    mass = np.bincount(areas, AREAS[ended], len(begins))
    around = [mass[np.abs(begins - begin) <= BEGIN_SAMPLES].sum() for begin in begins]
    tried = []
    for at in np.argsort(-np.array(around), kind="stable"):
        if around[at] >= LEAST_STERADIANS and len(tried) < MOST_BEGINS and all(abs(begins[at] - one) > 1 for one in tried):
            tried.append(begins[at])
    for begin in tried:
        marks = ended & (np.abs(runs.ended_begin - begin) <= BEGIN_SAMPLES)
        marks &= near_count(marks) >= LEAST_NEAR
        for pixels in regions(marks, REACH_PIXELS // 2):
            rows, columns = np.divmod(pixels[marks.ravel()[pixels]], WIDTH)
            top, bottom, left, count = rectangle(rows, columns)
            inside = np.ix_(range(top, bottom + 1), (left + np.arange(count)) % WIDTH)
            own = np.zeros_like(marks)
            own[rows, columns] = True
            strokes = AREAS[inside][own[inside]].sum()
            if strokes < LEAST_STERADIANS:
                continue
            other = ~marks & ((runs.count >= LEAST_SAMPLES) | (runs.ended_end >= begin))
            median = lambda values: int(np.sort(values[own])[own.sum() // 2])
            found.append({"begin": median(runs.ended_begin), "end": median(runs.ended_end), "at": (top, bottom, left, count), "strokes": strokes,
                          "steradians": AREAS[inside].sum(), "purity": strokes / (strokes + AREAS[inside][other[inside]].sum()),
                          "concentration": strokes / AREAS[marks].sum(),
                          "strength": np.average(runs.ended_strength[own], weights=AREAS[own])})
    return found


def middle(one):
    top, bottom, left, count = one["at"]
    return (left + count / 2) / WIDTH * 360 % 360, (0.5 - (top + bottom + 1) / 2 / HEIGHT) * 180


def is_caption(one):
    top, bottom, _, count = one["at"]
    latitude = middle(one)[1]
    aspect = count / WIDTH * 2 * math.cos(math.radians(latitude)) / ((bottom + 1 - top) / HEIGHT)
    return (one["strokes"] >= LEAST_DENSITY * one["steradians"] and one["steradians"] <= MOST_STERADIANS
            and one["purity"] >= LEAST_PURITY and one["concentration"] >= LEAST_CONCENTRATION
            and (one["end"] + 1 - one["begin"] >= LONG_SAMPLES or one["strength"] >= LEAST_SHORT_STRENGTH)
            and aspect >= LEAST_ASPECT and abs(latitude) <= MOST_LATITUDE)


def is_same(one, other):
    (east, north), (other_east, other_north) = middle(one), middle(other)
    across = abs(east - other_east)
    return (abs(one["begin"] - other["begin"]) <= 3 and abs(one["end"] - other["end"]) <= 3
            and min(across, 360 - across) < 20 and abs(north - other_north) < 20)


def shared(one, other):
    """Returns the rows and columns that two rectangles share, as a number of pixels."""
    columns = [(at[2] + np.arange(at[3])) % WIDTH for at in (one, other)]
    rows = min(one[1], other[1]) + 1 - max(one[0], other[0])
    return max(0, int(rows)) * len(np.intersect1d(*columns))


def captions(frames):
    """Returns the captions that pass within frames, as `CaptionPass::captions` without boundaries."""
    runs, found = Runs(), []
    for number in range(len(frames) + 2):
        if number <= len(frames):
            runs.add(number, frames[number] if number < len(frames) else None)
        found += groups(runs, number)
    known = []
    for one in sorted(found, key=lambda one: -one["strokes"]):
        if not any(is_same(other, one) for other in known):
            known.append(one)
    kept = []
    for one in filter(is_caption, known):
        together = lambda other: one["begin"] <= other["end"] and other["begin"] <= one["end"]
        is_free = one["begin"] > 1 or one["end"] < len(frames) - 2
        if (is_free or one["end"] - one["begin"] >= 9) and not any(
                together(other) and shared(one["at"], other["at"]) for other in kept):
            kept.append(one)
    return kept


def painted(frames, seed):
    """Returns frames with a caption, and its rectangle and number of samples."""
    random = np.random.default_rng(seed)
    count = min(max(6, round(random.uniform(1.2, 4.0) * SAMPLES_PER_SECOND)), len(frames) - 8)
    begin = int(random.integers(3, max(4, len(frames) - count - 3)))
    text, size, style = TEXTS[random.integers(len(TEXTS))], int(random.integers(18, 44)), random.integers(3)
    fade, wipes, is_dark = int(random.integers(3)), bool(random.integers(2)) and style == 1, random.random() >= 0.8
    image, alpha = Image.new("L", (2 * WIDTH, 2 * HEIGHT)), Image.new("L", (2 * WIDTH, 2 * HEIGHT))
    pens = ImageDraw.Draw(image), ImageDraw.Draw(alpha)
    font = ImageFont.load_default(size)
    box = pens[0].multiline_textbbox((0, 0), text, font=font)
    place = int(random.integers(0, 2 * WIDTH - box[2] - 10)), int(random.uniform(0.3, 0.72) * 2 * HEIGHT)
    front, back = (20, 255) if is_dark else (255, 0)
    if style == 1:
        edge, opacity = size // 4, 255 if random.random() < 0.6 else 190
        around = (place[0] + box[0] - edge, place[1] + box[1] - edge, place[0] + box[2] + edge, place[1] + box[3] + edge)
        pens[0].rectangle(around, fill=back)
        pens[1].rectangle(around, fill=opacity)
    if style == 2:
        for pen, fill in zip(pens, (back, 255)):
            pen.multiline_text((place[0] + 1, place[1] + 1), text, fill=fill, font=font, stroke_width=1, stroke_fill=fill)
    for pen, fill in zip(pens, (front, 255)):
        pen.multiline_text(place, text, fill=fill, font=font)
    small = lambda values: np.asarray(Image.fromarray(values).resize((WIDTH, HEIGHT), Image.BOX))
    cover = np.asarray(alpha, np.float32) / 255
    light, cover = small(np.asarray(image, np.float32) * cover), small(cover)
    rows, columns = np.nonzero(cover > 0.1)
    at = rows.min(), rows.max(), columns.min(), columns.max() + 1 - columns.min()
    frames = frames + random.normal(0, 1, frames.shape).astype(np.float32)
    for number in range(count):
        share = min(1, (number + 1) / (fade + 1), (count - number) / (fade + 1)) if fade else 1
        shown = np.ones(WIDTH, np.float32)
        if wipes and number < 2:
            shown[at[2] + at[3] * (number + 1) // 3:] = 0
        frames[begin + number] += shown * share * (light - cover * frames[begin + number])
    # Eight samples around it are enough.
    first, last = max(0, begin - 8), begin + count + 8
    return np.clip(frames[first:last], 0, 255), at, count, AREAS[at[0]:at[1] + 1, 0].sum() * at[3]


def overlap(one, other):
    pixels = lambda at: (at[1] + 1 - at[0]) * at[3]
    both = shared(one, other)
    return both / (pixels(one) + pixels(other) - both)


def scored(name, clips, seeds):
    found, count, overlaps, false, times = 0, 0, [], 0, {}
    for clip in clips:
        frames = samples(clip)
        alone = [one for one in captions(frames) if one["steradians"] > PROMINENT_STERADIANS]
        print(f"{clip}: {len(alone)} where nothing is painted, in {len(frames) / SAMPLES_PER_SECOND:.0f} s", flush=True)
        for seed in seeds:
            shown, at, length, steradians = painted(frames[:100], seed)
            if steradians <= PROMINENT_STERADIANS:
                continue
            finds = [one for one in captions(shown) if one["steradians"] > PROMINENT_STERADIANS]
            best = max((overlap(one["at"], at) for one in finds), default=0)
            hits, all_of = times.get(length >= 10, (0, 0))
            times[length >= 10] = hits + (best > 0.3), all_of + 1
            found, count, false = found + (best > 0.3), count + 1, false + sum(shared(one["at"], at) == 0 for one in finds)
            overlaps += [best] * int(best > 0.3)
    share = lambda is_long: "{} of {}".format(*times.get(is_long, (0, 0)))
    print(f"{name}: found {found} of {count} ({share(False)} below 2 s, {share(True)} longer), mean IoU "
          f"{np.mean(overlaps):.3f}, least {min(overlaps):.2f}, {false} false", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("set", nargs="*")
    parser.add_argument("--tested", nargs="*", default=[])
    parser.add_argument("--seeds", type=int, default=16, help="painted captions for each clip")
    options = parser.parse_args()
    if options.set:
        scored("set", options.set, range(options.seeds))
    if options.tested:
        scored("tested", options.tested, range(1000, 1000 + options.seeds))


if __name__ == "__main__":
    main()
