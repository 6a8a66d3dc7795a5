#!/usr/bin/env python3
"""Counts what the diagnosis of predicted views finds, and what it alarms about falsely.

    diagnosis.py SCENES [--only NAME]... [--verbose]

SCENES has one folder of at least 20 frames (PNG or JPEG, in the order of their names, of one size) per
scene; images twice as wide as high are panoramas. Views as honest methods leave them must have no
finding; each mistake of convention, made in views of a good, a poor and a very poor simulated method, must
have its own and no other. Prints one table of each, and every false alarm.

The criteria are those of `bench/src/diagnosis/`, with its constants, in NumPy: whoever changes a threshold
changes it in both places. Needs NumPy and Pillow; takes about half a minute per scene.
"""

import argparse
import collections
import pathlib
import zlib

import numpy as np
from PIL import Image, ImageFilter

VIEWS, SMALL, MEDIUM = 6, 128, 256

# -- images --------------------------------------------------------------------------------------


def psnr(mse):
    return -10 * np.log10(max(mse / 255.0**2, 1e-10))


def reduced(image, columns):
    """Means of square blocks that leave about `columns` columns."""
    block = min(max(1, image.shape[1] // columns), image.shape[0])
    height, width = image.shape[0] // block, image.shape[1] // block
    cut = image[: height * block, : width * block].astype(np.float64)
    return cut.reshape(height, block, width, block, 3).mean((1, 3))


def correlation(a, b):
    a, b = a - a.mean(), b - b.mean()
    norm = np.sqrt((a**2).sum() * (b**2).sum())
    return float((a * b).sum() / norm) if norm > 1e-6 else 0.0


class View:
    """A prediction beside its ground truth."""

    def __init__(self, predicted, truth):
        self.predicted, self.truth = predicted, truth
        self.small = [reduced(image, SMALL) for image in (predicted, truth)]
        self.psnr = psnr(np.mean((self.small[0] - self.small[1]) ** 2))


def gain(view, image):
    """Gain in dB of a changed small image."""
    return psnr(np.mean((image - view.small[1]) ** 2)) - view.psnr


# -- geometry.rs ---------------------------------------------------------------------------------


def flipped(image, mirrored, upside_down):
    image = image[:, ::-1] if mirrored else image
    return image[::-1] if upside_down else image


def gains_by_columns(view, flips, wraps):
    """Gains in dB by shifts of the columns to the right, all at once by their spectra."""
    predicted, truth = flipped(view.small[0], *flips), view.small[1]
    if not wraps:
        return np.array([gain(view, predicted)])
    spectrum = np.fft.rfft(truth, axis=1) * np.conj(np.fft.rfft(predicted, axis=1))
    products = np.fft.irfft(spectrum, n=truth.shape[1], axis=1).sum((0, 2))
    errors = ((truth**2).sum() + (predicted**2).sum() - 2 * products) / truth.size
    return np.array([psnr(error) for error in errors]) - view.psnr


def turn(views, wraps):
    best = None
    for flips in ((False, False), (False, True), (True, False), (True, True)):
        gains = np.array([gains_by_columns(view, flips, wraps) for view in views])
        columns = int(np.argmax(gains.mean(0)))
        if best is None or gains[:, columns].mean() > best[2][:, best[1]].mean():
            best = flips, columns, gains
    flips, columns, gains = best
    own, width = np.argmax(gains, 1), gains.shape[1]
    agreeing = np.mean(np.minimum((own - columns) % width, (columns - own) % width) <= 1)
    before = np.mean([correlation(v.small[0].sum(2), v.small[1].sum(2)) for v in views])
    after = np.mean(
        [correlation(np.roll(flipped(v.small[0], *flips), columns, 1).sum(2), v.small[1].sum(2)) for v in views]
    )
    tells = (
        (any(flips) or columns != 0)
        and gains[:, columns].mean() >= 1.0
        and gains[:, columns].min() > 0
        and agreeing >= 0.8
        and after >= 0.4
        and (after - before >= 0.15 or 1 - after <= 0.5 * (1 - before))
    )
    degrees = 360 * (columns if columns <= width / 2 else columns - width) / width
    return (flips, degrees, gains[:, columns].mean()) if tells else None


# -- shifts.rs -----------------------------------------------------------------------------------

REACH = 6


def smoothed(image):
    """Grey values under a binomial filter of 5 x 5."""
    image = image.astype(np.float64).mean(2)
    for axis, mode in ((1, "wrap"), (0, "edge")):
        pads = [(2, 2) if a == axis else (0, 0) for a in (0, 1)]
        padded, length = np.pad(image, pads, mode=mode), image.shape[axis]
        taps = [np.take(padded, range(k, k + length), axis=axis) for k in range(5)]
        image = (taps[0] + 4 * taps[1] + 6 * taps[2] + 4 * taps[3] + taps[4]) / 16
    return image


def vertex(errors):
    at = int(np.argmin(errors))
    if at in (0, len(errors) - 1):
        return np.nan
    left, here, right = errors[at - 1 : at + 2]
    curvature = left - 2 * here + right
    return at - len(errors) // 2 + 0.5 * (left - right) / curvature if curvature > 0 else np.nan


def shifts_by_part(view, wraps):
    predicted, truth = smoothed(view.predicted), smoothed(view.truth)
    predicted = (predicted - predicted.mean()) * truth.std() / max(predicted.std(), 1e-6) + truth.mean()
    height, width = truth.shape
    rows, columns = ((height // 8, height - height // 8), (0, width)) if wraps else (
        (REACH, height - REACH), (REACH, width - REACH))
    found = []
    steps = range(-REACH, REACH + 1)
    for row in range(2):
        for column in range(4):
            r0, r1 = (rows[0] + (row + k) * (rows[1] - rows[0]) // 2 for k in (0, 1))
            c0, c1 = (columns[0] + (column + k) * (columns[1] - columns[0]) // 4 for k in (0, 1))
            part = truth[r0:r1, c0:c1]

            def error(right, down):
                other = predicted[np.clip(np.arange(r0, r1) + down, 0, height - 1)]
                other = np.take(other, np.arange(c0, c1) + right, axis=1, mode="wrap")
                return np.mean((other - part) ** 2)

            right = int(np.argmin([error(k, 0) for k in steps])) - REACH
            by_row = [error(right, k) for k in steps]
            down = int(np.argmin(by_row)) - REACH
            found.append((vertex([error(k, down) for k in steps]), vertex(by_row)))
    found = np.array(found)
    found[np.isnan(found).any(1)] = np.nan
    return found


def median(values):
    return np.sort(values, axis=0)[len(values) // 2]


def shift(views, wraps):
    found = np.array([shifts_by_part(view, wraps) for view in views])
    known = ~np.isnan(found[..., 0])
    if known.mean() < 0.75:
        return None
    middle = median(found[known])
    near = lambda some, is_known, pixels: is_known.any() and np.abs(median(some[is_known]) - middle).max() <= pixels
    views_near = np.mean([near(found[v], known[v], 0.3) for v in range(len(views))])
    parts_near = np.mean([near(found[:, p], known[:, p], 0.35) for p in range(found.shape[1])])
    if np.abs(middle).max() < 0.35 or views_near < 0.8 or parts_near < 0.75:
        return None
    halves = tuple(int(k) for k in np.round(2 * middle))
    return halves if min(gain_without_shift(view, halves) for view in views) >= 0.2 else None


def gain_without_shift(view, halves):
    """Gain in dB of a prediction that is moved back; between pixels their mean is taken."""
    predicted, truth = view.predicted.astype(np.float64), view.truth.astype(np.float64)
    rows = np.arange(len(truth))
    images = []
    for right in (halves[0] // 2, -(-halves[0] // 2)):
        for down in (halves[1] // 2, -(-halves[1] // 2)):
            images.append(np.roll(predicted, -right, 1)[np.clip(rows + down, 0, len(truth) - 1)])
    return psnr(np.mean((np.mean(images, 0) - truth) ** 2)) - psnr(np.mean((predicted - truth) ** 2))


# -- colour.rs, encoding.rs ----------------------------------------------------------------------

ORDERS = {"BGR": (2, 1, 0), "RBG": (0, 2, 1), "GRB": (1, 0, 2), "GBR": (2, 0, 1), "BRG": (1, 2, 0)}


def colours(image):
    image = image - image.mean(2, keepdims=True)
    return image - image.mean((0, 1))


def channels(views):
    gains = {name: [gain(v, v.small[0][..., order]) for v in views] for name, order in ORDERS.items()}
    name = max(gains, key=lambda name: np.mean(gains[name]))
    after = np.mean([correlation(colours(v.small[0][..., ORDERS[name]]), colours(v.small[1])) for v in views])
    before = np.mean([correlation(colours(v.small[0]), colours(v.small[1])) for v in views])
    tells = (
        np.mean(gains[name]) >= 1
        and min(gains[name]) > 0
        and after >= 0.5
        and (after - before >= 0.3 or 1 - after <= 0.5 * (1 - before))
    )
    return name if tells else None


def srgb(v):
    return np.where(v <= 0.0031308, 12.92 * v, 1.055 * np.clip(v, 0, 1) ** (1 / 2.4) - 0.055)


def linear(v):
    return np.where(v <= 0.04045, v / 12.92, ((np.clip(v, 0, 1) + 0.055) / 1.055) ** 2.4)


MEAN, DEVIATION = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
# What is made of right values in [0, 1], and what undoes it.
ENCODINGS = {
    "linear": (linear, srgb),
    "sRGB twice": (srgb, linear),
    "gamma 2.2": (lambda v: v**2.2, lambda v: v ** (1 / 2.2)),
    "gamma 1/2.2": (lambda v: v ** (1 / 2.2), lambda v: v**2.2),
    "16..235": (lambda v: (219 * v + 16) / 255, lambda v: (255 * v - 16) / 219),
    "expanded twice": (lambda v: (255 * v - 16) / 219, lambda v: (219 * v + 16) / 255),
    "halved": (lambda v: v / 2, lambda v: 2 * v),
    "doubled": (lambda v: 2 * v, lambda v: v / 2),
    "x/2+1/2": (lambda v: v / 2 + 0.5, lambda v: 2 * v - 1),
    "[-1, 1]": (lambda v: 2 * v - 1, lambda v: v / 2 + 0.5),
    "inverted": (lambda v: 1 - v, lambda v: 1 - v),
    "ImageNet": (lambda v: (v - MEAN) / DEVIATION, lambda v: v * DEVIATION + MEAN),
}
RANGES = {"16..235": (219 / 255, 16 / 255), "expanded twice": (255 / 219, -16 / 219)}


def is_range(found, slope, offset):
    predicted, truth = (np.concatenate([pair[k].ravel() for pair in found]) for k in (0, 1))
    uncut = (predicted >= 0.02) & (predicted < 0.98)
    p, t = predicted[uncut], truth[uncut]
    found_slope = ((p - p.mean()) * (t - t.mean())).sum() / max(((t - t.mean()) ** 2).sum(), 1e-9)
    found_offset = p.mean() - found_slope * t.mean()
    reach = np.quantile(truth, 0.95) - np.quantile(truth, 0.05)
    return reach >= 80 / 255 and abs(found_slope - slope) <= 0.04 and abs(found_offset - offset) <= 5 / 255


def encoding(views):
    quantiles = lambda image: np.quantile(image.reshape(-1, 3) / 255, np.linspace(0.01, 0.99, 50), axis=0, method="nearest")
    found = [tuple(quantiles(image) for image in view.small) for view in views]
    before = np.mean([np.abs(p - t).mean() for p, t in found])
    left = {}
    for name, (forward, _) in ENCODINGS.items():
        encoded = [np.clip(forward(t), 0, 1)[:: -1 if name == "inverted" else 1] for _, t in found]
        left[name] = np.mean([np.abs(p - e).mean() for (p, _), e in zip(found, encoded)]) / max(before, 1e-9)
    name = min(left, key=left.get)
    forward, undone = ENCODINGS[name]
    most = 0.6 if name == "inverted" else 0.35 if name in RANGES else 0.3
    if left[name] > most or name in RANGES and not is_range(found, *RANGES[name]):
        return None
    gains = [gain(v, 255 * np.clip(undone(v.small[0] / 255), 0, 1)) for v in views]
    alike = np.mean([correlation(v.small[0], np.clip(forward(v.small[1] / 255), 0, 1)) for v in views])
    helps = np.mean(gains) >= 2 and min(gains) >= 0.5
    return name if alike >= 0.5 and (helps or left[name] <= 0.1 and before >= 0.04) else None


# -- order.rs ------------------------------------------------------------------------------------


def shown_instead(order, frame, novel):
    place = novel.index(frame)
    if order == "reversed":
        return novel[len(novel) - 1 - place]
    kind, step = order
    other = place + step if kind == "place" else frame + step
    if kind == "frame":
        return other
    return novel[other] if 0 <= other < len(novel) else None


NUMBERED = [("place", -1), ("place", 1), "reversed", ("frame", -1), ("frame", 1)]


class Comparison:
    def __init__(self, scene, frames, predicted, novel, given):
        self.frames, self.novel, self.given = frames, novel, given
        read = set(frames) | set(spread(novel, 12))
        for frame in frames:
            read |= {shown_instead(order, frame, novel) for order in NUMBERED}
        for frame in list(spread(novel, 12)) + frames:
            read |= {max((g for g in given if g < frame), default=None), min((g for g in given if g > frame), default=None)}
        read |= set(spread(novel, max(0, 48 - len(read))))
        read = [f for f in read if f is not None and 0 <= f < len(scene.frames)]
        images = [reduced(image, MEDIUM) for image in predicted]
        self.psnr = [{f: psnr(np.mean((image - scene.medium(f)) ** 2)) for f in read} for image in images]

    def copies(self):
        of_given = lambda by: max((by[g] for g in self.given if g in by), default=0)
        return sum(of_given(by) >= max(42, by[f] + 3) for f, by in zip(self.frames, self.psnr))

    def gains(self, order):
        shown = [shown_instead(order, f, self.novel) for f in self.frames]
        return np.array([by[s] - by[f] for f, s, by in zip(self.frames, shown, self.psnr) if s in by and s != f])

    def order(self):
        for order in NUMBERED:
            gains = self.gains(order)
            least = 3 if order[0] == "frame" else 1
            if order[0] == "frame" and (self.gains(("frame", -order[1])) >= 0).any():
                continue
            if len(gains) >= 2 and 2 * len(gains) >= len(self.frames) and (gains >= least).mean() >= 0.75 and gains.min() >= -0.5:
                return order, gains.mean()
        best = [max(by, key=by.get) for by in self.psnr]
        gains = [by[b] - by[f] for f, b, by in zip(self.frames, best, self.psnr)]
        other = np.mean([b != f and g >= 1 and b in self.novel for f, b, g in zip(self.frames, best, gains)])
        if len(best) >= 3 and other >= 0.5 and len(set(best)) >= 0.75 * len(best):
            return "permuted", np.mean(gains)
        return None


# -- the whole -----------------------------------------------------------------------------------


def findings(scene, frames, predicted, novel, given):
    views = [View(p, scene.frames[f]) for p, f in zip(predicted, frames)]
    comparison = Comparison(scene, frames, predicted, novel, given)
    found = []
    encoded = encoding(views)
    if 2 * comparison.copies() <= len(views) and encoded != "inverted":
        turned, order = turn(views, scene.wraps), comparison.order()
        small = turned is None or not any(turned[0]) and abs(turned[1]) < 10
        if order and (turned is None or order[1] >= turned[2]):
            found.append(("order", order[0]))
        elif small and (shifted := shift(views, scene.wraps)):
            found.append(("shift", shifted))
        elif turned:
            found.append(("turn", turned[0], round(turned[1])))
    if name := channels(views):
        found.append(("channels", name))
    if encoded:
        found.append(("encoding", encoded))
    return found


def spread(frames, count):
    count = min(count, len(frames))
    return [frames[(2 * k + 1) * len(frames) // (2 * count)] for k in range(count)]


class Scene:
    def __init__(self, folder):
        files = sorted(f for f in folder.iterdir() if f.suffix.lower() in (".png", ".jpg", ".jpeg"))
        self.name = folder.name
        self.frames = [np.asarray(Image.open(f).convert("RGB")) for f in files[:40]]
        self.wraps = self.frames[0].shape[1] == 2 * self.frames[0].shape[0]
        self.mediums = {}

    def medium(self, frame):
        if frame not in self.mediums:
            self.mediums[frame] = reduced(self.frames[frame], MEDIUM)
        return self.mediums[frame]

    def splits(self):
        count = len(self.frames)
        yield "per-scene", [f for f in range(count) if f % 5 == 4], [f for f in range(count) if f % 5 != 4]
        yield "sparse", [f for f in range(count) if f % 10 not in (0, 9)], [f for f in range(count) if f % 10 in (0, 9)]


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
    print(f"\nhonest: {honest['false alarms']} of {honest['sets of views']} sets of views have a finding\n")
    print("| kind | mistake | " + " | ".join(QUALITIES) + " | another finding |")
    print("|---|---|" + "---|" * (len(QUALITIES) + 1))
    for kind, name in dict.fromkeys((kind, name) for kind, name, _ in hits):
        counts = [hits[kind, name, quality] for quality in QUALITIES]
        cells = [f"{c['found']} of {c['tried']}" for c in counts] + [str(sum(c["other"] for c in counts))]
        print(f"| {kind} | {name} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
