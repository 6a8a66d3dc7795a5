"""Small scenes of which everything is known, and what an import made of them.

A picture says which frame it is and where its pixels are: red rises to the right, green downwards, blue is twenty
times the number of the frame. So a frame whose lens was taken out is compared with the camera that took it, pixel by
pixel. Poses are matrices from the camera (x right, y down, z forward) to the world.
"""

import json
import shutil
import struct
import subprocess
import zlib
from dataclasses import dataclass, field

import numpy as np

PANORAMA = (64, 32)
PERSPECTIVE = (60, 40)
FRAMES_PER_SECOND = 10.0
# Pixels; rounding to 8 bits alone makes a third of one.
LARGEST_ERROR = 0.6
# Blue of a picture: this many levels for each frame.
BLUE_STEP = 20


def pose(number):
    """A pose of its own for every number."""
    yaw, pitch, roll = 0.7 * number - 1.0, 0.3 - 0.11 * number, 0.05 * number
    (a, b), (c, d), (e, f) = [(np.cos(x), np.sin(x)) for x in (yaw, pitch, roll)]
    matrix = np.eye(4)
    matrix[:3, :3] = (
        np.array([[a, 0, b], [0, 1, 0], [-b, 0, a]])
        @ np.array([[1, 0, 0], [0, c, -d], [0, d, c]])
        @ np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]])
    )
    matrix[:3, 3] = 0.4 * number - 1.3, 0.2 + 0.01 * number**2, 2.0 - number
    return matrix


@dataclass
class Frame:
    """A frame: its number, its file below the folder of images, its pose, and what its mask hides."""

    number: int
    name: str
    pose: np.ndarray
    hidden: np.ndarray | None = None
    seconds: float | None = None


@dataclass
class Scene:
    """What a folder holds. `project` gives the pixels at which frames show directions; None for panoramas."""

    frames: list
    size: tuple = PANORAMA
    project: object = None
    camera: dict | None = None
    points: list = field(default_factory=lambda: [[0.5, -1.25, 3.0], [-2.0, 0.125, 7.5]])
    # Largest difference of poses: numbers of single precision keep fewer digits.
    tolerance: float = 1e-6


def frames(numbers=range(4), name="frame_{:05d}.png"):
    return [Frame(number, name.format(number), pose(number)) for number in numbers]


def hidden(number, size):
    """A mask of its own for every number: True where something is not to be looked at."""
    columns, rows = np.meshgrid(range(size[0]), range(size[1]))
    return (columns > 8 + number) & (columns < 20 + number) & (rows > 3 * number) & (rows < 3 * number + 12)


def picture(number, size):
    columns, rows = np.meshgrid(range(size[0]), range(size[1]))
    ramps = [columns * 250 / (size[0] - 1), rows * 250 / (size[1] - 1), np.full(columns.shape, BLUE_STEP * number)]
    return np.stack(ramps, -1).round().astype(np.uint8)


def write_png(path, pixels):
    """8-bit pixels, grey or RGB."""
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels).reshape(height, -1)
    data = b"".join(b"\0" + row.tobytes() for row in rows)
    head = struct.pack(">IIBBBBB", width, height, 8, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    chunks = [(b"IHDR", head), (b"IDAT", zlib.compress(data)), (b"IEND", b"")]
    with open(path, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, content in chunks:
            file.write(struct.pack(">I", len(content)) + kind + content)
            file.write(struct.pack(">I", zlib.crc32(kind + content)))


def read_png(path):
    """8-bit pixels of a PNG without interlacing: (rows, columns, channels)."""
    content, at, data = path.read_bytes(), 8, b""
    while at < len(content):
        length, kind = struct.unpack(">I4s", content[at : at + 8])
        body = content[at + 8 : at + 8 + length]
        at += 12 + length
        if kind == b"IHDR":
            width, height, depth, colour, _, _, interlaced = struct.unpack(">IIBBBBB", body)
            assert depth == 8 and not interlaced, path
            channels = {0: 1, 2: 3, 4: 2, 6: 4}[colour]
        if kind == b"IDAT":
            data += body
    lines = np.frombuffer(zlib.decompress(data), np.uint8).reshape(height, 1 + width * channels)
    before = np.zeros(width * channels, int)
    rows = []
    for kind, line in zip(lines[:, 0], lines[:, 1:].astype(int)):
        before = unfiltered(kind, line, before, channels)
        rows.append(before)
    return np.array(rows, np.uint8).reshape(height, width, channels)


def unfiltered(kind, line, above, channels):
    """A line of a PNG from the differences that its filter leaves."""
    if kind in (0, 2):
        return (line + (above if kind == 2 else 0)) % 256
    row = np.zeros(len(line), int)
    for at, value in enumerate(line):
        left = row[at - channels] if at >= channels else 0
        corner = above[at - channels] if at >= channels else 0
        guess = left if kind == 1 else (left + above[at]) // 2
        if kind == 4:
            estimate = left + above[at] - corner
            guess = min((left, above[at], corner), key=lambda one: abs(estimate - one))
        row[at] = (value + guess) % 256
    return row


def write_images(folder, scene):
    for frame in scene.frames:
        write_png(folder / frame.name, picture(frame.number, scene.size))


def read_ply(path):
    """Positions of a binary or text PLY whose vertices come first, with x, y, z as its first numbers."""
    head, _, body = path.read_bytes().partition(b"end_header\n")
    lines = head.decode().splitlines()
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    types = {"float": "<f4", "float32": "<f4", "double": "<f8", "uchar": "u1", "uint8": "u1"}
    fields = [(word[2], types[word[1]]) for word in map(str.split, lines) if word[0] == "property"]
    if any("ascii" in line for line in lines):
        rows = [line.split()[:3] for line in body.decode().splitlines()[:count]]
        return np.array(rows, float)
    table = np.frombuffer(body, np.dtype(fields), count)
    return np.stack([table[axis] for axis in "xyz"], -1).astype(float)


class Program:
    """The binary that is asked."""

    def __init__(self, binary):
        self.binary = binary

    def run(self, *words):
        """The last line of what it says, as far as it failed; None where it did not."""
        done = subprocess.run([self.binary, *map(str, words)], capture_output=True, text=True)
        if done.returncode == 0:
            return None
        if done.returncode not in (1, 2):
            return f"ended with {done.returncode}"
        return done.stderr.strip().splitlines()[-1].removeprefix("omnilife: ")

    def import_(self, folder, format_, out, fps=FRAMES_PER_SECOND):
        shutil.rmtree(out, ignore_errors=True)
        timed = ["--fps", fps] if fps else []
        return self.run("curate", "import", folder, "--format", format_, *timed, "--out", out)

    def export(self, scene, format_, out):
        shutil.rmtree(out, ignore_errors=True)
        return self.run("curate", "export", scene, "--format", format_, "--out", out)


class Wrong(Exception):
    """What an import made of a folder is not what the folder holds."""


def expect(holds, what):
    if not holds:
        raise Wrong(what)


def rotation(wxyz):
    w, x, y, z = np.array(wxyz) / np.linalg.norm(wxyz)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def straightening_error(pixels, camera, scene):
    """Largest distance, in pixels, of where a straightened frame shows a place from where the camera showed it."""
    rows, columns = np.mgrid[: camera["height"], : camera["width"]] + 0.5
    x, y = (columns - camera["cx"]) / camera["fx"], (rows - camera["cy"]) / camera["fy"]
    rays = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
    truth = np.array([scene.project(ray) for ray in rays])
    found = pixels.reshape(-1, 3)[:, :2] * (np.array(scene.size) - 1) / 250 + 0.5
    # Within the picture, whose last half pixel has no neighbour.
    inside = ((truth >= 0.5) & (truth <= np.array(scene.size) - 0.5)).all(-1)
    expect(inside.mean() > 0.8, "frames show little of what was taken")
    return np.linalg.norm(found - truth, axis=-1)[inside].max()


def compare(folder, scene):
    """The largest error of a straightened frame in pixels; None where frames are as they were. Raises Wrong."""
    record = json.loads((folder / "scene.json").read_text())
    camera, by_number = record["camera"], {}
    for entry in record["frames"]:
        pixels = read_png(folder / entry["image"])
        by_number[int(np.median(pixels[..., 2])) // BLUE_STEP] = (entry, pixels)
    expect(len(by_number) == len(record["frames"]), "two frames are one")
    expect(sorted(by_number) == sorted(frame.number for frame in scene.frames), "other frames")
    expect((camera["width"], camera["height"]) == tuple(scene.size), "another size")
    expect(scene.project is not None or camera["model"] == "erp", "no panorama")
    first = min(frame.number for frame in scene.frames)
    error, is_copied = 0.0, True
    for frame in scene.frames:
        entry, pixels = by_number[frame.number]
        found = entry["pose"]
        expect(found is not None, "no pose")
        difference = rotation(found["rotation_wxyz"]) - frame.pose[:3, :3]
        expect(np.abs(difference).max() < scene.tolerance, "turned otherwise")
        expect(np.abs(np.array(found["centre"]) - frame.pose[:3, 3]).max() < scene.tolerance, "at another place")
        seconds = frame.seconds if frame.seconds is not None else (frame.number - first) / FRAMES_PER_SECOND
        expect(abs(entry["time_seconds"] - seconds) < 1e-9, "another time")
        is_same = (pixels == picture(frame.number, scene.size)).all()
        expect(is_same or scene.project is not None, "another picture")
        if scene.project is not None:
            error, is_copied = max(error, straightening_error(pixels, camera, scene)), is_copied and is_same
        compare_mask(folder, entry, frame)
    compare_points(folder, record, scene)
    expect(error < LARGEST_ERROR, f"pixels are {error:.1f} off")
    return None if is_copied else error


def compare_mask(folder, entry, frame):
    found = entry.get("mask")
    if frame.hidden is None:
        expect(found is None or not read_png(folder / found).any(), "a mask where there was none")
        return
    expect(found is not None, "no mask")
    expect((read_png(folder / found)[..., 0] > 127).tolist() == frame.hidden.tolist(), "another mask")


def compare_points(folder, record, scene):
    if not scene.points:
        return
    expect(record["points"] is not None, "no points")
    found = read_ply(folder / record["points"])
    expect(found.shape == np.shape(scene.points), "other points")
    expect(np.abs(np.sort(found, 0) - np.sort(scene.points, 0)).max() < 1e-5, "points at other places")
