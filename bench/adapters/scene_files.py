"""Rotations of poses, and grey images and distances of frames, as several adapters read and write them.

Needs nothing but Python.
"""

import ast
import math
import struct
import zlib
from array import array


def rotation(quaternion):
    """Returns the rows of the matrix of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]


def write_grey(path, width, height, pixels):
    """Writes an 8-bit grey PNG of bytes, row by row."""

    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    rows = zlib.compress(b"".join(b"\0" + pixels[row * width : (row + 1) * width] for row in range(height)))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))


def write_black(path, width, height):
    """Writes a black 8-bit grey PNG."""
    write_grey(path, width, height, bytes(width * height))


def unfiltered(kind, line, above, step):
    """Undoes a filter of PNG, for pixels of so many bytes."""
    if kind == 0 or (kind == 1 and not any(line)):
        return line
    if kind == 2 and not any(line):
        return above
    for place in range(len(line)):
        left, corner = (line[place - step], above[place - step]) if place >= step else (0, 0)
        if kind == 4:
            estimate = left + above[place] - corner
            guess = min((left, above[place], corner), key=lambda value: abs(estimate - value))
        else:
            guess = (0, left, above[place], (left + above[place]) // 2)[kind]
        line[place] = (line[place] + guess) & 255
    return line


def grey(path, bits):
    """Returns width, height and the values of a grey PNG of 8 or 16 bits, row by row."""
    data = path.read_bytes()
    place, packed, head = 8, b"", None
    while place < len(data):
        length, name = struct.unpack(">I4s", data[place : place + 8])
        body = data[place + 8 : place + 8 + length]
        if name == b"IHDR":
            head = struct.unpack(">IIBBBBB", body)
        elif name == b"IDAT":
            packed += body
        place += 12 + length
    if head is None or head[2:4] != (bits, 0) or head[6] != 0:
        raise SystemExit(f"{path} must be a grey PNG of {bits} bits that is not interlaced")
    width, height = head[:2]
    step = bits // 8
    lines, above, rows = zlib.decompress(packed), bytearray(step * width), []
    for row in range(height):
        begin = row * (step * width + 1)
        line = bytearray(lines[begin + 1 : begin + 1 + step * width])
        above = unfiltered(lines[begin], line, above, step)
        rows.append(bytes(above))
    pixels = b"".join(rows)
    return width, height, pixels if bits == 8 else struct.unpack(f">{width * height}H", pixels)


def distances(path):
    """Returns width, height and the values of a file of distances, row by row; 0 where none is known."""
    if path.suffix != ".npy":
        return grey(path, 16)
    data = path.read_bytes()
    (length,) = struct.unpack("<H", data[8:10])
    head = ast.literal_eval(data[10 : 10 + length].decode("latin1"))
    kinds = {"<f4": "f", "<f8": "d"}
    is_ours = data[:8] == b"\x93NUMPY\x01\x00" and head["descr"] in kinds and not head["fortran_order"]
    if not is_ours or len(head["shape"]) != 2:
        raise SystemExit(f"{path} must be an array of f32 or f64 (rows, columns) in C order")
    height, width = head["shape"]
    values = array(kinds[head["descr"]], data[10 + length :])
    return width, height, [value if 0 < value < math.inf else 0.0 for value in values]
