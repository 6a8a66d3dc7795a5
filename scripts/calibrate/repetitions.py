#!/usr/bin/env python3
"""Counts repeated frames of clips as they are, and stored at 30 frames a second from 10, 15 and 24.

    repetitions.py CLIP...

Prints for ratios of 0.05 to 0.2 the share of frames that count as repeating the one before, of the first six seconds.
A model in NumPy of `curate/src/repetitions.rs`. Needs NumPy and ffmpeg with libx264.
"""

import subprocess
import sys
import tempfile

import numpy as np

RATIOS = (0.05, 0.1, 0.15, 0.2)
REACH = 3
SECONDS = "6"


def steps(clip):
    """Mean differences of neighbouring frames at 128x64."""
    words = ["ffmpeg", "-v", "error", "-t", SECONDS, "-i", clip, "-vf", "scale=128:64:flags=area,format=rgb24"]
    raw = subprocess.run([*words, "-f", "rawvideo", "-"], check=True, stdout=subprocess.PIPE).stdout
    frames = np.frombuffer(raw, np.uint8).reshape(-1, 64 * 128 * 3).astype(np.int16)
    return np.abs(np.diff(frames, axis=0)).mean(1)


def share(found, ratio):
    def repeats(at):
        before, behind = found[max(0, at - REACH) : at], found[at + 1 : at + 1 + REACH]
        return len(before) and len(behind) and found[at] < ratio * min(before.max(), behind.max())

    return sum(map(bool, map(repeats, range(len(found))))) / max(len(found) + 1, 1)


def report(name, clip):
    found = steps(clip)
    print(f"{name:40}", *(f"{share(found, ratio):.3f}" for ratio in RATIOS), flush=True)


def main():
    print(f"{'clip':40}", *(f"{ratio:5}" for ratio in RATIOS))
    for clip in sys.argv[1:]:
        report(clip[-40:], clip)
        for rate in (10, 15, 24):
            for factor in (18, 28):
                with tempfile.NamedTemporaryFile(suffix=".mp4") as made:
                    words = ["ffmpeg", "-v", "error", "-y", "-t", SECONDS, "-i", clip]
                    filters = f"fps={rate},fps=30,scale=1024:-2"
                    subprocess.run([*words, "-vf", filters, "-crf", str(factor), made.name], check=True)
                    report(f"  {rate} in 30, rate factor {factor}", made.name)


if __name__ == "__main__":
    main()
