#!/usr/bin/env python3
"""Golden values of the photometric loss, for the tests of `reconstruct/engine/src/losses/photometric`, from NumPy.

usage: scripts/golden/ssim.py > reconstruct/engine/tests/golden/ssim.json

The definition of 3DGS, window by window: 11x11 Gaussian of sigma 1.5, as one table of 121 weights. A pinhole's image
is padded with zeros on all sides; a panorama's follows itself at the left and right. The gradient is that of central
differences of the loss. Needs NumPy.
"""
import json

import numpy as np

WIDTH, HEIGHT, LAMBDA, RADIUS, STEP = 14, 6, 0.4, 5, 1e-6
C1, C2 = 0.01**2, 0.03**2


def image(phase):
    """An image (HWC) of the levels 0.5 + 0.4 sin(1.3 i + phase)."""
    return (0.5 + 0.4 * np.sin(1.3 * np.arange(3 * WIDTH * HEIGHT) + phase)).reshape(HEIGHT, WIDTH, 3)


def padded(values, wraps):
    """The image with five more pixels on each side."""
    sides = (0, 0), (RADIUS, RADIUS), (0, 0)
    values = np.pad(values, sides, mode="wrap" if wraps else "constant")
    return np.pad(values, ((RADIUS, RADIUS), (0, 0), (0, 0)))


def loss(render, target, wraps):
    """L1, SSIM and the loss."""
    offsets = np.arange(-RADIUS, RADIUS + 1)
    window = np.exp(-(offsets[:, None] ** 2 + offsets[None, :] ** 2) / (2 * 1.5**2))
    window = (window / window.sum())[:, :, None]
    left, right = padded(render, wraps), padded(target, wraps)
    similarities = []
    for row in range(HEIGHT):
        for column in range(WIDTH):
            part = slice(row, row + 2 * RADIUS + 1), slice(column, column + 2 * RADIUS + 1)
            x, y = left[part], right[part]
            mean = lambda values: (window * values).sum((0, 1))
            mx, my = mean(x), mean(y)
            sx, sy, sxy = mean(x * x) - mx * mx, mean(y * y) - my * my, mean(x * y) - mx * my
            similarities.append((2 * mx * my + C1) * (2 * sxy + C2) / ((mx * mx + my * my + C1) * (sx + sy + C2)))
    l1, ssim = np.abs(render - target).mean(), np.mean(similarities)
    return l1, ssim, (1 - LAMBDA) * l1 + LAMBDA * (1 - ssim)


def case(wraps):
    """Values and gradient by the render for one kind of columns."""
    render, target = image(0.2), image(1.1)
    gradient = []
    for at in range(render.size):
        ends = []
        for step in (STEP, -STEP):
            moved = render.copy()
            moved.flat[at] += step
            ends.append(loss(moved, target, wraps)[2])
        gradient.append(round((ends[0] - ends[1]) / (2 * STEP), 9))
    l1, ssim, total = loss(render, target, wraps)
    return {"wraps": wraps, "l1": l1, "ssim": ssim, "total": total, "gradient": gradient}


print(json.dumps({"width": WIDTH, "height": HEIGHT, "lambda": LAMBDA, "cases": [case(True), case(False)]}))
