#!/usr/bin/env python3
"""Golden bytes of a `.splat`, for the test `the_bytes_are_those_of_the_layout` of `formats/splat.rs`.

usage: scripts/golden/splat.py

Written from the layout that web viewers read (antimatter15/splat, convert.py): rows by descending volume times
opacity; f32 position, f32 standard deviations, u8 colour and opacity, u8 quaternion (w, x, y, z) as
128 q + 128. Bytes are rounded to nearest (convert.py cuts off). The Gaussians are those of a table of 3DGS:
logarithms of sizes, logits of opacities, coefficients of the constant harmonic, quaternions of any length.
"""
import math
import struct

C0 = 0.28209479177387814
GAUSSIANS = [
    # position, log sizes, coefficients, logit, quaternion
    ((1.5, -2.25, 3.0), (-3.0, -3.5, -5.0), (0.5, -0.25, 1.0), 2.0, (2.0, 0.0, 0.0, 0.0)),
    ((-10.0, 0.125, 7.5), (-1.0, -1.0, -2.0), (-2.5, 2.5, 0.0), -1.0, (0.5, -0.5, 0.5, -0.5)),
    ((0.0, 0.0, 0.0), (-1.0, -1.0, -2.0), (0.1, 0.2, 0.3), 4.0, (0.1, 0.9, -0.3, 0.2)),
]


def byte(value):
    return min(255, max(0, math.floor(value + 0.5)))


def row(position, log_sizes, coefficients, logit, quaternion):
    sizes = [math.exp(size) for size in log_sizes]
    opacity = 1 / (1 + math.exp(-logit))
    length = math.sqrt(sum(q * q for q in quaternion))
    colour = [byte(255 * min(1, max(0, 0.5 + C0 * c))) for c in coefficients]
    turn = [byte(128 * q / length + 128) for q in quaternion]
    weight = sizes[0] * sizes[1] * sizes[2] * opacity
    return -weight, struct.pack("<6f8B", *position, *sizes, *colour, byte(255 * opacity), *turn)


for _, data in sorted(row(*gaussian) for gaussian in GAUSSIANS):
    print(data.hex())
