"""The criteria of `bench/src/diagnosis/`, with its constants, in NumPy.

Whoever changes a threshold changes it in both places. Needs NumPy and Pillow.
"""

import numpy as np
from PIL import Image

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
        read = set(frames) | set(spread(novel, 8))
        for frame in frames:
            read |= {shown_instead(order, frame, novel) for order in NUMBERED}
        for frame in list(spread(novel, 8)) + frames:
            read |= {max((g for g in given if g < frame), default=None), min((g for g in given if g > frame), default=None)}
        read |= set(spread(novel, max(0, 32 - len(read))))
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
