"""Pictures that a browser drew, and how alike two of them are; with Python's standard library alone."""

import struct
import zlib


def pixels_of_png(data):
    """Rows of (red, green, blue) of an 8-bit PNG without interlacing."""
    at, body, size = 8, b"", None
    while at < len(data):
        length, kind = struct.unpack(">I4s", data[at:at + 8])
        chunk = data[at + 8:at + 8 + length]
        if kind == b"IHDR":
            size = struct.unpack(">IIBBBBB", chunk)
        elif kind == b"IDAT":
            body += chunk
        at += 12 + length
    width, height, _, colour = size[:4]
    step = {2: 3, 6: 4}[colour]
    raw, rows, before = zlib.decompress(body), [], bytes(width * step)
    for row in range(height):
        start = row * (width * step + 1)
        kind, line = raw[start], bytearray(raw[start + 1:start + 1 + width * step])
        for index in range(len(line)):
            left = line[index - step] if index >= step else 0
            above = before[index]
            corner = before[index - step] if index >= step else 0
            if kind == 1:
                line[index] = (line[index] + left) & 255
            elif kind == 2:
                line[index] = (line[index] + above) & 255
            elif kind == 3:
                line[index] = (line[index] + (left + above) // 2) & 255
            elif kind == 4:
                guess = left + above - corner
                near = min((abs(guess - left), 0, left), (abs(guess - above), 1, above),
                           (abs(guess - corner), 2, corner))
                line[index] = (line[index] + near[2]) & 255
        before = bytes(line)
        rows.append([tuple(line[at:at + 3]) for at in range(0, len(line), step)])
    return rows


def blocks(rows, side=16):
    """Mean grey of squares."""
    out = []
    for top in range(0, len(rows) - side + 1, side):
        for left in range(0, len(rows[0]) - side + 1, side):
            some = [sum(rows[y][x]) for y in range(top, top + side, 2) for x in range(left, left + side, 2)]
            out.append(sum(some) / len(some) / 3)
    return out


def likeness(a, b):
    """Correlation."""
    mean_a, mean_b = sum(a) / len(a), sum(b) / len(b)
    over = sum((x - mean_a) * (y - mean_b) for x, y in zip(a, b))
    spread = sum((x - mean_a) ** 2 for x in a) * sum((y - mean_b) ** 2 for y in b)
    return over / max(spread, 1e-9) ** 0.5


def expected_blocks(path):
    """Squares of a binary PPM."""
    data = path.read_bytes()
    width, height = (int(size) for size in data.split(maxsplit=4)[1:3])
    data = data[-3 * width * height:]
    return blocks([[tuple(data[3 * (y * width + x):3 * (y * width + x) + 3]) for x in range(width)]
                   for y in range(height)])
