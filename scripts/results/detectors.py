#!/usr/bin/env python3
"""Runs the detectors of `omnilife curate` on the labelled clips and puts their scores into a page.

    scripts/results/detectors.py CLIPS OUT --omnilife target/release/omnilife [--page docs/results/curation.md]

CLIPS is a folder with the videos that tests/data/footage-labels/README.md names; one that is missing is named and left
out. Each is curated at its own frame rate, 1024 pixels wide or as wide as it is. The commands skip what OUT has of the
same frames and settings. Without --page the tables are printed. Needs NumPy and Pillow.
"""

import argparse
import hashlib
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "scripts/labels"))

import score  # noqa: E402
from benchmark_page import machine  # noqa: E402

LABELS = ROOT / "tests/data/footage-labels"
BEGIN, END = "<!-- detectors: begin -->", "<!-- detectors: end -->"
WIDTH = 1024
# How long a clip's shots may be is nothing that detectors are asked about.
PERSPECTIVE = ["--projection", "pinhole", "--min-shot", "0"]


class Clip:
    """A labelled clip, and the folder for the results of detectors."""

    def __init__(self, labels, video, out):
        self.labels, self.video = labels, video
        self.name, self.half = video.stem, labels["half"]
        self.is_sphere = labels["layout"] != "rectilinear"
        self.dataset = out / self.name
        self.results = self.dataset / "videos" / self.name

    @property
    def sequences(self):
        return sorted(path.parent for path in self.results.glob("seq-*/sequence.json"))

    def detect(self, omnilife):
        """Runs every detector."""
        def run(*words):
            subprocess.run([omnilife, "--quiet", "curate", *map(str, words)], check=True, stdout=subprocess.DEVNULL)

        width = ["--width", WIDTH] if self.labels["width"] > WIDTH else []
        run("build", self.video, "--criteria", "none", "--fps", self.labels["frames_per_second"], *width,
            *([] if self.is_sphere else PERSPECTIVE), "--out", self.dataset)
        for sequence in self.sequences:
            if self.is_sphere:
                run("operator", sequence)
            run("masks", sequence, "--method", "residual")
        run("annotate", self.dataset)

    def score(self, task):
        """Scores one task and prints its lines."""
        inputs = {"overlays": [self.results / "analysis.json"], "boundaries": [self.results / "boundaries.json"]}
        lines, record = score.TASKS[task](self.labels, inputs.get(task, self.sequences))
        print(f"{task}:", *lines, sep="\n", file=sys.stderr)
        return record


def grid(headings, rows):
    lines = ["| " + " | ".join(headings) + " |", "|---|---" + "|--:" * (len(headings) - 2) + "|"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows])


def titled(clip, *cells):
    return [f"`{clip.name}`", clip.half, *cells]


def of_boundaries(clip):
    record = clip.score("boundaries")
    return titled(clip, f"{record['found']} of {record['labelled']}", str(record["false"]))


def of_overlays(clip):
    record = clip.score("overlays")
    false = ", ".join(f"{name} {steradians:.3f} sr" for name, steradians in record["false"])
    return titled(clip, f"{record['found']} of {record['labelled']}", score.shown(record["iou"]), false or "0")


def of_operator(clip):
    record = clip.score("operator")
    shown = [score.shown(record[name]) if record["is_labelled"] else "-" for name in ("iou", "precision", "recall")]
    return titled(clip, "yes" if record["is_labelled"] else "no", f"{record['found']} of {record['sequences']}", *shown)


def of_masks(clip):
    record = clip.score("masks")
    moves = record["moves"] or dict.fromkeys(("iou", "precision", "recall"))
    shown = [score.shown(moves[name]) for name in ("iou", "precision", "recall")]
    return titled(clip, f"{record['frames']} of {len(clip.labels['frames'])}", *shown,
                  score.shown(record["background"]))


def of_motion(clip):
    record = clip.score("motion")
    return titled(clip, f"{record['right']} of {record['judged']}", str(record["sequences"] - record["judged"]))


# Title, headings after the clip and its half, row of a clip, perspective clips too.
TABLES = [
    ("Boundaries", ["found", "reported by mistake"], of_boundaries, True),
    ("Overlays", ["found", "IoU of what is found", "reported by mistake"], of_overlays, False),
    ("Operators", ["labelled", "sequences with a mask", "IoU", "precision", "recall"], of_operator, False),
    ("Masks of moving content (`residual`)", ["frames", "IoU", "precision", "recall", "background marked"], of_masks,
     True),
    ("Motion of the camera: still or moving", ["sequences right", "not judged"], of_motion, True),
]


def tables(clips, commit):
    parts = [f"{machine()}; commit {commit}."]
    for title, headings, row, takes_perspective in TABLES:
        rows = [row(clip) for clip in clips if clip.is_sphere or takes_perspective]
        parts.append(f"**{title}**\n\n" + grid(["clip", "half", *headings], rows))
    return "\n\n".join(parts)


def labelled_clips(folder, out):
    for file in sorted(LABELS.glob("*.json")):
        labels = json.loads(file.read_text())
        video = folder / labels["clip"]
        if not video.exists():
            print(f"detectors: {video} is missing and left out", file=sys.stderr)
        elif hashlib.sha256(video.read_bytes()).hexdigest() != labels["sha256"]:
            sys.exit(f"detectors: {video} must be the file that was labelled, and has another SHA-256")
        else:
            yield Clip(labels, video, out)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clips", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--omnilife", required=True)
    parser.add_argument("--page", type=Path)
    options = parser.parse_args()
    clips = list(labelled_clips(options.clips, options.out))
    if not clips:
        sys.exit(f"detectors: {options.clips} must have a labelled clip, and has none")
    for clip in clips:
        clip.detect(options.omnilife)
    version = subprocess.run([options.omnilife, "--version"], check=True, capture_output=True, text=True).stdout
    text = tables(clips, version.split("(", 1)[-1].rstrip(")\n"))
    if options.page is None:
        print(text)
        return
    page = options.page.read_text()
    before, after = page.split(BEGIN)[0], page.split(END)[1]
    options.page.write_text(f"{before}{BEGIN}\n{text}\n{END}{after}")


if __name__ == "__main__":
    main()
