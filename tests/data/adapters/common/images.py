"""8-bit RGB and grey PNG files, without any library."""

import struct
import zlib


def read(path):
    """Returns width, height and the rows of an RGB image, bytes."""
    data = open(path, "rb").read()
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise ValueError(f"{path} is not a PNG")
    place, packed = 8, b""
    while place < len(data):
        length, name = struct.unpack(">I4s", data[place : place + 8])
        body = data[place + 8 : place + 8 + length]
        if name == b"IHDR":
            width, height, depth, kind = struct.unpack(">IIBB", body[:10])
        elif name == b"IDAT":
            packed += body
        place += 12 + length
    channels = {0: 1, 2: 3, 6: 4}[kind]
    if depth == 16:
        return width, height, None
    lines = zlib.decompress(packed)
    stride = width * channels
    rows, above = [], bytes(stride)
    for y in range(height):
        line = lines[y * (stride + 1) : (y + 1) * (stride + 1)]
        above = unfiltered(line[0], bytearray(line[1:]), above, channels)
        rows.append(above)
    if channels == 1:
        rows = [bytes(value for value in row for _ in range(3)) for row in rows]
    if channels == 4:
        rows = [b"".join(row[4 * x : 4 * x + 3] for x in range(width)) for row in rows]
    return width, height, rows


def unfiltered(kind, line, above, step):
    for x in range(len(line)):
        left = line[x - step] if x >= step else 0
        corner = above[x - step] if x >= step else 0
        if kind == 1:
            guess = left
        elif kind == 2:
            guess = above[x]
        elif kind == 3:
            guess = (left + above[x]) // 2
        elif kind == 4:
            estimate = left + above[x] - corner
            guess = min([left, above[x], corner], key=lambda value: abs(estimate - value))
        else:
            guess = 0
        line[x] = (line[x] + guess) & 255
    return bytes(line)


def write(path, rows):
    """Writes rows of RGB bytes."""
    width, height = len(rows[0]) // 3, len(rows)
    packed = zlib.compress(b"".join(b"\x00" + row for row in rows))

    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", packed) + chunk(b"IEND", b""))
