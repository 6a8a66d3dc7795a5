#!/usr/bin/env python3
"""Counts what the diagnosis of predicted views finds, and what it alarms about falsely.

    diagnosis.py SCENES [--only NAME]... [--verbose]

SCENES has one folder of at least 20 frames (PNG or JPEG, in the order of their names, of one size) per
scene; images twice as wide as high are panoramas. Views as honest methods leave them must have no
finding; each mistake of convention, made in views of a good, a poor and a very poor simulated method, must
have its own and no other. Views that are made of one side of time alone are counted apart: they are told
as the frames before. Prints a table of the mistakes, the counts of the rest, and every false alarm.

The criteria are in `criteria.py`. Needs NumPy and Pillow; takes a minute or two per scene.
"""

import argparse
import collections
import pathlib
import zlib

import numpy as np
from PIL import Image, ImageFilter

from criteria import ENCODINGS, ORDERS, VIEWS, Scene, findings, spread

# -- honest methods ------------------------------------------------------------------------------


def rounded(image):
    return np.clip(np.floor(np.asarray(image, dtype=np.float64) + 0.5), 0, 255).astype(np.uint8)


def enlarged(image):
    """From half the size, without a shift where a side is odd."""
    size = image.shape[1::-1]
    half = Image.fromarray(image).resize([side // 2 for side in size], Image.BOX)
    return np.asarray(half.resize(size, Image.BILINEAR))


def blurred(image, sigma):
    return np.asarray(Image.fromarray(image).filter(ImageFilter.GaussianBlur(sigma)))


def field(shape, cell, random):
    """A smooth random field of deviation 1."""
    coarse = random.normal(size=[side // cell + 3 for side in shape]).astype(np.float32)
    fine = np.asarray(Image.fromarray(coarse).resize((shape[1], shape[0]), Image.BICUBIC))
    return (fine - fine.mean()) / fine.std()


def sampled(image, x, y):
    """Bilinear samples; columns wrap, rows end."""
    height, width = image.shape[:2]
    y = np.clip(y, 0, height - 1)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - left)[..., None], (y - top)[..., None]
    at = lambda column, row: image[np.minimum(row, height - 1), column % width].astype(np.float64)
    upper = (1 - a) * at(left, top) + a * at(left + 1, top)
    lower = (1 - a) * at(left, top + 1) + a * at(left + 1, top + 1)
    return (1 - b) * upper + b * lower


def rendered(image, random, blur, noise, tint, warp):
    """What a trained model makes of a view: blurred, noisy, of uneven colour and a little displaced."""
    shape = image.shape[:2]
    y, x = np.mgrid[: shape[0], : shape[1]].astype(np.float64)
    cell = shape[0] // 8
    image = sampled(image, x + warp * field(shape, cell, random), y + warp * field(shape, cell, random))
    image = blurred(rounded(image), blur).astype(np.float64)
    image += tint * np.stack([field(shape, 4 * cell, random) for _ in range(3)], 2)
    return rounded(image + random.normal(0, noise, image.shape))


QUALITIES = {"good": (0.8, 3, 4, 0.4), "poor": (2, 8, 12, 1.5), "very poor": (4, 12, 25, 5)}


def honest_methods(scene, given):
    frames = scene.frames

    def nearest(frame, later=False):
        return frames[min(given, key=lambda g: (abs(g - frame), -g if later else g))]

    def faded(frame):
        before, behind = ([g for g in given if g < frame][-1:], [g for g in given if g > frame][:1])
        if not (before and behind):
            return frames[(before + behind)[0]]
        share = (frame - before[0]) / (behind[0] - before[0])
        return rounded((1 - share) * frames[before[0]].astype(np.float64) + share * frames[behind[0]])

    def random(frame):
        return np.random.default_rng(zlib.crc32(scene.name.encode()) + frame)

    def good(frame):
        return rendered(frames[frame], random(frame), *QUALITIES["good"]).astype(np.float64)

    def holes(frame):
        image = good(frame)
        image[field(image.shape[:2], 20, random(frame)) > 1.2] = 0
        return rounded(image)

    def drift(frame):
        strength = random(frame + 1000)
        return rounded(255 * (good(frame) / 255) ** strength.uniform(0.85, 1.15) * strength.uniform(0.8, 1.25))

    mean_of_given = rounded(np.mean([frames[g] for g in given], 0))
    still = rounded(np.median([frames[g] for g in given[:: max(1, len(given) // 9)]], 0))
    methods = {
        "nearest": nearest,
        "nearest, later one": lambda f: nearest(f, True),
        "cross-fade": faded,
        "cross-fade, blurred": lambda f: blurred(faded(f), 1.5),
        "mean of seven frames": lambda f: rounded(np.mean([frames[g] for g in range(max(0, f - 3), min(len(frames), f + 4))], 0)),
        "mean of all given": lambda f: mean_of_given,
        "median of given": lambda f: still,
        "holes": holes,
        "exposure drifts": drift,
        "grey": lambda f: rounded(np.repeat(good(f).mean(2, keepdims=True), 3, 2)),
        "tint, gains": lambda f: rounded(good(f) * [1.12, 1, 0.88]),
        "tint, offsets": lambda f: rounded(good(f) + [-10, 3, 12]),
        "enlarged from half": lambda f: enlarged(frames[f]),
    }
    for name, quality in QUALITIES.items():
        methods[name] = lambda f, quality=quality: rendered(frames[f], random(f), *quality)
    for sigma in (1, 3, 8, 25):
        methods[f"blurred {sigma}"] = lambda f, sigma=sigma: blurred(frames[f], sigma)
    for noise in (10, 40):
        methods[f"noise {noise}"] = lambda f, noise=noise: rounded(frames[f] + random(f).normal(0, noise, frames[f].shape))
    for strength in (0.7, 0.85, 1.15, 1.4):
        methods[f"exposure {strength}"] = lambda f, strength=strength: rounded(strength * good(f))
    for offset in (-15, 15):
        methods[f"offset {offset}"] = lambda f, offset=offset: rounded(good(f) + offset)
    for contrast in (0.6, 0.8):
        methods[f"contrast {contrast}"] = lambda f, contrast=contrast: rounded(contrast * good(f) + (1 - contrast) * good(f).mean())
    for gamma in (0.85, 1.2):
        methods[f"gamma {gamma}"] = lambda f, gamma=gamma: rounded(255 * (good(f) / 255) ** gamma)
    return methods


def one_sided_methods(scene, given):
    """Views that are made of one side alone: no mistake, and hardly to be told from the frame before."""
    frames = scene.frames

    def before(frame):
        return max((g for g in given if g < frame), default=given[0])

    def extrapolated(frame):
        return rounded(2 * frames[max(0, frame - 1)].astype(np.float64) - frames[max(0, frame - 2)])

    random = lambda frame: np.random.default_rng(zlib.crc32(scene.name.encode()) + frame)
    return {
        "the given view before, rendered": lambda f: rendered(frames[before(f)], random(f), *QUALITIES["good"]),
        "extrapolated from two frames": extrapolated,
    }


# -- mistakes ------------------------------------------------------------------------------------


def moved(image, right, down):
    height, width = image.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float64)
    return rounded(sampled(image, x - right, y - down))


def mistakes(scene):
    """Name, kind of the finding and what is made of a view."""
    width = scene.frames[0].shape[1]
    yield "mirrored", ("turn", (True, False)), lambda image: image[:, ::-1]
    yield "upside down", ("turn", (False, True)), lambda image: image[::-1]
    yield "both", ("turn", (True, True)), lambda image: image[::-1, ::-1]
    if scene.wraps:
        for degrees in (90, 180, -90, 37, -12):
            columns = round(degrees * width / 360)
            yield f"turned {degrees} degrees", ("turn", (False, False)), lambda image, c=columns: np.roll(image, c, 1)
    for right, down in ((1, 0), (-2, 0), (0, 1), (0.5, 0), (-0.5, -0.5), (0, -0.5)):
        halves = (-round(2 * right), -round(2 * down))
        yield f"beside {right}, {down}", ("shift", (-halves[0], -halves[1])), lambda image, r=right, d=down: moved(image, r, d)
    for name, order in ORDERS.items():
        yield name, ("channels", name), lambda image, order=order: image[..., np.argsort(order)]
    for name, (forward, _) in ENCODINGS.items():
        yield name, ("encoding", name), lambda image, f=forward: rounded(255 * np.clip(f(image / 255), 0, 1))


def mistaken_orders(novel, count):
    permutation = np.random.default_rng(5).permutation(len(novel))
    last = len(novel) - 1
    yield "list, one on", ("place", 1), lambda f: novel[min(novel.index(f) + 1, last)]
    yield "list, one back", ("place", -1), lambda f: novel[max(novel.index(f) - 1, 0)]
    yield "reversed", "reversed", lambda f: novel[last - novel.index(f)]
    yield "permuted", "permuted", lambda f: novel[permutation[novel.index(f)]]
    yield "scene, one on", ("frame", 1), lambda f: min(f + 1, count - 1)
    yield "scene, one back", ("frame", -1), lambda f: f - 1


def same(found, expected):
    """Hits need the kind and what it names; linear light and its powers are told as the nearest, and frames
    beside each other are also places."""
    if found[0] != expected[0]:
        return False
    if found[0] == "encoding":
        alike = [{"linear", "gamma 2.2"}, {"sRGB twice", "gamma 1/2.2"}]
        return found[1] == expected[1] or {found[1], expected[1]} in alike
    if found[0] == "order" and expected[1][0] == "frame":
        return found[1] in (expected[1], ("place", expected[1][1]))
    return found[1] == expected[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", type=pathlib.Path)
    parser.add_argument("--only", action="append", help="a scene by name")
    parser.add_argument("--verbose", action="store_true", help="prints what was missed, too")
    arguments = parser.parse_args()
    honest, hits = collections.Counter(), collections.defaultdict(collections.Counter)
    folders = sorted(f for f in arguments.scenes.iterdir() if f.is_dir())
    for folder in folders:
        if arguments.only and folder.name not in arguments.only:
            continue
        scene = Scene(folder)
        for protocol, novel, given in scene.splits():
            frames = spread(novel, VIEWS)
            methods = honest_methods(scene, given)
            for name, method in methods.items():
                found = findings(scene, frames, [method(f) for f in frames], novel, given)
                honest["sets of views"] += 1
                honest["false alarms"] += bool(found)
                if found:
                    print(f"false alarm: {scene.name}, {protocol}, {name}: {found}", flush=True)
            for method in one_sided_methods(scene, given).values():
                honest["sets of views of one side"] += 1
                honest["of one side with a finding"] += bool(
                    findings(scene, frames, [method(f) for f in frames], novel, given))
            for quality in QUALITIES:
                made = {}

                def view(frame):
                    if frame not in made:
                        made[frame] = methods[quality](frame)
                    return made[frame]

                tried = [(n, ("order", e), [view(shown(f)) for f in frames]) for n, e, shown in mistaken_orders(novel, len(scene.frames))]
                if protocol == "per-scene":
                    tried += [(n, e, [np.ascontiguousarray(made_wrong(view(f))) for f in frames]) for n, e, made_wrong in mistakes(scene)]
                for name, expected, predicted in tried:
                    found = findings(scene, frames, predicted, novel, given)
                    right = [f for f in found if same(f, expected)]
                    counts = hits[expected[0], name, quality]
                    counts["tried"] += 1
                    counts["found"] += bool(right)
                    counts["other"] += len(found) > len(right)
                    if arguments.verbose and (not right or len(found) > len(right)):
                        print(f"{scene.name}, {protocol}, {quality}, {name}: {found}", flush=True)
        print(f"{scene.name}: done", flush=True)
    print(f"\nhonest: {honest['false alarms']} of {honest['sets of views']} sets of views have a finding")
    print(f"of one side: {honest['of one side with a finding']} of {honest['sets of views of one side']}\n")
    print("| kind | mistake | " + " | ".join(QUALITIES) + " | another finding |")
    print("|---|---|" + "---|" * (len(QUALITIES) + 1))
    for kind, name in dict.fromkeys((kind, name) for kind, name, _ in hits):
        counts = [hits[kind, name, quality] for quality in QUALITIES]
        cells = [f"{c['found']} of {c['tried']}" for c in counts] + [str(sum(c["other"] for c in counts))]
        print(f"| {kind} | {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
