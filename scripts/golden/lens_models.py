#!/usr/bin/env python3
"""Golden pixels of all camera models with an image plane, for the tests of `curate/src/poses/lens`, from COLMAP.

usage: scripts/golden/lens_models.py > curate/tests/golden/lens_models.json

Pixels are those of pycolmap's Camera.img_from_cam for places at depth 1. Needs NumPy and pycolmap 4.2.
"""
import json

import numpy as np
import pycolmap

WIDTH, HEIGHT = 320, 180
F, FX, FY, CX, CY = 150.0, 152.0, 147.0, 158.5, 91.0
ONE, TWO = [F, CX, CY], [FX, FY, CX, CY]
MODELS = {
    "SIMPLE_PINHOLE": ONE,
    "PINHOLE": TWO,
    "SIMPLE_RADIAL": ONE + [-0.08],
    "RADIAL": ONE + [-0.1, 0.02],
    "OPENCV": TWO + [-0.1, 0.02, 0.001, -0.002],
    "OPENCV_FISHEYE": TWO + [-0.03, 0.01, -0.004, 0.0005],
    "FULL_OPENCV": TWO + [0.2, -0.03, 0.001, -0.002, 0.004, 0.3, 0.01, 0.002],
    "FOV": TWO + [0.9],
    "SIMPLE_RADIAL_FISHEYE": ONE + [-0.04],
    "RADIAL_FISHEYE": ONE + [-0.04, 0.006],
    "THIN_PRISM_FISHEYE": TWO + [-0.03, 0.01, 0.001, -0.0015, -0.004, 0.0005, 0.002, -0.001],
    "RAD_TAN_THIN_PRISM_FISHEYE": TWO + [-0.03, 0.01, -0.004, 0.001, 0.0002, -0.00003, 0.001, -0.0015,
                                         0.002, -0.0004, -0.001, 0.0003],
    "SIMPLE_DIVISION": ONE + [-0.12],
    "DIVISION": TWO + [-0.15],
    "SIMPLE_FISHEYE": ONE,
    "FISHEYE": TWO,
    "EUCM": TWO + [0.55, 1.1],
}


def main():
    random = np.random.default_rng(8)
    places = random.uniform([-0.9, -0.6], [0.9, 0.6], (12, 2))
    models = []
    for name, parameters in MODELS.items():
        camera = pycolmap.Camera(model=name, width=WIDTH, height=HEIGHT, params=parameters)
        pixels = camera.img_from_cam(np.column_stack([places, np.ones(len(places))]))
        models.append({
            "model": name, "number": int(getattr(pycolmap.CameraModelId, name)), "size": [WIDTH, HEIGHT],
            "parameters": parameters, "places": places.tolist(), "pixels": pixels.tolist()})
    print(json.dumps(models, indent=1))


main()
