"""Gaussians of the table of formats: a scene, its PLY, and differences between two readings of it."""

import math
import struct

COUNT = 300
# Weight of the constant harmonic in a colour.
C0 = 0.28209479177387814
# Quantities of a Gaussian, with the units of their differences.
QUANTITIES = ("position", "log size", "rotation, degrees", "colour of 255", "opacity", "harmonics")


def harmonics_of(degree):
    """Returns the number of values of harmonics above the constant one."""
    return 3 * ((degree + 1) ** 2 - 1)


def properties(degree):
    rests = [f"f_rest_{number}" for number in range(harmonics_of(degree))]
    shape = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]
    return ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *rests, *shape]


def scene(degree):
    """Returns rows of turned Gaussians of several shapes, none of which viewers need changed."""
    rows = []
    for number in range(COUNT):

        def wave(pace):
            return math.sin(pace * number + 0.3)

        rests = [0.8 * wave(0.03 * (rest + 1)) for rest in range(harmonics_of(degree))]
        sizes = [-3.0 + 0.5 * wave(0.9), -3.2 + 0.4 * wave(1.7), -3.8]
        rotation = [0.3 + wave(0.41), wave(0.53), wave(0.67), wave(0.83)]
        place = [3.0 * wave(0.7), 2.0 * wave(1.3), 2.5 * wave(2.1)]
        colour = [wave(0.11), wave(0.23), wave(0.37)]
        values = [*place, 0.0, 0.0, 0.0, *colour, *rests, 3.0 * wave(0.05), *sizes, *rotation]
        rows.append(dict(zip(properties(degree), values)))
    return rows


def write_ply(path, rows):
    """Writes a PLY as 3DGS does."""
    names = list(rows[0])
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property float {name}" for name in names] + ["end_header", ""]
    body = b"".join(struct.pack(f"<{len(names)}f", *row.values()) for row in rows)
    path.write_bytes("\n".join(head).encode() + body)


def read_ply(path):
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode().splitlines()
    names = [line.split()[2] for line in lines if line.startswith("property")]
    if any(not line.startswith("property float ") for line in lines if line.startswith("property")):
        raise ValueError(f"{path}: properties must be floats")
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    rows = struct.iter_unpack(f"<{len(names)}f", body[: 4 * count * len(names)])
    return [dict(zip(names, values)) for values in rows]


def turned(row):
    values = [row[f"rot_{axis}"] for axis in range(4)]
    length = math.sqrt(sum(value * value for value in values))
    return [value / length for value in values]


def degrees_between(one, other):
    """Returns the angle between two rotations of an ellipsoid: a half turn about its own axis changes nothing."""
    w, x, y, z = other
    alike = [(w, x, y, z), (-x, w, z, -y), (-y, -z, w, x), (-z, y, -x, w)]
    alike += [tuple(-part for part in turn) for turn in alike]
    chord = min(math.dist(one, turn) for turn in alike)
    return 4 * math.degrees(math.asin(min(chord / 2, 1.0)))


# Signs of real harmonics of degree 1 to 3 after a half turn about x.
HALF_TURN = (-1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1)


def half_turned(row, degree):
    """Returns a Gaussian after a half turn about x, with harmonics by channel as in a PLY."""
    result = dict(row)
    for name in ("y", "z", "rot_2", "rot_3"):
        result[name] = -row[name]
    each = harmonics_of(degree) // 3
    for number in range(3 * each):
        result[f"f_rest_{number}"] = HALF_TURN[number % each] * row[f"f_rest_{number}"]
    return result


def opacity(row):
    return 1 / (1 + math.exp(-row["opacity"]))


def difference(row, other, harmonics):
    """Returns the differences of two Gaussians, one for each of QUANTITIES."""

    def largest(names):
        return max((abs(row[name] - other[name]) for name in names), default=0.0)

    return (
        largest(["x", "y", "z"]),
        largest([f"scale_{axis}" for axis in range(3)]),
        degrees_between(turned(row), turned(other)),
        255 * C0 * largest([f"f_dc_{channel}" for channel in range(3)]),
        abs(opacity(row) - opacity(other)),
        largest([f"f_rest_{number}" for number in range(harmonics)]),
    )


def differences(expected, found, harmonics):
    """Returns the largest differences of two scenes, in any order; raises ValueError where one lacks a Gaussian.

    A Gaussian belongs to the nearest one that no other has.
    """
    if len(found) != len(expected):
        raise ValueError(f"{len(found)} Gaussians, {len(expected)} expected")
    left, most = list(found), [0.0] * len(QUANTITIES)
    for row in expected:
        nearest = min(left, key=lambda other: sum((other[axis] - row[axis]) ** 2 for axis in "xyz"))
        left.remove(nearest)
        most = [max(pair) for pair in zip(most, difference(row, nearest, harmonics))]
    return most


def changed(rows):
    """Returns scenes with one wrong value, and the quantity that must show it."""
    changes = {
        "position": ("y", 0.05),
        "log size": ("scale_1", 0.2),
        "rotation, degrees": ("rot_2", 0.3),
        "colour of 255": ("f_dc_2", 0.1),
        "opacity": ("opacity", 0.2),
        "harmonics": ("f_rest_1", 0.3),
    }
    for quantity, (name, change) in changes.items():
        wrong = [dict(row) for row in rows]
        wrong[7][name] += change
        yield quantity, wrong
