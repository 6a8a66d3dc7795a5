#!/usr/bin/env python3
"""Makes footage of a rendered clip of the calibration set: exposure, noise, compression, poses and masks as dealt.

    python3 disturb.py RENDERING CLIP OUT

RENDERING is what render.py writes. OUT gets CLIP.mp4, poses.json (omnilife/poses/1), points.ply and, where the
clip has masks, masks/. Needs ffmpeg and a Python with NumPy and Pillow.
"""

import argparse
import json
import shutil
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
from PIL import Image, ImageFilter

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "fixtures"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import street
from clips import FRAMES_PER_SECOND, clips
from disturbed_poses import errors, product, quaternion

# Root mean square errors of poses, and how far a drift is smooth, frames.
JITTER_DEGREES, JITTER_METRES = 0.2, 0.015
DRIFT_DEGREES, DRIFT_METRES, DRIFT_FRAMES = 0.4, 0.04, 6
# Standard deviation of the gains in linear light.
DRIFT_GAIN, FLICKER_GAIN = 0.15, 0.07
NOISE_LEVELS, NIGHT_GAIN, NIGHT_NOISE_LEVELS = 0.025, 0.06, 0.02
COMPRESSED_RATE_FACTOR = 34
# Share of the objects of a frame that a segmenter misses, and how often it misses one for the whole clip.
MISSED_SHARE, ALWAYS_MISSED_SHARE = 0.3, 0.25


def to_linear(srgb):
    """sRGB in [0, 1] to linear light."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def to_srgb(linear):
    """Linear light to sRGB in [0, 1]."""
    linear = np.clip(linear, 0, 1)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def gains(kind, frames, random):
    """Gain of every frame in linear light."""
    if kind == "fixed":
        return np.ones(frames)
    if kind == "flicker":
        return np.exp(FLICKER_GAIN * random.normal(size=frames))
    wave = np.cumsum(random.normal(size=frames))
    wave = np.convolve(np.pad(wave, 4, mode="edge"), np.ones(9) / 9, "valid")
    wave -= wave.mean()
    return np.exp(DRIFT_GAIN * wave / wave.std())


def footage(images, clip, random):
    """What the camera of the clip would have made of the renders."""
    night = clip.footage == "night"
    noise = {"noise": NOISE_LEVELS, "night": NIGHT_NOISE_LEVELS}.get(clip.footage, 0.0)
    made = []
    for image, gain in zip(images, gains(clip.exposure, len(images), random), strict=True):
        if night or gain != 1:
            image = to_srgb(to_linear(image) * gain * (NIGHT_GAIN if night else 1.0))
        if noise:
            image = image + noise * random.normal(size=image.shape)
        made.append((255 * np.clip(image, 0, 1) + 0.5).astype(np.uint8))
    return made


def compressed(frames, folder):
    """The frames after a codec at a low rate."""
    height, width = frames[0].shape[:2]
    raw = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}"]
    low = folder / "low.mp4"
    encode = ["ffmpeg", "-v", "error", "-y", *raw, "-r", str(FRAMES_PER_SECOND), "-i", "pipe:0", "-c:v", "libx264"]
    encode += ["-preset", "veryfast", "-crf", str(COMPRESSED_RATE_FACTOR), "-pix_fmt", "yuv420p", str(low)]
    subprocess.run(encode, input=b"".join(frame.tobytes() for frame in frames), check=True)
    decode = ["ffmpeg", "-v", "error", "-i", str(low), "-f", "rawvideo", "-pix_fmt", "rgb24", "pipe:1"]
    bytes_ = subprocess.run(decode, capture_output=True, check=True).stdout
    low.unlink()
    return list(np.frombuffer(bytes_, np.uint8).reshape(len(frames), height, width, 3))


def disturbed(poses, kind, random):
    """Poses with the errors of the clip."""
    if kind == "exact":
        return poses
    smooth = DRIFT_FRAMES if kind == "drift" else 0
    degrees, metres = (DRIFT_DEGREES, DRIFT_METRES) if smooth else (JITTER_DEGREES, JITTER_METRES)
    turns = np.radians(degrees) * errors(random, len(poses), smooth)
    shifts = metres * errors(random, len(poses), smooth)
    for pose, turn, shift in zip(poses, turns, shifts, strict=True):
        turned = product(quaternion(turn), np.array(pose["rotation_wxyz"]))
        pose["rotation_wxyz"] = (turned / np.linalg.norm(turned)).tolist()
        pose["centre"] = (np.array(pose["centre"]) + shift).tolist()
    return poses


def missed(instances, random):
    """Masks of a segmenter that misses objects, some in all frames, and has ragged borders."""
    objects = sorted(set(np.unique(np.stack(instances))) - {0})
    never = {number for number in objects if random.random() < ALWAYS_MISSED_SHARE}
    masks = []
    for image in instances:
        found = [n for n in objects if n not in never and random.random() >= MISSED_SHARE]
        mask = Image.fromarray((255 * np.isin(image, found)).astype(np.uint8))
        masks.append(mask.filter(random.choice([ImageFilter.MaxFilter(3), ImageFilter.MinFilter(3)])))
    return masks


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rendering", metavar="RENDERING", type=Path)
    parser.add_argument("clip", metavar="CLIP")
    parser.add_argument("out", metavar="OUT", type=Path)
    arguments = parser.parse_args()
    rendering, name, out = arguments.rendering, arguments.clip, arguments.out
    clip = next(clip for clip in clips() if clip.name == name)
    random = np.random.default_rng(zlib.crc32(name.encode()))
    out.mkdir(parents=True)
    frames = json.loads((rendering / "poses.json").read_text())["frames"]
    images = [np.asarray(Image.open(rendering / frame["rgb"]).convert("RGB"), np.float64) / 255 for frame in frames]
    made = footage(images, clip, random)
    if clip.footage == "compressed":
        made = compressed(made, out)
    street.FRAMES_PER_SECOND = FRAMES_PER_SECOND
    video = out / f"{name}.mp4"
    street.encode(made, video)
    poses = disturbed([street.pose(frame["c2w"]) for frame in frames], clip.poses, random)
    times = street.presentation_times(video)
    records = [{"time_seconds": t, "pose": pose} for t, pose in zip(times, poses, strict=True)]
    if clip.masks != "none":
        (out / "masks").mkdir()
        instances = [np.asarray(Image.open(rendering / frame["mask"].replace("mask/", "inst/"))) for frame in frames]
        found = missed(instances, random) if clip.masks == "missed" else None
        for index, record in enumerate(records):
            record["mask"] = f"masks/{index:06d}.png"
            true = Image.fromarray((255 * (instances[index] > 0)).astype(np.uint8))
            (found[index] if found else true).save(out / record["mask"])
    document = {"schema": "omnilife/poses/1", "scale": "metres", "frames": records, "points": "points.ply"}
    (out / "poses.json").write_text(json.dumps(document, indent=2) + "\n")
    shutil.copy(rendering / "points.ply", out / "points.ply")


if __name__ == "__main__":
    main()
