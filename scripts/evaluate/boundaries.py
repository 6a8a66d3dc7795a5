"""Judges a boundary detector by clips whose boundaries are known.

    python3 scripts/evaluate/boundaries.py --omnilife target/release/omnilife \\
        --detector histogram --tolerance 0.1 GENERATED... [--clips SHARED_DATA]

GENERATED are folders that scripts/fixtures/boundaries.py made. SHARED_DATA is a folder with the
clips of REAL. Prints a Markdown row with precision, recall and F1 for each folder, and for each kind
of transition its recall; --list also prints every miss and every false alarm.

A boundary counts as found when a detected one lies within the tolerance, measured between their
nearest instants; each counts once. The detector `pyscenedetect` is the program `scenedetect`, which
`scripts/setup --compare` installs.
"""

import argparse
import csv
import json
import pathlib
import subprocess
import tempfile

# Frame rate, and (last frame of the old shot, first frame of the new one).
REAL = {
    "reef.mp4": (24, [(713, 719), (889, 890), (1058, 1059)]),
    "bikes.mp4": (25, [(29, 30), (75, 76), (136, 137), (186, 187), (241, 242)]),
    "tunnel.mp4": (25, []),
    "city4k.mp4": (30, []),
    "congo_stereo.mp4": (30, []),
}


def gap(a, b):
    return max(a["begin_seconds"] - b["end_seconds"], b["begin_seconds"] - a["end_seconds"], 0)


def match(truth, found, tolerance):
    """Pairs of indices, each boundary in one at most."""
    pairs, following = [], 0
    for index, one in enumerate(truth):
        while (following < len(found)
               and found[following]["end_seconds"] < one["begin_seconds"] - tolerance):
            following += 1
        if following < len(found) and gap(one, found[following]) <= tolerance:
            pairs.append((index, following))
            following += 1
    return pairs


def generated(folder):
    for path in sorted(folder.glob("*.json")):
        yield path.with_suffix(".mp4"), json.loads(path.read_text())["boundaries"]


def real(folder):
    for name, (rate, spans) in REAL.items():
        yield folder / name, [
            {"begin_seconds": last / rate, "end_seconds": first / rate,
             "how": "cut" if first == last + 1 else "dissolve"} for last, first in spans]


def detected(options, path):
    if options.detector == "pyscenedetect":
        return scenedetect(path)
    return json.loads(subprocess.check_output(
        [options.omnilife, "--quiet", "curate", "boundaries", str(path),
         "--detector", options.detector]))


def scenedetect(path):
    """PySceneDetect's detect-adaptive as it comes, from a list of scenes."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(["scenedetect", "-i", str(path), "-q", "detect-adaptive", "list-scenes", "-q",
                        "-s", "-o", folder, "-f", "scenes.csv"], check=True,
                       stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        with open(f"{folder}/scenes.csv", newline="") as file:
            starts = [float(row["Start Time (seconds)"]) for row in csv.DictReader(file)]
    return [{"begin_seconds": start - 1e-3, "end_seconds": start, "kind": "cut", "score": 1.0}
            for start in starts[1:]]


def judge(options, title, clips):
    total = {"truth": 0, "found": 0, "matched": 0}
    by_kind, extents = {}, []
    for path, truth in clips:
        found = detected(options, path)
        pairs = match(truth, found, options.tolerance)
        total["truth"] += len(truth)
        total["found"] += len(found)
        total["matched"] += len(pairs)
        matched, hit = {i for i, _ in pairs}, {j for _, j in pairs}
        for index, one in enumerate(truth):
            counts = by_kind.setdefault(one["how"], [0, 0])
            counts[0] += index in matched
            counts[1] += 1
            if options.list and index not in matched:
                print(f"missed {path.name} {one['how']} {one['begin_seconds']:.3f} to "
                      f"{one['end_seconds']:.3f}")
        for i, j in pairs:
            extents += [abs(truth[i]["begin_seconds"] - found[j]["begin_seconds"]),
                        abs(truth[i]["end_seconds"] - found[j]["end_seconds"])]
        for index, one in enumerate(found):
            if options.list and index not in hit:
                print(f"false  {path.name} {one['kind']} {one['begin_seconds']:.3f} to "
                      f"{one['end_seconds']:.3f} score {one['score']:.2f}")
    precision = total["matched"] / total["found"] if total["found"] else 1.0
    recall = total["matched"] / total["truth"] if total["truth"] else 1.0
    f1 = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
    kinds = ", ".join(f"{kind} {hits}/{all_}" for kind, (hits, all_) in sorted(by_kind.items()))
    extents.sort()
    middle = extents[len(extents) // 2] if extents else 0.0
    print(f"| {title} | {options.detector} | {options.tolerance} | {total['truth']} | "
          f"{precision:.3f} | {recall:.3f} | {f1:.3f} | {kinds} | {middle:.3f} |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", nargs="*", type=pathlib.Path)
    parser.add_argument("--omnilife", required=True)
    parser.add_argument("--detector", default="histogram")
    parser.add_argument("--tolerance", type=float, default=0.1)
    parser.add_argument("--clips", type=pathlib.Path)
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    print("| set | detector | tolerance (s) | boundaries | precision | recall | F1 | found by kind | "
          "median error of begin and end (s) |")
    print("|---|---|---:|---:|---:|---:|---:|---|---:|")
    for folder in options.folders:
        judge(options, folder.name, generated(folder))
    if options.clips:
        judge(options, "real clips", real(options.clips))


if __name__ == "__main__":
    main()
