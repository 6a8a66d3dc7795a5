#!/usr/bin/env python3
"""Draws the labels of a clip over its frames, as one contact sheet.

    scripts/labels/sheet.py CLIP OUT.png [--frames 0,40,80] [--width 640] [--columns 3] [--gain 2]

Finds the labels by the name of CLIP in tests/data/footage-labels (--labels FOLDER for others) and compares the hashes
of the clip and of every frame drawn. Fails where one differs, after writing the sheet. Operators are orange, moving
content is red (pink where it rests), overlays are magenta, ignored regions are cyan. Needs ffmpeg, NumPy and Pillow.
"""

import argparse
import hashlib
import json
import pathlib
import subprocess
import sys

import numpy as np
from PIL import Image, ImageDraw

LABELS = pathlib.Path(__file__).resolve().parents[2] / "tests/data/footage-labels"
COLOURS = {"operator": "orange", "moves": "red", "overlay": "magenta", "ignore": "cyan"}


def decoded(clip, wanted, width, height):
    """Yields the planes Y, U and V of the wanted frames, as stored; `width` and `height` are even."""
    select = "+".join(f"eq(n\\,{index})" for index in wanted)
    command = ["ffmpeg", "-nostdin", "-v", "error", "-i", clip, "-map", "0:v:0", "-vf", f"select='{select}'",
               "-vsync", "passthrough", "-f", "rawvideo", "-pix_fmt", "yuv420p", "-"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        for index in wanted:
            raw = np.frombuffer(process.stdout.read(width * height * 3 // 2), np.uint8)
            if raw.size != width * height * 3 // 2:
                sys.exit(f"sheet: {clip} has no frame {index}")
            chroma = raw[width * height:].reshape(2, height // 2, width // 2)
            yield raw[:width * height].reshape(height, width), chroma[0], chroma[1]


def luma_hash(luma):
    """Returns the hash of README.md: SHA-256 of the means over squares of width // 320 pixels, rounded."""
    side = luma.shape[1] // 320
    rows, columns = luma.shape[0] // side, luma.shape[1] // side
    squares = luma[:rows * side, :columns * side].reshape(rows, side, columns, side)
    sums = squares.sum((1, 3), dtype=np.int64)
    return hashlib.sha256(((sums + side * side // 2) // side ** 2).astype(np.uint8).tobytes()).hexdigest()


def picture(planes, labels, frame, width, gain):
    """Returns one frame with its outlines; of a stereo frame the left eye's half."""
    size = (width, round(width * labels["height"] / labels["width"]))
    images = [Image.fromarray(plane).resize(size, Image.BOX) for plane in planes]
    images[0] = images[0].point(lambda level: min(max((level - 16) * 255 / 219 * gain, 0), 255))
    image = Image.merge("YCbCr", images).convert("RGB")
    if labels["layout"] == "erp-stereo-tb":
        image = image.crop((0, 0, width, size[1] // 2))
    draw = ImageDraw.Draw(image)
    for region in sorted(frame["regions"], key=lambda region: region["kind"] != "ignore"):
        colour = "pink" if region.get("rests") else COLOURS[region["kind"]]
        outline = [(x * (image.width - 1), y * (image.height - 1)) for x, y in region["points"]]
        draw.line([*outline, outline[0]], fill=colour, width=max(1, width // 640))
    notes = [str(frame["frame"]), frame["camera"] or "transition", frame["place"] or "", "cut" * frame["cut_before"]]
    draw.text((4, 4), " ".join(notes), fill="white", stroke_width=1, stroke_fill="black")
    return image


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--labels", type=pathlib.Path, default=LABELS)
    parser.add_argument("--frames", help="indices with commas between [default: all]")
    parser.add_argument("--width", type=int, default=640)
    parser.add_argument("--columns", type=int, default=3)
    parser.add_argument("--gain", type=float, default=1.0, help="factor of brightness, for dark frames")
    options = parser.parse_args()
    labels = json.loads((options.labels / f"{options.clip.stem}.json").read_text())
    frames = labels["frames"]
    if options.frames:
        wanted = {int(index) for index in options.frames.split(",")}
        frames = [frame for frame in frames if frame["frame"] in wanted]
        missing = wanted - {frame["frame"] for frame in frames}
        if missing:
            sys.exit(f"sheet: no labels of frames {sorted(missing)}")
    problems = []
    if hashlib.sha256(options.clip.read_bytes()).hexdigest() != labels["sha256"]:
        problems.append("the clip is another file")
    pictures = []
    planes_of = decoded(options.clip, [frame["frame"] for frame in frames], labels["width"], labels["height"])
    for frame, planes in zip(frames, planes_of):
        if luma_hash(planes[0]) != frame["luma_sha256"]:
            problems.append(f"frame {frame['frame']} is another image")
        pictures.append(picture(planes, labels, frame, options.width, options.gain))
    width, height = pictures[0].size
    sheet = Image.new("RGB", (width * options.columns, height * -(-len(pictures) // options.columns)))
    for place, image in enumerate(pictures):
        sheet.paste(image, (place % options.columns * width, place // options.columns * height))
    sheet.save(options.out)
    if problems:
        sys.exit("sheet: " + "; ".join(problems))


if __name__ == "__main__":
    main()
