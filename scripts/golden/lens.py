#!/usr/bin/env python3
"""Golden places and pixels of lenses, for the tests of `curate/src/poses/lens.rs`, from OpenCV.

usage: scripts/golden/lens.py > curate/tests/golden/lens.json

Distorted places are those of cv2.projectPoints (points at depth 1), straightened ones those of
cv2.undistortPointsIter with 200 steps; the frame is resampled by cv2.remap at places of projectPoints, in f32.
OpenCV counts pixel centres as whole numbers, the tests' cameras as halves. Needs NumPy and OpenCV.
"""
import json

import cv2
import numpy as np

WIDTH, HEIGHT = 40, 24
FX, FY, CX, CY = 33.0, 32.0, 19.0, 12.5
LENSES = [[-0.12, 0.03, 0.0, 0.0], [0.09, 0.0, 0.0, 0.0], [-0.2, 0.05, 0.002, -0.003], [0.05, -0.02, -0.004, 0.001]]


def main():
    camera = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
    random = np.random.default_rng(5)
    pixels = random.uniform([0, 0], [WIDTH, HEIGHT], (40, 2))
    columns, rows = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    # Smooth enough for OpenCV's steps of a 32nd of a pixel.
    frame = (0.5 + 0.3 * np.sin(0.3 * columns) * np.cos(0.2 * rows)).astype(np.float32)

    def distorted(places, terms):
        at_depth_one = np.column_stack([(places - [CX, CY]) / [FX, FY], np.ones(len(places))])
        return cv2.projectPoints(at_depth_one, np.zeros(3), np.zeros(3), camera, np.array(terms))[0][:, 0]

    lenses = []
    for terms in LENSES:
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
        straight = cv2.undistortPointsIter(
            pixels[:, None], camera, np.array(terms), None, camera, criteria)[:, 0]
        centres = np.column_stack([columns.ravel(), rows.ravel()])
        places = distorted(centres, terms).reshape(HEIGHT, WIDTH, 2).astype(np.float32) - 0.5
        image = cv2.remap(frame, places[..., 0], places[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        lenses.append({
            "terms": terms, "distorted": distorted(pixels, terms).tolist(), "straightened": straight.tolist(),
            "image": [round(float(value), 4) for value in image.ravel()]})
    print(json.dumps({
        "opencv": cv2.__version__, "width": WIDTH, "height": HEIGHT, "intrinsics": [FX, FY, CX, CY],
        "pixels": pixels.tolist(), "frame": [round(float(value), 4) for value in frame.ravel()],
        "lenses": lenses}))


main()
