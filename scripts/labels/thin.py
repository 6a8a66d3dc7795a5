#!/usr/bin/env python3
"""Copies the frames of a sequence that masks have to be scored on, so that slow detectors run on few frames.

    scripts/labels/thin.py tests/data/footage-labels/CLIP.json SEQUENCE OUT [--around SECONDS ...]

OUT gets the labelled frames of SEQUENCE and, for each SECONDS, the nearest frames at least that far before and after
each of them. A detector that looks at single frames (`deeplab`) needs no others. `combined` compares frames 0.2 s away,
and 1 s away where the camera stands. `residual` looks at views over seconds: give it the whole sequence.
"""

import argparse
import json
import pathlib
import shutil
import sys

# As in the program: times are sums of rounded intervals.
SLACK_SECONDS = 1e-6


def needed(times, labelled, gaps):
    """Returns the indices of the frames at labelled times and of those nearest to them that are far enough."""
    found = set(labelled)
    for index in labelled:
        for gap in gaps:
            far = [other for other, time in enumerate(times) if abs(time - times[index]) >= gap - SLACK_SECONDS]
            found.update([other for other in far if other < index][-1:])
            found.update([other for other in far if other > index][:1])
    return sorted(found)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("labels", type=pathlib.Path)
    parser.add_argument("sequence", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--around", type=float, nargs="*", default=[], metavar="SECONDS")
    options = parser.parse_args()
    labels = json.loads(options.labels.read_text())
    record = json.loads((options.sequence / "sequence.json").read_text())
    entries = record["frames"]["entries"]
    times = [entry["time_seconds"] for entry in entries]
    near = 0.5 / labels["frames_per_second"]
    labelled = [index for index, time in enumerate(times)
                if any(abs(time - frame["seconds"]) <= near for frame in labels["frames"])]
    if not labelled:
        sys.exit(f"thin: {options.sequence} must have a labelled frame of {labels['clip']}, and has none")
    record["frames"]["entries"] = [entries[index] for index in needed(times, labelled, options.around)]
    for entry in record["frames"]["entries"]:
        target = options.out / entry["file"]
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(options.sequence / entry["file"], target)
    (options.out / "sequence.json").write_text(json.dumps(record, indent=2))
    print(f"{options.out}: {len(labelled)} labelled frames and {len(record['frames']['entries']) - len(labelled)} others")


if __name__ == "__main__":
    main()
