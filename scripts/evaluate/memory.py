"""Measures whether the memory of curation depends on how long a video is.

    python3 scripts/evaluate/memory.py --omnilife target/release/omnilife VIDEO [--seconds 300]
        [--command boundaries]

Gives VIDEO a sound track (a tone, not compressed: 192 kB a second, so that a leak of its packets
would show) and writes it once and looped to the length given, packets copied, with ffmpeg. Runs
`curate COMMAND` on both and prints the peak of the resident set as a Markdown table. With `build`,
the whole of `curate build --criteria none` is measured, which needs footage that is ERP. Exits with
1 where the long one takes more than 128 bytes per frame beyond 10 %.
"""

import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

# Numbers per frame that a run keeps to its end: times and the signals of a detector, which may be
# held twice for a moment while they are written.
BYTES_PER_FRAME = 2 * 64


def ffmpeg(*words):
    command = ["ffmpeg", "-nostdin", "-v", "error", "-y", *map(str, words)]
    subprocess.run(command, check=True)


def frames(video):
    command = ["ffprobe", "-v", "error", "-select_streams", "v:0", "-count_packets",
               "-show_entries", "stream=nb_read_packets", "-of", "csv=p=0", str(video)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip(", \n"))


def sound_packets(video):
    command = ["ffprobe", "-v", "error", "-select_streams", "a:0", "-count_packets",
               "-show_entries", "stream=nb_read_packets", "-of", "csv=p=0", str(video)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip(", \n"))


def peak_bytes(command):
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status != 0:
        sys.exit(f"memory: {' '.join(command)} failed")
    return usage.ru_maxrss * 1024


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--omnilife", required=True)
    parser.add_argument("--seconds", type=float, default=300)
    parser.add_argument("--command", default="boundaries", choices=["boundaries", "projection", "build"])
    parser.add_argument("video", type=pathlib.Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as work:
        work = pathlib.Path(work)
        once, long = work / "once.mov", work / "long.mov"
        ffmpeg("-i", options.video, "-f", "lavfi", "-i", "sine=frequency=440:sample_rate=48000",
               "-map", "0:v:0", "-map", "1:a", "-c:v", "copy", "-c:a", "pcm_s16le", "-ac", "2", "-shortest", once)
        ffmpeg("-stream_loop", "-1", "-i", once, "-t", options.seconds, "-c", "copy", long)
        print("| video | frames | packets of sound | peak MB |")
        print("|---|--:|--:|--:|")
        peaks = []
        for video in (once, long):
            command = [options.omnilife, "--quiet", "curate", options.command, str(video)]
            if options.command == "build":
                out = str(work / f"{video.stem}-set")
                command += ["--criteria", "none", "--out", out]
            peaks.append(peak_bytes(command))
            print(f"| {video.stem} | {frames(video)} | {sound_packets(video)} "
                  f"| {peaks[-1] / 1e6:.1f} |")
        allowed = 1.1 * peaks[0] + BYTES_PER_FRAME * frames(long)
        if peaks[1] > allowed:
            sys.exit(f"memory: {peaks[1] / 1e6:.1f} MB, at most {allowed / 1e6:.1f} MB were expected")


if __name__ == "__main__":
    main()
