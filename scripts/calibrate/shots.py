#!/usr/bin/env python3
"""Counts how often the check of shots is right, on real footage, on what is made of it, and on made-up shots.

Usage: shots.py WORK --footage DATA

DATA holds tunnel.mp4, reef.mp4, city4k.mp4, congo_stereo.mp4 and bikes.mp4, and the folders street, hall and
crossroad with frames in rgb/ and davis with clips. Every shot is encoded once with x264 into WORK, sampled as
`curate/src/shots/` samples it, and judged with its constants: whoever changes a limit changes it in both places.
Limits were set on the first half of either table, `SET`; the other half only tests them.

Needs NumPy, Pillow and ffmpeg.
"""

import argparse
import pathlib
import subprocess
from multiprocessing import Pool

import numpy as np
from PIL import Image, ImageDraw, ImageFont

# -- curate/src/shots/, curate/src/projection/ ----------------------------------------------------

INTERVAL, WIDTH = 0.4, 512
BLACK, BLACK_SHARE, BORDER, LEAST_STEP = 24, 0.98, 0.01, 0.5
SEAM, POLE, CLEARLY, LEAST_LEVELS = 0.3, 0.4, 1.5, 1.5
LEAST_SAMPLES = 2
CELL, LEAST_SPREAD = 4, 8.0
BLOCK, FLAT_LEVELS, SAME_LEVELS = 16, 6, 3
LEAST_CARD_SPREAD, MOST_BACKGROUND, STILL_CHANGE, CHANGED_LEVELS = 64.0, 0.6, 0.002, 12.0


def luma(image):
    return (image @ np.array([77, 150, 29]) + 128).astype(int) >> 8


def means(levels, size):
    height, width = levels.shape[0] // size * size, levels.shape[1] // size * size
    blocks = levels[:height, :width].reshape(height // size, size, width // size, size)
    return blocks.mean((1, 3)), blocks.max((1, 3)) - blocks.min((1, 3))


def cut_border(image):
    """The image inside of a border whose edge is sharp, and whether there was one."""
    black = (image <= BLACK).all(2)
    rows, columns = black.mean(1), black.mean(0)
    run = lambda line: int(np.argmax(line < BLACK_SHARE)) if (line < BLACK_SHARE).any() else len(line)
    left, right, top, bottom = run(columns), run(columns[::-1]), run(rows), run(rows[::-1])
    height, width = black.shape
    if left == width or top == height:
        return image, False
    step = lambda lines, at: lines[at - 1] - lines[at] if at else 1.0
    if (left + right) / width <= BORDER or min(step(columns, left), step(columns[::-1], right)) < LEAST_STEP:
        left = right = 0
    if min(top, bottom) / height <= BORDER or min(step(rows, top), step(rows[::-1], bottom)) < LEAST_STEP:
        top = bottom = 0
    if left + right + top + bottom == 0 or width - left - right < 16 or height - top - bottom < 16:
        return image, False
    return image[top : height - bottom, left : width - right], True


def seam(image):
    height, width = image.shape[:2]
    shares = np.cos((0.5 - (np.arange(height) + 0.5) / height) * np.pi)
    shares /= shares.sum()
    at = lambda a, b: shares @ np.abs(image[:, a] - image[:, b]).mean(2)
    near = at(np.arange(width - 1), np.arange(1, width))
    first = np.arange(0, width, 4)
    far = np.median(np.concatenate([at(first, (first + width // n) % width) for n in (4, 3, 2)]))
    near = max(np.median(near), np.median(np.concatenate([near[:4], near[-4:]])))
    if far - near < LEAST_LEVELS:
        return np.nan
    return max(0.0, (at([width - 1], [0])[0] - near) / (far - near))


def poles(image):
    spread = np.abs(image - image.mean(1, keepdims=True)).mean((1, 2))
    detail = np.abs(image - np.roll(image, -1, 1)).mean((1, 2))
    eighth = len(image) // 8
    middle = slice(eighth, len(image) - eighth)
    reference, other = np.median(spread[middle]), np.median(detail[middle])
    if reference < LEAST_LEVELS or other <= 0:
        return np.nan, np.nan
    return [np.sqrt(spread[row] / reference * detail[row] / other) for row in (0, -1)]


def sample(image, before):
    """Spread, share of the background, share of cells that changed, and the evidence of the projection."""
    levels = luma(image)
    cells, _ = means(levels, CELL)
    block_means, ranges = means(levels, BLOCK)
    flat = np.round(block_means[ranges <= FLAT_LEVELS]).astype(int)
    counts = np.bincount(flat, minlength=256)
    window = np.convolve(counts, np.ones(2 * SAME_LEVELS + 1, int), "same")
    changed = np.nan if before is None else (np.abs(cells - before) > CHANGED_LEVELS).mean()
    image = image.astype(float)
    inside, has_border = cut_border(image)
    return cells, [np.ptp(cells), window.max() / ranges.size, changed, seam(inside), *poles(inside), has_border]


def median(values):
    """Of a reading that most samples give."""
    known = [value for value in values if not np.isnan(value)]
    return np.median(known) if 2 * len(known) >= len(values) and known else np.nan


def numbers(samples):
    spread, background, changed, seams, tops, bottoms, _ = np.array(samples).T
    return {
        "samples": len(samples),
        "spread": float(np.quantile(spread, 0.75, method="nearest")),
        "background": float(np.quantile(background, 0.25, method="nearest")),
        "changed": float(np.median(changed[1:])) if len(samples) > 1 else np.nan,
        "seam": float(median(seams)),
        "pole": float(np.nanmax([median(tops), median(bottoms), -1])),
    }


def judged(n):
    """The check that a shot fails, or "kept"."""
    if n["spread"] < LEAST_SPREAD:
        return "blank"
    if n["spread"] >= LEAST_CARD_SPREAD and n["background"] > MOST_BACKGROUND and n["changed"] <= STILL_CHANGE:
        return "title-card"
    if n["samples"] >= LEAST_SAMPLES and n["seam"] > CLEARLY * SEAM and n["pole"] > POLE:
        return "shot-projection"
    return "kept"


# -- shots ------------------------------------------------------------------------------------------

REAL = {
    "tunnel": "SET", "reef-under": "SET", "reef-paddle": "SET", "street": "SET",
    "city4k": "TEST", "congo": "TEST", "reef-crouch": "TEST", "reef-wave": "TEST", "hall": "TEST",
}
VARIANTS = {
    "as it is": "null",
    "at 10 % brightness": "colorchannelmixer=rr=.1:gg=.1:bb=.1",
    "at 10 % brightness, noise": "colorchannelmixer=rr=.1:gg=.1:bb=.1,noise=alls=4:allf=t",
    "at 15 % contrast": "lutrgb=r=170+(val-128)*.15:g=170+(val-128)*.15:b=170+(val-128)*.15",
    "still": "loop=-1:1:0,trim=duration=4",
    "still, noise": "loop=-1:1:0,trim=duration=4,noise=alls=6:allf=t",
    "still, at 10 % brightness": "colorchannelmixer=rr=.1:gg=.1:bb=.1,loop=-1:1:0,trim=duration=4",
    "still, at 15 % contrast": "lutrgb=r=170+(val-128)*.15:g=170+(val-128)*.15:b=170+(val-128)*.15,loop=-1:1:0,trim=duration=4",
    "clipped blacks": "lutrgb=r=(val-100)*1.2:g=(val-100)*1.2:b=(val-100)*1.2",
    "still, clipped blacks": "lutrgb=r=(val-100)*1.2:g=(val-100)*1.2:b=(val-100)*1.2,loop=-1:1:0,trim=duration=4",
    "a second of it": "trim=duration=1",
}


def source(data, name):
    frames = lambda folder: ["-framerate", "10", "-i", f"{data}/{folder}/rgb/%04d.jpg"]
    part = lambda begin, length: ["-ss", str(begin), "-t", str(length), "-i", f"{data}/reef.mp4"]
    return {
        "tunnel": ["-i", f"{data}/tunnel.mp4"], "city4k": ["-i", f"{data}/city4k.mp4"],
        "congo": ["-i", f"{data}/congo_stereo.mp4"], "street": frames("street"), "hall": frames("hall"),
        "reef-under": part(1, 12), "reef-paddle": part(30, 7),
        "reef-crouch": part(37.5, 6), "reef-wave": part(45, 28),
    }[name]


def encoded(arguments, filters, out, size="1024:512", seconds=None):
    if not out.exists():
        limit = ["-t", str(seconds)] if seconds else []
        command = ["ffmpeg", "-nostdin", "-v", "error", "-y", *arguments, "-an", "-threads", "1"]
        filters = f"{filters},scale={size}:flags=area,setsar=1,format=yuv420p"
        subprocess.run([*command, "-vf", filters, *limit, "-c:v", "libx264", "-preset", "veryfast", "-crf", "26",
                        str(out)], check=True)
    return out


def card(path, words, letters, ground, size, place):
    image = Image.new("RGB", (1024, 512), ground)
    font = ImageFont.truetype("/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf", size)
    draw = ImageDraw.Draw(image)
    for row, line in enumerate(words.split("|")):
        draw.text((place[0], place[1] + row * size * 1.3), line, fill=letters, font=font)
    image.save(path)
    return path


TEXT = "A FILM BY|Somebody Else|with the help of many"
CARDS = {  # name: (text, letters, ground, size, place), filter
    "white on black": ((TEXT, "white", "black", 28, (380, 200)), "null"),
    "small, on black": (("2019", "white", "black", 16, (500, 250)), "null"),
    "large, on black": ((TEXT, "white", "black", 80, (60, 60)), "null"),
    "black on white": ((TEXT, "black", "white", 28, (380, 200)), "null"),
    "fading in": ((TEXT, "white", "black", 28, (380, 200)), "fade=in:st=0:d=1"),
    "yellow on blue": ((TEXT, (240, 220, 40), (20, 40, 120), 40, (300, 180)), "null"),
    "grey on grey": ((TEXT, (190, 190, 190), (60, 60, 60), 32, (340, 190)), "null"),
    "film grain": ((TEXT, "white", (16, 16, 16), 36, (320, 190)), "noise=alls=6:allf=t"),
    "a page of text": (("|".join(["letters that fill the page from edge to edge"] * 8), "white", "black", 40, (20, 30)), "null"),
    "moving credits": (("|".join(["NAME OF A PERSON"] * 40), "white", "black", 20, (400, 0)), "scroll=vertical=.004"),
}
BLANKS = {
    "black": "color=black", "nearly black, noise": "color=0x101010,noise=alls=5:allf=t", "white": "color=white",
    "blue": "color=0x2040c0", "grey, noise": "color=0x808080,noise=alls=5:allf=t", "dark red": "color=0x300000",
}
BARS = "scale=910:512:flags=area,pad=1024:512:57:0"
FLAT = {  # name: the arguments and filters
    "bikes 0": (["-t", "1.1", "-i", "{}/bikes.mp4"], "null"),
    "bikes 1": (["-ss", "1.25", "-t", "1.7", "-i", "{}/bikes.mp4"], "null"),
    "bikes 2": (["-ss", "3.1", "-t", "2.3", "-i", "{}/bikes.mp4"], "null"),
    "blackswan": (["-framerate", "24", "-i", "{}/davis/blackswan/rgb/%05d.jpg"], "null"),
    "blackswan, bars": (["-framerate", "24", "-i", "{}/davis/blackswan/rgb/%05d.jpg"], BARS),
    "part of street": (["-framerate", "10", "-i", "{}/street/rgb/%04d.jpg"], "v360=e:flat:h_fov=90:v_fov=60"),
    "part of tunnel": (["-i", "{}/tunnel.mp4"], "v360=e:flat:h_fov=90:v_fov=60"),
    "crossroad": (["-framerate", "2", "-i", "{}/crossroad/rgb/%04d.jpg"], "null"),
    "bikes 3": (["-ss", "5.6", "-t", "1.8", "-i", "{}/bikes.mp4"], "null"),
    "bikes 4": (["-ss", "7.6", "-t", "2", "-i", "{}/bikes.mp4"], "null"),
    "car-shadow": (["-framerate", "24", "-i", "{}/davis/car-shadow/rgb/%05d.jpg"], "null"),
    "car-shadow, bars": (["-framerate", "24", "-i", "{}/davis/car-shadow/rgb/%05d.jpg"], BARS),
    "part of city4k": (["-i", "{}/city4k.mp4"], "scale=1024:512,v360=e:flat:h_fov=90:v_fov=60"),
    "part of congo": (["-i", "{}/congo_stereo.mp4"], "crop=iw:ih/2:0:0,scale=1024:512,v360=e:flat:h_fov=90:v_fov=60"),
    "part of reef": (["-ss", "45", "-t", "10", "-i", "{}/reef.mp4"], "v360=e:flat:h_fov=90:v_fov=60"),
    "part of hall": (["-framerate", "10", "-i", "{}/hall/rgb/%04d.jpg"], "v360=e:flat:h_fov=90:v_fov=60"),
}
RIGHT = {"real": {"kept"}, "blank": {"blank"}, "card": {"title-card", "shot-projection"}, "flat": {"shot-projection"}}


def shots(work, data):
    """Kind, half, name, variant and arguments of `encoded`."""
    for name, half in REAL.items():
        for number, (variant, filters) in enumerate(VARIANTS.items()):
            crop = "crop=iw:ih/2:0:0," if name == "congo" else ""
            out = work / f"{name}-{number}.mp4"
            yield "real", half, name, variant, (source(data, name), crop + "scale=1024:512:flags=area," + filters, out)
    for number, (name, ((words, *rest), filters)) in enumerate(CARDS.items()):
        path = card(work / f"card-{number}.png", words, *rest)
        arguments = (["-loop", "1", "-framerate", "25", "-t", "4", "-i", str(path)], filters, work / f"card-{number}.mp4")
        yield "card", "SET" if number < 5 else "TEST", name, "", arguments
    for number, (name, text) in enumerate(BLANKS.items()):
        colour, _, filters = text.partition(",")
        arguments = ["-f", "lavfi", "-t", "4", "-i", f"{colour}:s=1024x512:r=25"]
        yield "blank", "SET" if number < 3 else "TEST", name, "", (arguments, filters or "null", work / f"blank-{number}.mp4")
    for number, (name, (arguments, filters)) in enumerate(FLAT.items()):
        arguments = [word.format(data) for word in arguments]
        yield "flat", "SET" if number < 7 else "TEST", name, "", (arguments, filters, work / f"flat-{number}.mp4")


def measured(shot):
    *names, arguments = shot
    video = encoded(*arguments)
    command = ["ffmpeg", "-nostdin", "-v", "error", "-threads", "1", "-i", str(video), "-vf",
               f"fps={1 / INTERVAL}:round=up,scale={WIDTH}:{WIDTH // 2}:flags=area", "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    raw = subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout
    images = np.frombuffer(raw, np.uint8).reshape(-1, WIDTH // 2, WIDTH, 3).astype(int)
    before, samples = None, []
    for image in images:
        before, values = sample(image, before)
        samples.append(values)
    return names, numbers(samples)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--footage", required=True)
    parser.add_argument("--all", action="store_true", help="print the numbers of every shot")
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    counts = {}
    with Pool(1) as pool:
        for (kind, half, name, variant), found in pool.imap(measured, shots(options.work, options.footage)):
            verdict = judged(found)
            right = verdict in RIGHT[kind]
            row = counts.setdefault((kind, half, variant), [0, 0])
            row[0] += right
            row[1] += 1
            if options.all or not right:
                values = " ".join(f"{key} {value:.4g}" for key, value in found.items())
                print(f"{'' if right else 'WRONG '}{half} {kind} {name} {variant}: {verdict} ({values})", flush=True)
    for (kind, half, variant), (right, all_of_them) in counts.items():
        print(f"{half:4} {kind:5} {variant:28} {right} of {all_of_them}")


if __name__ == "__main__":
    main()
