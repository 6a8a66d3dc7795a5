#!/usr/bin/env python3
"""Golden values of the operations of Neural Atlas Graphs, in double precision from their equations.

Splines, rays on planes and on the sphere, angles of view, layers, hash grids, networks, and a whole
pixel of three nodes. Parameters are sines of their index, so that any language can make them again.
Derivatives are central differences. Needs Python's standard library alone.

    scripts/golden/neural_atlas.py > reconstruct/engine/tests/golden/neural_atlas.json
"""

import json
import math
from itertools import product

PRIMES = (1, 2654435761, 805459861, 3674653429)


def add(a, b, factor=1.0):
    return [x + factor * y for x, y in zip(a, b)]


def scale(a, factor):
    return [factor * x for x in a]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b))


def unit(a):
    return scale(a, 1 / math.sqrt(dot(a, a)))


# Splines: weights of p2 - p1 and of both tangents.
def hermite(x):
    return 3 * x**2 - 2 * x**3, x**3 - 2 * x**2 + x, x**3 - x**2


def place(time, first, last, count):
    steps = (time - first) / (last - first) * (count - 1)
    knot = min(max(math.floor(steps), 0), count - 2)
    return knot, steps - knot


def spline(time, knots, first=0.0, last=1.0):
    if len(knots) == 1:
        return list(knots[0])
    step = (last - first) / (len(knots) - 1)
    if time < first:
        return add(knots[0], add(knots[1], knots[0], -1), (time - first) / step)
    if time > last:
        return add(knots[-1], add(knots[-1], knots[-2], -1), (time - last) / step)
    knot, x = place(time, first, last, len(knots))
    mirrored = [
        add(scale(knots[0], 2), knots[1], -1),
        *knots,
        add(scale(knots[-1], 2), knots[-2], -1),
    ]
    before, here, there, behind = mirrored[knot : knot + 4]
    out = list(here)
    differences = (add(there, here, -1), scale(add(there, before, -1), 0.5), scale(add(behind, here, -1), 0.5))
    for weight, difference in zip(hermite(x), differences):
        out = add(out, difference, weight)
    return out


def offset_spline(time, knots):
    inner = len(knots) - 2
    step = 1 / (inner - 1) if inner > 1 else 1.0
    return spline(time, knots, -step, 1 + step if inner > 1 else 1.0)


# Quaternions: x, y, z, w.
def times(a, b):
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]


def inverse(q):
    return [-q[0], -q[1], -q[2], q[3]]


def exp(vector):
    angle = math.sqrt(dot(vector, vector))
    if angle == 0:
        return [0.0, 0.0, 0.0, 1.0]
    return scale(vector, math.sin(angle / 2) / angle) + [math.cos(angle / 2)]


def log(q):
    q = q if q[3] >= 0 else scale(q, -1)
    length = math.sqrt(dot(q[:3], q[:3]))
    return scale(q[:3], 2 * math.atan2(length, q[3]) / length if length > 0 else 2.0)


def between(a, b):
    return log(times(b, inverse(a)))


def rotation_spline(time, knots, first=0.0, last=1.0):
    step = (last - first) / (len(knots) - 1)
    if time < first:
        return times(exp(scale(between(knots[0], knots[1]), (time - first) / step)), knots[0])
    if time > last:
        return times(exp(scale(between(knots[-2], knots[-1]), (time - last) / step)), knots[-1])
    knot, x = place(time, first, last, len(knots))
    mirrored = [
        times(times(knots[0], inverse(knots[1])), knots[0]),
        *knots,
        times(times(knots[-1], inverse(knots[-2])), knots[-1]),
    ]
    before, here, there, behind = mirrored[knot : knot + 4]
    turn = [0.0] * 3
    steps = (between(here, there), scale(between(before, there), 0.5), scale(between(here, behind), 0.5))
    for weight, part in zip(hermite(x), steps):
        turn = add(turn, part, weight)
    return times(exp(turn), here)


def columns(q):
    """The rotation's matrix as its columns."""
    return [times(times(q, axis + [0.0]), inverse(q))[:3] for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0])]


# Rays.
def plane_hit(origin, direction, centre, axes, size):
    slope = dot(axes[2], direction)
    if abs(slope) < 1e-6:
        return None
    distance = dot(axes[2], add(centre, origin, -1)) / slope
    local = [dot(axis, add(add(origin, direction, distance), centre, -1)) for axis in axes]
    uv = [local[axis] / size[axis] + 0.5 for axis in (0, 1)]
    return None if distance <= 0 or min(uv) < 0 or max(uv) > 1 else (distance, uv)


def sphere_distance(origin, direction, centre, radius):
    away = add(origin, centre, -1)
    b, c = dot(away, direction), dot(away, away) - radius**2
    return -b + math.sqrt(b * b - c)


def view_angle(direction):
    x, y, z = direction
    across = math.hypot(x, y)
    factor = math.atan2(across, z) / across if across > 1e-7 else 0.0
    return [-y * factor, x * factor]


def compose(layers):
    colour, transmittance = [0.0] * 3, 1.0
    for own, opacity in layers:
        colour = add(colour, own, transmittance * opacity)
        transmittance *= 1 - opacity
    return colour


# Hash grids with the published upper edge.
def levels(dimensions, count, log2_entries):
    out = []
    for level in range(count):
        cells = 4 * 1.61**level - 1
        resolution = math.ceil(cells) + 1
        corners = resolution**dimensions
        entries = min(-(-corners // 8) * 8, 2**log2_entries)
        out.append((cells, resolution, entries, corners > entries))
    return out


def entry(corner, level):
    _, resolution, entries, is_hashed = level
    value = 0
    for axis, cell in enumerate(corner):
        if is_hashed:
            value ^= cell * PRIMES[axis] % 2**32
        else:
            value += cell * resolution**axis
    return value % entries


def corners(position, level):
    at = [min(max(x, 0.0), 1.0) * level[0] + 0.5 for x in position]
    cell = [math.floor(x) for x in at]
    part = [x - c for x, c in zip(at, cell)]
    out = []
    for bits in product((0, 1), repeat=len(position)):
        bits = bits[::-1]  # The first axis runs fastest.
        weight = math.prod(p if bit else 1 - p for p, bit in zip(part, bits))
        out.append((entry([c + bit for c, bit in zip(cell, bits)], level), weight))
    return out


def table_size(grid):
    return 4 * sum(level[2] for level in grid)


def encode(position, table, grid):
    out, first = [], 0
    for level in grid:
        found = corners(position, level)
        out += [sum(weight * table[first + 4 * at + feature] for at, weight in found) for feature in range(4)]
        first += 4 * level[2]
    return out


def network(values, weights, sizes):
    first = 0
    for layer, (inputs, outputs) in enumerate(zip(sizes, sizes[1:])):
        values = [sum(values[i] * weights[first + i * outputs + o] for i in range(inputs)) for o in range(outputs)]
        if layer + 2 < len(sizes):
            values = [max(value, 0.0) for value in values]
        first += inputs * outputs
    return values


def wave(count, phase, size=0.1):
    return [size * math.sin(1.3 * i + phase) for i in range(count)]


def field(dimensions, outputs, phase):
    """Four levels of at most 2^8 entries, and a network 16-8-8-outputs."""
    grid, sizes = levels(dimensions, 4, 8), (16, 8, 8, outputs)
    table = wave(table_size(grid), phase)
    weights = wave(sum(a * b for a, b in zip(sizes, sizes[1:])), phase + 0.5, 0.7)
    return lambda position: network(encode(position, table, grid), weights, sizes)


def texture(width, height, channels, phase, size):
    return width, height, channels, [0.5 + v for v in wave(width * height * channels, phase, size)]


def bilinear(image, uv, is_border):
    width, height, channels, values = image
    at = [uv[0] * (width - 1), uv[1] * (height - 1)]
    cell = [math.floor(x) for x in at]
    out = [0.0] * channels
    for dx, dy in product((0, 1), repeat=2):
        x, y = cell[0] + dx, cell[1] + dy
        if not is_border and not (0 <= x < width and 0 <= y < height):
            continue
        x, y = min(max(x, 0), width - 1), min(max(y, 0), height - 1)
        weight = (at[0] - cell[0] if dx else 1 - at[0] + cell[0]) * (at[1] - cell[1] if dy else 1 - at[1] + cell[1])
        first = (y * width + x) * channels
        out = add(out, values[first : first + channels], weight)
    return out


class Node:
    def __init__(self, phase, is_background):
        self.is_background = is_background
        self.colour, self.flow = field(2, 3, phase), field(2, 10, phase + 1)
        self.opacity = field(2, 1, phase + 2)
        self.view = field(4, 3 if is_background else 4, phase + 3)
        self.base_colour = texture(6, 5, 3, phase + 4, 0.3)
        self.base_opacity = texture(6, 5, 1, phase + 5, 0.4)

    def at(self, uv, time, direction):
        knots = self.flow(uv)
        flow = offset_spline(time, [knots[i : i + 2] for i in range(0, 10, 2)])
        q = add(uv, flow, 0.1)
        angle = [(a + math.pi) / (2 * math.pi) for a in view_angle(direction)]
        view = self.view(q + angle)
        colour = add(bilinear(self.base_colour, q, self.is_background), self.colour(q), 0.1)
        colour = [min(max(c, 0.0), 1.0) for c in add(colour, view[:3], 0.1)]
        if self.is_background:
            return colour, 1.0, q
        base = min(max(bilinear(self.base_opacity, q, True)[0], 1e-4), 1 - 1e-4)
        logit = math.log(base / (1 - base)) + 0.1 * self.opacity(q)[0] + 0.1 * view[3]
        return colour, 1 / (1 + math.exp(-logit)), q


ORIGIN, DIRECTION, TIME = [0.02, -0.01, 0.0], unit([0.05, -0.03, 1.0]), 0.37
POSES = [
    [[0.1, -0.1, 2.0], [0.1, -0.2, 0.05], [1.2, 1.0]],
    [[-0.1, 0.05, 2.4], [-0.1, 0.15, 0.0], [1.5, 1.4]],
    [[0.0, 0.0, 5.0], [0.0, 0.0, 0.0], [9.0, 7.0]],
]
UPSTREAM = [0.3, -0.5, 0.8]


def pixel(nodes, poses):
    hits = []
    for number, (node, (centre, turn, size)) in enumerate(zip(nodes, poses)):
        axes = columns(exp(turn))
        hit = plane_hit(ORIGIN, DIRECTION, centre, axes, size)
        if hit:
            hits.append((hit[0], number, node.at(hit[1], TIME, [dot(axis, DIRECTION) for axis in axes])))
    hits.sort(key=lambda hit: hit[:2])
    return compose([(colour, opacity) for _, _, (colour, opacity, _) in hits]), hits


def pose_derivatives(nodes):
    out = {}
    for node in (0, 1):
        for kind, name in enumerate(("centre", "turn")):
            row = []
            for axis in range(3):
                values = []
                for step in (1e-6, -1e-6):
                    poses = [[list(part) for part in pose] for pose in POSES]
                    poses[node][kind][axis] += step
                    values.append(dot(UPSTREAM, pixel(nodes, poses)[0]))
                row.append((values[0] - values[1]) / 2e-6)
            out[f"{name}_{node}"] = row
    return out


def main():
    knots = [[0.0, 0, 0], [1.0, 2, 0], [3.0, 1, 1], [4.0, 4, 2]]
    offsets = [[0.2, 0, 0], [0.1, 0.3, 0], [-0.2, 0.1, 0.4], [0.0, 0, 0.1], [0.3, -0.1, 0]]
    turns = [exp(v) for v in ([0.0, 0, 0], [0.3, 0, 0], [0.3, 0.5, 0], [0.0, 0.5, 0.7])]
    axes = columns(exp([0.2, -0.3, 0.1]))
    hit = plane_hit([0.0] * 3, [0.1, -0.05, 1.0], [0.1, -0.2, 2.0], axes, [1.5, 1.0])
    length = math.sqrt(0.1**2 + 0.05**2 + 1)
    large = levels(2, 16, 17)
    encodings = []
    for position in ([0.31, 0.77], [0.2, 0.55, 0.9], [0.12, 0.21, 0.33, 0.48]):
        grid = levels(len(position), 4, 8)
        table, upstream = wave(table_size(grid), 0.2), wave(16, 0.9, 1.0)
        gradient = []
        for axis in range(len(position)):
            moved = [[x + (step if at == axis else 0) for at, x in enumerate(position)] for step in (1e-7, -1e-7)]
            plus, minus = (dot(upstream, encode(at, table, grid)) for at in moved)
            gradient.append((plus - minus) / 2e-7)
        encodings.append({"position": position, "features": encode(position, table, grid), "gradient": gradient})
    nodes = [Node(0.1, False), Node(0.6, False), Node(1.7, True)]
    colour, hits = pixel(nodes, POSES)
    sizes = (16, 8, 8, 3)
    golden = {
        "spline": [{"time": t, "position": spline(t, knots)} for t in (0.0, 0.1, 1 / 3, 0.5, 0.9, 1.0, -0.1, 1.1)],
        "offset_spline": [{"time": t, "position": offset_spline(t, offsets)} for t in (0.0, 0.25, 0.5, 1.0)],
        "rotation_spline": [{"time": t, "rotation": rotation_spline(t, turns)} for t in (0.0, 0.2, 0.5, 0.8, 1.0, 1.2)],
        "plane_hit": {"distance": hit[0] * length, "uv": hit[1]},
        "sphere_distance": sphere_distance([0.1, 0.0, 0.2], [0.0, 0, 1], [0.0] * 3, 3.0),
        "view_angle": view_angle(unit([0.3, -0.2, 0.8])),
        "composed": compose([([1.0, 0, 0], 0.25), ([0.0, 1, 0], 0.5), ([0.0, 0, 1], 1.0)]),
        "grids": [
            {
                "dimensions": d,
                "levels": count,
                "log2_entries": log2,
                "parameters": table_size(levels(d, count, log2)),
                "resolutions": [level[1] for level in levels(d, count, log2)],
                "first_hashed": next(at for at, level in enumerate(levels(d, count, log2)) if level[3]),
            }
            for d in (2, 3, 4)
            for count, log2 in ((16, 17), (12, 15), (8, 13))
        ],
        "corners": [{"level": at, "corners": corners([0.3, 0.7], large[at])} for at in (0, 4, 12, 15)],
        "encodings": encodings,
        "network": network(wave(16, 0.3, 1.0), wave(sum(a * b for a, b in zip(sizes, sizes[1:])), 0.9, 0.7), sizes),
        "pixel": {
            "colour": colour,
            "layers": [
                {"node": number, "distance": distance, "colour": at[0], "opacity": at[1], "query": at[2]}
                for distance, number, at in hits
            ],
            **pose_derivatives(nodes),
        },
    }
    print(json.dumps(golden, indent=1))


if __name__ == "__main__":
    main()
