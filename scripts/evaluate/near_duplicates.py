"""Judges how well footage that is there twice is found.

    python3 scripts/evaluate/near_duplicates.py WORK --omnilife BINARY --footage SHARED_DATA \\
        --places tunnel street reef-under

Makes five files of every place: as it is, encoded again at a low rate, size and frame rate, cropped
in time, turned about the vertical, and all of it at once; and its two halves, which are different
footage of one place. `omnilife curate` is run on the files of each place, on its halves, and on all
places together. Prints a Markdown table of the pairs that were found. SHARED_DATA has the clips of
PLACES; needs the programs ffmpeg and ffprobe.
"""

import argparse
import csv
import pathlib
import subprocess

# What ffmpeg reads, and the filter that makes an equirectangular clip of it. Rendered scenes of two
# seconds are shown slowly.
PLACES = {
    "tunnel": (["-i", "tunnel.mp4"], "null"),
    "street": (["-framerate", "30", "-i", "street/rgb/%04d.jpg"], "setpts=4*PTS,fps=30"),
    "hall": (["-framerate", "30", "-i", "hall/rgb/%04d.jpg"], "setpts=4*PTS,fps=30"),
    "city4k": (["-i", "city4k.mp4"], "null"),
    "congo": (["-i", "congo_stereo.mp4"], "crop=iw:ih/2:0:0"),
    "reef-under": (["-t", "29.6", "-i", "reef.mp4"], "null"),
    "reef-surf": (["-ss", "44.5", "-t", "29", "-i", "reef.mp4"], "null"),
}
# Where it begins as a share of the length, filter, and x264's rate factor.
VARIANTS = {
    "encoded again": (0, "scale=256:128,fps=24", 36),
    "cropped in time": (0.28, "null", 28),
    "turned": (0, "scroll=hpos=0.3", 26),
    "all at once": (0.28, "scroll=hpos=0.4,scale=320:160,fps=20", 34),
}


def encode(inputs, filters, rate, path):
    subprocess.run(["ffmpeg", "-v", "error", "-y", *inputs, "-vf", filters, "-an", "-c:v", "libx264", "-preset",
                    "veryfast", "-crf", str(rate), "-pix_fmt", "yuv420p", str(path)], check=True)


def seconds(path):
    return float(subprocess.check_output(
        ["ffprobe", "-v", "error", "-show_entries", "format=duration", "-of", "csv=p=0", str(path)]))


def found(options, name, videos):
    """Pairs of file names, with what is said of them."""
    dataset = options.work / "sets" / name
    subprocess.run([options.omnilife, "--quiet", "curate", *map(str, videos), "--criteria", "none", "--accept", "erp",
                    "--max-frames", "2", "--width", "64", "--out", str(dataset)], check=True, stdout=subprocess.DEVNULL)
    with open(dataset / "attrition.csv", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["check"] == "near-duplicate"]
    of = lambda row: pathlib.Path(row["value"].removeprefix("looks like ").split(" from ")[0]).stem
    return {(pathlib.Path(row["video"]).stem, of(row)): row["value"] for row in rows}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", type=pathlib.Path)
    parser.add_argument("--omnilife", required=True)
    parser.add_argument("--footage", type=pathlib.Path, required=True)
    parser.add_argument("--places", nargs="+", choices=PLACES, required=True)
    options = parser.parse_args()
    options.work.mkdir(parents=True, exist_ok=True)
    print(f"| place | {' | '.join(VARIANTS)} | halves taken for each other |\n|---|{'---|' * (len(VARIANTS) + 1)}")
    originals = []
    for place in options.places:
        words, filters = PLACES[place]
        words = [str(options.footage / word) if "." in word and not word[0].isdigit() else word for word in words]
        original = options.work / f"{place}.mp4"
        encode(words, f"{filters},scale=512:256", 18, original)
        originals.append(original)
        length, videos = seconds(original), [original]
        for variant, (begin, change, rate) in VARIANTS.items():
            videos.append(options.work / f"{place}-{variant.replace(' ', '-')}.mp4")
            encode(["-ss", str(begin * length), "-i", str(original)], change, rate, videos[-1])
        halves = [options.work / f"{place}-first.mp4", options.work / f"{place}-second.mp4"]
        encode(["-t", str(length / 2), "-i", str(original)], "null", 18, halves[0])
        encode(["-ss", str(length / 2), "-i", str(original)], "null", 18, halves[1])
        pairs = found(options, place, videos)
        cells = []
        for video in videos[1:]:
            said = pairs.get((video.stem, place))
            cells.append("found, " + said.split("difference ")[1].rstrip(")") if said else "missed")
        wrong = list(found(options, f"{place}-halves", halves).values())
        cells.append("yes, " + wrong[0].split("difference ")[1].rstrip(")") if wrong else "no")
        print(f"| {place} | {' | '.join(cells)} |", flush=True)
    wrong = found(options, "all-places", originals)
    print(f"\nPlaces taken for each other: {len(wrong)} of {len(originals) * (len(originals) - 1) // 2} pairs"
          + "".join(f"; {a} and {b}: {said}" for (a, b), said in wrong.items()))


if __name__ == "__main__":
    main()
