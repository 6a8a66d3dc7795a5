#!/usr/bin/env python3
"""Compares evidence of operators, and people with what is joined to them, on clips with and without operators.

    operators.py [--only outlines|people] TUNNEL CITY STREET HALL

TUNNEL and CITY are equirectangular videos whose camera moves, the first with an operator, the second without one;
STREET and HALL are folders of panoramas without an operator. Operators are painted over the others and over a painted sea,
with a sway of some degrees. First prints the evidence of outlines, with the IoU of its region; then the IoU of people
as a network would show them (holes, missed parts, missed frames), of these with what is joined to them, and of the best
single mask. A model in NumPy of `curate/src/masks/operator` (`evidence` with fewer axes and the nearest pixels,
`region`, `people`, `attached`) makes them, of 256x128 images half a second apart. Needs NumPy, SciPy, Pillow and
ffmpeg; takes some minutes.
"""

import argparse
import math
import pathlib
import subprocess

import numpy as np
from PIL import Image, ImageDraw
from scipy import ndimage

WIDTH, HEIGHT = 256, 128
FRAMES_PER_SECOND = 2
NOISE = 1 / 255
ROWS = np.arange(HEIGHT)[:, None]
COLUMNS = np.arange(WIDTH)[None, :]
LATITUDE = (0.5 - (ROWS + 0.5) / HEIGHT) * math.pi
LONGITUDE = ((COLUMNS + 0.5) / WIDTH - 0.5) * 2 * math.pi
AREA = 2 * math.pi / WIDTH * math.pi / HEIGHT * np.cos(LATITUDE) * np.ones((1, WIDTH))
DIRECTION = np.stack([np.cos(LATITUDE) * np.sin(LONGITUDE), -np.sin(LATITUDE) * np.ones((1, WIDTH)),
                      np.cos(LATITUDE) * np.cos(LONGITUDE)], -1)


def row_at(degrees):
    return int((0.5 - degrees / 180) * HEIGHT)


def places(direction):
    """Returns rows and columns of directions."""
    longitude = np.arctan2(direction[..., 0], direction[..., 2])
    latitude = np.arctan2(-direction[..., 1], np.hypot(direction[..., 0], direction[..., 2]))
    return (np.clip((0.5 - latitude / math.pi) * HEIGHT - 0.5, 0, HEIGHT - 1),
            (longitude / (2 * math.pi) + 0.5) * WIDTH - 0.5)


def filtered(image, weights):
    image = ndimage.convolve1d(image, weights, axis=-1, mode="wrap")
    return ndimage.convolve1d(image, weights, axis=-2, mode="nearest")


def blurred(image, sigma):
    reach = math.ceil(3 * sigma)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return filtered(image, weights / weights.sum())


def averaged(image):
    return filtered(image, np.full(3, 1 / 3))


def grown(marks, reach):
    padded = np.pad(marks, ((0, 0), (reach, reach)), mode="wrap").astype(np.uint8)
    return ndimage.maximum_filter(padded, 2 * reach + 1, mode="constant")[:, reach:-reach] > 0


def closed(marks, reach):
    return ~grown(~grown(marks, reach), reach)


def smoothed(marks, reach):
    return grown(~grown(~closed(marks, reach), reach), reach)


def labelled(marks):
    """Numbers connected regions, across the seam too."""
    labels, _ = ndimage.label(marks)
    for left, right in labels[:, [0, -1]]:
        if left and right and left != right:
            labels[labels == right] = left
    return labels


def touching(marks, seeds):
    labels = labelled(marks)
    numbers = np.unique(labels[seeds])
    return np.isin(labels, numbers[numbers > 0])


def iou(mask, truth):
    """Returns the IoU of one mask with the truth of all frames."""
    return (AREA * (mask & truth)).sum() / max((AREA * (mask | truth)).sum(), 1e-9)


# Clips.

def decoded(video):
    scale = f"fps={FRAMES_PER_SECOND},scale={WIDTH}:{HEIGHT}:flags=area+accurate_rnd,format=rgb24"
    command = ["ffmpeg", "-nostdin", "-v", "error", "-i", video, "-vf", scale, "-f", "rawvideo", "-"]
    raw = subprocess.check_output(command)
    return np.frombuffer(raw, np.uint8).reshape(-1, HEIGHT, WIDTH, 3).astype(np.float32) / 255


def opened(folder):
    """Reads every fourth panorama of a folder: rendered scenes are short."""
    files = sorted(pathlib.Path(folder).iterdir())[::4]
    images = [Image.open(file).convert("RGB").resize((WIDTH, HEIGHT), Image.BOX) for file in files]
    return np.stack([np.asarray(image, np.float32) / 255 for image in images])


def sea(noise, count=16):
    """Paints a sky that stands above water of which every frame has other waves."""
    sky = ndimage.gaussian_filter(noise.normal(size=(HEIGHT, WIDTH)), [4, 10], mode=["nearest", "wrap"])
    sky = (0.7 + 0.15 * sky / sky.std())[..., None] * np.array([0.9, 0.95, 1])
    depth = np.clip(ROWS / (HEIGHT / 2) - 1, 0, 1)[..., None]
    frames = []
    for _ in range(count):
        waves = 0
        for amplitude, size in ((0.05, [0.8, 1.6]), (0.05, [5, 12])):
            wave = ndimage.gaussian_filter(noise.normal(size=(HEIGHT, WIDTH)), size, mode=["nearest", "wrap"])
            waves = waves + amplitude * wave / wave.std()
        water = np.array([0.05, 0.3, 0.35]) * (1 - 0.5 * depth) + waves[..., None]
        frames.append(np.clip(np.where((ROWS >= HEIGHT / 2)[..., None], water, sky), 0, 1))
    return np.stack(frames).astype(np.float32)


def texture(noise, colour, amplitude, size=1.2):
    shade = ndimage.gaussian_filter(noise.normal(size=(HEIGHT, WIDTH)), size, mode="wrap")
    return np.array(colour) + amplitude * (shade / shade.std())[..., None]


def painted(parts):
    """Returns colours and opacity of parts, the first one lowest: (opacity, colours)."""
    opacity, colours = np.zeros((HEIGHT, WIDTH, 1)), np.zeros((HEIGHT, WIDTH, 3))
    for alpha, colour in parts:
        alpha = alpha[..., None]
        colours, opacity = colours * (1 - alpha) + colour * alpha, opacity * (1 - alpha) + alpha
    return colours / np.maximum(opacity, 1e-6), opacity[..., 0]


def polygon(points):
    image = Image.new("L", (4 * WIDTH, 4 * HEIGHT))
    ImageDraw.Draw(image).polygon([(4 * x, 4 * y) for x, y in points], fill=255)
    return np.asarray(image.resize((WIDTH, HEIGHT), Image.BOX), np.float32) / 255


def ellipse(x, y, wide, high):
    return np.clip((1 - np.hypot((COLUMNS + 0.5 - x) / wide, (ROWS + 0.5 - y) / high)) * min(wide, high) + 0.5, 0, 1)


def rider(noise, x, shirt, board):
    """Paints a person on a board; returns colours, opacity, and that of the person alone."""
    skin, dark = texture(noise, (0.55, 0.38, 0.28), 0.04), texture(noise, (0.1, 0.1, 0.12), 0.03)
    beside = lambda points: polygon([(x + dx, y) for dx, y in points])
    body = [(beside([(-8, 62), (8, 62), (10, 84), (-10, 84)]), texture(noise, shirt, 0.04)),
            (beside([(-10, 83), (10, 83), (14, 100), (6, 101), (0, 90), (-6, 101), (-14, 100)]), dark),
            (beside([(-8, 63), (-18, 78), (-22, 88), (-19, 89), (-14, 80), (-6, 70)]), skin),
            (ellipse(x, 55, 6, 8), skin), (ellipse(x, 50, 6.5, 5), texture(noise, (0.2, 0.13, 0.08), 0.05))]
    plank = beside([(-50, 108), (-10, 98), (18, 86), (24, 92), (10, 110), (-20, 117)])
    return *painted([(plank, texture(noise, board, 0.03)), *body]), painted(body)[1]


def hair(noise):
    """Paints a head seen from above, all around the nadir."""
    around = 2 * math.pi * COLUMNS / WIDTH
    top = 100 + 8 * np.sin(around + 1) + 3 * np.sin(3 * around)
    top = top + ndimage.gaussian_filter1d(noise.normal(size=WIDTH), 1, mode="wrap")
    colours, opacity = painted([(np.clip(ROWS + 0.5 - top, 0, 1), texture(noise, (0.35, 0.25, 0.17), 0.07, [0.6, 3]))])
    return colours, opacity, opacity


def swayed(noise, count, degrees):
    """Returns smooth random rotations of this mean angle."""
    turns = ndimage.gaussian_filter1d(noise.normal(size=(count, 3)), 1.0, axis=0, mode="wrap")
    turns *= math.radians(degrees) / np.linalg.norm(turns, axis=1).mean()
    rotations = []
    for turn in turns:
        angle = np.linalg.norm(turn)
        x, y, z = turn / max(angle, 1e-12)
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        rotations.append(np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross)
    return rotations


def carried(noise, frames, operator, degrees):
    """Returns frames with an operator, and per frame the true mask and that of the person."""
    found, layers = [], np.dstack([operator[0], operator[1], operator[2]])
    for frame, rotation in zip(frames, swayed(noise, len(frames), degrees)):
        place = places(DIRECTION @ rotation)
        layer = [ndimage.map_coordinates(layers[..., k], place, order=1, mode="grid-wrap") for k in range(5)]
        layer = np.stack(layer, -1)
        found.append((frame * (1 - layer[..., 3:4]) + np.clip(layer[..., :3], 0, 1) * layer[..., 3:4],
                      layer[..., 3] > 0.5, layer[..., 4] > 0.5))
    return [np.stack(part) for part in zip(*found)]


# Outlines.

def along(images, axis):
    """Returns the change of images that are moved along a path."""
    tangent = axis - (DIRECTION @ axis)[..., None] * DIRECTION
    tangent /= np.maximum(np.linalg.norm(tangent, axis=-1, keepdims=True), 1e-9)
    change = 0
    for angle in (0.07, -0.07, 0.12, -0.12, 0.19, -0.19):
        row, column = places(math.cos(angle) * DIRECTION + math.sin(angle) * tangent)
        row, column = np.round(row).astype(int), np.round(column).astype(int) % WIDTH
        change = change + sum(np.abs(image[row, column] - image) for image in images)
    return averaged(change / (6 * len(images)))


def staying(over_time, moved, axis, least_sine):
    sine = np.sqrt(np.maximum(0, 1 - (DIRECTION @ axis) ** 2))
    stays = (over_time < 0.55 * (moved + NOISE)) & (moved > 6 * NOISE) & (sine > least_sine)
    return np.where(stays, np.maximum(moved - over_time, 0), 0)


def median_on_sphere(values):
    order = np.argsort(values.ravel())
    below = AREA.ravel()[order].cumsum()
    return values.ravel()[order][np.searchsorted(below, below[-1] / 2)]


def over_time(images):
    """Returns the mean change within a second."""
    return averaged(np.abs(images[FRAMES_PER_SECOND:] - images[:-FRAMES_PER_SECOND]).mean(0))


def evidence(frames):
    """Returns the evidence of each pixel, that without slow shades, and the median ratio of the changes."""
    images = blurred(frames @ np.array([0.2126, 0.7152, 0.0722]), 0.7)
    change, few = over_time(images), images[len(images) // 4::max(1, len(images) // 2)]
    y = 1 - 2 * (np.arange(60) + 0.5) / 60
    turn = math.pi * (3 - math.sqrt(5)) * np.arange(60)
    axes = np.stack([np.sqrt(1 - y * y) * np.cos(turn), y, np.sqrt(1 - y * y) * np.sin(turn)], 1)[y >= 0]
    cost = lambda axis: (staying(change, along(few, axis), axis, 0.05) * AREA).sum()
    costs = np.array([cost(axis) for axis in axes])
    axis = axes[costs.argmin()]
    for step in (0.09, 0.045):
        first = np.cross(axis, [0.3, 0.5, 0.8])
        first /= np.linalg.norm(first)
        second = np.cross(axis, first)
        beside = [math.cos(k * math.pi / 3) * first + math.sin(k * math.pi / 3) * second for k in range(6)]
        axis = min([axis, *(math.cos(step) * axis + math.sin(step) * way for way in beside)], key=cost)
    likely = [axis]
    for other in axes[np.argsort(costs)][:(costs <= 1.1 * cost(axis)).sum()]:
        if all(abs(other @ one) < math.cos(0.2) for one in likely):
            likely.append(other)
    sharp = images - blurred(images, 3.0)
    def stays_along(compared, one):
        """Returns the evidence along an axis; all but the best one tell nothing of what is near their ends."""
        stays = staying(over_time(compared), along(compared[::2], one), one, 0.35 if one is axis else 0)
        near_ends = (DIRECTION @ one) ** 2 >= 1 - 0.35 ** 2
        return np.where(near_ends & (one is not axis), np.inf, stays)

    least = lambda compared: np.min([stays_along(compared, one) for one in likely], axis=0)
    return least(images), least(sharp), median_on_sphere(change / (along(images[::2], axis) + NOISE))


def joined_around(marked, tops):
    at = np.flatnonzero(marked)
    around = np.concatenate([at - WIDTH, at, at + WIDTH])
    return np.interp(np.arange(WIDTH), around, np.tile(tops[at], 3)).astype(int)


def region(stays, sharp):
    """Returns the region of evidence near outlines, and the evidence of its strongest part with and without shades."""
    stays = np.where(grown(sharp > 0, 2), stays, 0)
    seeds = (stays > 0) & (ROWS >= row_at(-15))
    labels = labelled(grown(seeds, 1))
    sums = lambda field: ndimage.sum_labels(255 * field * AREA * seeds, labels, np.arange(labels.max() + 1))
    strength = sums(stays)
    strength[0] = 0
    strongest = strength.argmax()
    if strength[strongest] == 0:
        return np.zeros((HEIGHT, WIDTH), bool), 0.0, 0.0
    kept = seeds & (strength >= 0.3 * strength[strongest])[labels] & (ROWS < row_at(-65))
    marked, tops, bottom = kept.any(0), kept.argmax(0), row_at(-78)
    if marked.mean() >= 0.5:
        tops, bottom = joined_around(marked, tops), HEIGHT
        marked = np.ones(WIDTH, bool)
    mask = smoothed(marked & (ROWS >= tops) & (ROWS < bottom), 3)
    return mask, strength[strongest], sums(sharp)[strongest]


# People.

def shown(noise, people):
    """Returns people as a network shows them: with lasting and with passing holes, and not in every frame."""
    def kept(share):
        field = ndimage.gaussian_filter(noise.normal(size=(HEIGHT, WIDTH)), 4, mode="wrap")
        return field > np.quantile(field, share)
    lasting = kept(0.15)
    return np.stack([frame & lasting & kept(0.25) & (noise.random() > 0.15) for frame in people])


def core(people, least_share=0.35):
    near = np.mean([grown(frame, 4) for frame in people], 0) >= 0.6
    often = people.mean(0) >= least_share
    return touching(often, often & near)


def distances(frame):
    """Returns distances of colours from the median of their row, in deviations."""
    middle = np.median(frame, 1, keepdims=True)
    variance = (1.4826 * np.median(np.abs(frame - middle), 1, keepdims=True)) ** 2
    variance = ndimage.uniform_filter1d(variance, 5, axis=0, mode="nearest") + 0.03**2
    return averaged(np.sqrt(((frame - middle) ** 2 / variance).mean(-1)))


def joined(frames, people, kept, unlike=2.5, reach=28, least_share=0.4):
    near, votes = grown(kept, reach), 0
    for frame, person in zip(frames, people):
        own = kept | (person & near)
        foreign = smoothed((distances(frame) > unlike) & near, 1)
        votes = votes + touching(foreign | own, own)
    mask = closed((votes >= least_share * len(frames)) | kept, 3)
    labels = labelled(~mask)
    areas = ndimage.sum_labels(AREA, labels, np.arange(labels.max() + 1))
    areas[0] = 0
    mask |= labels != areas.argmax()
    if mask[row_at(-78)].mean() < 0.5:
        return mask
    return ROWS >= joined_around(mask.any(0), mask.argmax(0))


def print_outlines(clips):
    print("outlines: evidence, 4 times that without slow shades, median ratio, IoU")
    for name, (frames, with_operator) in clips.items():
        stays, sharp, ratio = evidence(with_operator[0] if with_operator else frames)
        mask, strength, clear = region(stays, sharp)
        overlap = f"{iou(mask, with_operator[1]):.2f}" if with_operator else "-"
        print(f"  {name}: {strength:.2f}, {4 * clear:.2f}, {ratio:.2f}, {overlap}", flush=True)


def print_people(noise, clips):
    print("people: IoU of them alone, with what is joined, of the best single mask")
    sums = []
    for name, (_, with_operator) in clips.items():
        if not with_operator:
            continue
        frames, truth, people = (part[::2][:8] for part in with_operator)
        people = shown(noise, people)
        kept = core(people)
        best = max(iou(truth.mean(0) >= share, truth) for share in (0.2, 0.3, 0.4, 0.5, 0.6))
        sums.append((iou(kept, truth), iou(joined(frames, people, kept), truth), best))
        print(f"  {name}: {sums[-1][0]:.2f}, {sums[-1][1]:.2f}, {best:.2f}", flush=True)
    print("  mean: " + ", ".join(f"{value:.3f}" for value in np.mean(sums, 0)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for name in ("tunnel", "city", "street", "hall"):
        parser.add_argument(name)
    parser.add_argument("--only", choices=("outlines", "people"))
    options = parser.parse_args()
    noise = np.random.default_rng(3)
    scenes = {"city": decoded(options.city), "street": opened(options.street), "hall": opened(options.hall),
              "sea": sea(noise)}
    still = scenes["city"][:1] + noise.normal(0, 0.004, (16, HEIGHT, WIDTH, 3)).astype(np.float32)
    clips = {"tunnel": (decoded(options.tunnel), None), "city that stands": (still, None)}
    clips |= {name: (frames, None) for name, frames in scenes.items()}
    operators = {"rider": rider(noise, 128, (0.1, 0.35, 0.8), (0.9, 0.9, 0.88)),
                 "walker": rider(noise, 60, (0.45, 0.42, 0.4), (0.12, 0.12, 0.13)), "hair": hair(noise)}
    for name, operator in operators.items():
        for scene, frames in scenes.items():
            for degrees in (0, 6):
                clips[f"{name} in {scene}, {degrees} degrees"] = (frames, carried(noise, frames, operator, degrees))
    if options.only != "people":
        print_outlines(clips)
    if options.only != "outlines":
        print_people(noise, clips)


if __name__ == "__main__":
    main()
