"""Checks of poses and points."""

import struct


def check_rotation(rows):
    """Refuses a matrix that is no turn."""
    for i in range(3):
        for j in range(3):
            dot = sum(rows[i][k] * rows[j][k] for k in range(3))
            assert abs(dot - (i == j)) < 1e-4, f"{rows} is no rotation"
    a, b, c = (row[:3] for row in rows[:3])
    cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    assert sum(x * y for x, y in zip(cross, c)) > 0.9, f"{rows} mirrors"


def turn(quaternion):
    """Returns the rotation of a quaternion (w, x, y, z), by rows."""
    w, x, y, z = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def columns(path):
    """Returns the (type, name) columns of a binary PLY, and its number of vertices."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    assert lines[1] == "format binary_little_endian 1.0", lines[1]
    count = int(next(line for line in lines if line.startswith("element vertex")).split()[2])
    found = [tuple(line.split()[1:]) for line in lines if line.startswith("property")]
    size = struct.calcsize("<" + "".join({"float": "f", "double": "d", "uchar": "B"}[kind] for kind, _ in found))
    assert len(body) == count * size, f"{path} has {len(body)} bytes for {count} vertices of {size}"
    return found, count
