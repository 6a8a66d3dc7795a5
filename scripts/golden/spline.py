#!/usr/bin/env python3
"""Golden paths, for the tests of `curate/tracks/src/spline_fit`, from SciPy.

usage: scripts/golden/spline.py > curate/tracks/tests/golden/spline.json

A drone looks down on a car that stops and turns; the middles of its boxes and its distances are noisy, and a few
are far off. Per number of coefficients: those of scipy.interpolate.make_lsq_spline through the lifted places, and
the least sum of Huber losses that scipy.optimize.least_squares finds from there. Needs NumPy and SciPy.
"""
import json

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

FOCAL, CX, CY = 500.0, 320.0, 180.0
SIGMA_PIXELS, SIGMA_DISTANCE, HUBER = 2.0, 0.005, 1.5
DEGREE = 3


def truth(time):
    along = 6 * min(time, 6) + 6 * max(time - 10, 0)
    return np.array([along - 30, 0.25 * max(time - 12, 0) ** 2, 0.75])


def main():
    random = np.random.default_rng(7)
    times = np.cumsum(random.uniform(0.3, 0.7, 36))
    down = np.diag([1.0, -1.0, -1.0])
    to_world = [down @ Rotation.from_euler("x", 0.2 + 0.02 * t).as_matrix() for t in times]
    centres = np.array([[0.5 * t, -12 + t, 50] for t in times])

    def ray(number, pixel):
        own = np.array([(pixel[0] - CX) / FOCAL, (pixel[1] - CY) / FOCAL, 1.0])
        return to_world[number] @ (own / np.linalg.norm(own))

    pixels, distances = [], []
    for number, time in enumerate(times):
        own = to_world[number].T @ (truth(time) - centres[number])
        pixel = FOCAL * own[:2] / own[2] + [CX, CY] + random.normal(0, 1.5, 2)
        if number % 9 == 4:
            pixel = pixel + random.normal(0, 30, 2)
        pixels.append(pixel)
        distances.append(np.linalg.norm(own) * (1 + random.normal(0, SIGMA_DISTANCE)))
    rays = [ray(n, pixel) for n, pixel in enumerate(pixels)]
    steps = [[ray(n, pixel + 0.5 * e) - ray(n, pixel - 0.5 * e) for e in np.eye(2)] for n, pixel in enumerate(pixels)]
    lifted = np.array([centres[n] + rays[n] * distances[n] for n in range(len(times))])

    def residuals(position, n):
        offset = position - centres[n]
        distance = np.linalg.norm(offset)
        values = []
        for step in steps[n]:
            length = np.linalg.norm(step)
            axis = step / length
            axis = axis - rays[n] * rays[n].dot(axis)
            axis /= np.linalg.norm(axis)
            values.append(axis.dot(offset) / distance / (length * SIGMA_PIXELS))
        return [*values, (distance / distances[n] - 1) / SIGMA_DISTANCE]

    fits = []
    for size in [4, 7, 12, 18, 24]:
        inner = np.linspace(times[0], times[-1], size - DEGREE + 1)
        knots = np.concatenate([[times[0]] * DEGREE, inner, [times[-1]] * DEGREE])
        spline = make_lsq_spline(times, lifted, knots, k=DEGREE)

        def of(values, knots=knots, size=size):
            places = BSpline(knots, values.reshape(size, 3), DEGREE)(times)
            return np.concatenate([residuals(place, n) for n, place in enumerate(places)])

        best = least_squares(of, spline.c.ravel(), loss="huber", f_scale=HUBER, xtol=1e-14, ftol=1e-14, gtol=1e-12,
                             max_nfev=2000)
        # Its cost is half of the sum.
        fits.append({"knots": knots.tolist(), "coefficients": spline.c.tolist(), "huber": 2 * float(best.cost)})
    print(json.dumps({
        "intrinsics": [FOCAL, FOCAL, CX, CY], "times": times.tolist(), "centres": centres.tolist(),
        "to_world": [m.tolist() for m in to_world], "pixels": np.array(pixels).tolist(), "distances": distances,
        "fits": fits}))


main()
