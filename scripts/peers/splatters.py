#!/usr/bin/env python3
"""Compares a trainer of perspective views, on the cube faces of a panoramic scene, with our methods at equal CPU
seconds.

PROGRAM is called as OpenSplat is: PROGRAM FOLDER -n ITERATIONS -o GAUSSIANS.ply, FOLDER a COLMAP project.
Everything that is measured lands in WORK; the table goes to standard output.
"""
import argparse
import json
import math
import os
import resource
import subprocess
import sys
import time
from pathlib import Path

OURS = ["odgs", "omni4dgs-plus"]
METRICS = ["psnr", "ssim"]
SKY_POINTS = 10_000


def called(command, threads=None):
    """Runs a command, one of ours on this many threads; gives its wall and CPU seconds, children included."""
    environment = dict(os.environ, **({"RAYON_NUM_THREADS": str(threads)} if threads else {}))
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    ended = subprocess.run(command, stdout=sys.stderr, env=environment)
    wall = time.monotonic() - begun
    if ended.returncode != 0:
        sys.exit(f"splatters: {command[0]} ended with {ended.returncode}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return wall, cpu


def means(result):
    """Mean scores of the novel views of a result.json."""
    novel = json.loads(Path(result).read_text())["novel_views"]
    return {metric: novel[metric]["mean"] for metric in METRICS}


def splatter(omnilife, program, sequence, split, work, iterations, side):
    """Faces, training, rendering and scores of the program for one number of iterations."""
    faces, run = work / "faces", work / f"splatter-{iterations}"
    if not faces.exists():
        called([omnilife, "--quiet", "curate", "export", sequence, "--format", "colmap-binary", "--split", split,
                "--given-only", "--cube-faces", str(side), "--sky-points", str(SKY_POINTS), "--out", faces])
    run.mkdir(parents=True, exist_ok=True)
    gaussians = run / "gaussians.ply"
    wall, cpu = called([program, faces, "-n", str(iterations), "-o", gaussians])
    if not gaussians.is_file():
        sys.exit(f"splatters: {program} left no {gaussians}")
    called([omnilife, "--quiet", "reconstruct", "render", gaussians, "--poses", sequence, "--camera", "erp",
            "--cube-faces", str(side), "--out", run / "views"])
    called([omnilife, "--quiet", "bench", "score", "--scene", sequence, "--split", split, "--novel-views",
            run / "views", "--method", Path(program).name, "--without-lpips", "--out", run / "score"])
    return {"name": f"{Path(program).name}, {iterations} iterations", "wall": wall, "cpu": cpu,
            **means(run / "score/result.json")}


def ours(omnilife, method, sequence, split, work, seconds):
    """A method of ours, trained until it has used as much CPU time as the program, or a little more."""
    run = work / method
    # A budget is wall time; two threads are busy nearly all of it.
    threads = min(os.cpu_count() or 1, 2)
    budget = max(1.0, seconds / threads)
    called([omnilife, "--quiet", "reconstruct", "train", sequence, "--split", split, "--method", method,
            "--budget", f"{budget:.1f}", "--out", run], threads)
    called([omnilife, "--quiet", "bench", "score", "--scene", sequence, "--split", split, "--run", run,
            "--without-lpips", "--out", work / f"{method}-score"])
    record = json.loads((run / "run.json").read_text())
    return {"name": method, "wall": record["training_seconds"], "cpu": record["training_cpu_seconds"],
            **means(work / f"{method}-score/result.json")}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("omnilife", "program", "sequence", "split"):
        parser.add_argument(name, metavar=name.upper())
    parser.add_argument("work", metavar="WORK", type=Path)
    parser.add_argument("iterations", metavar="ITERATIONS", help="separated by commas")
    parser.add_argument("side", metavar="SIDE", nargs="?", type=int, help="of a face, pixels")
    arguments = parser.parse_args()
    omnilife, program, sequence = arguments.omnilife, arguments.program, arguments.sequence
    split, work, iterations = arguments.split, arguments.work, arguments.iterations
    width = json.loads((Path(sequence) / "scene.json").read_text())["camera"]["width"]
    side = arguments.side or max(8, round(width / math.pi))
    rows = [splatter(omnilife, program, sequence, split, work, int(count), side)
            for count in iterations.split(",")]
    longest = max(row["cpu"] for row in rows)
    rows += [ours(omnilife, method, sequence, split, work, longest) for method in OURS]
    called([omnilife, "--quiet", "bench", "curve", *[work / f"{method}-score" for method in OURS],
            "--clock", "cpu", "--out", work / "curves"])
    print(f"Cube faces of {side} pixels, {SKY_POINTS} sky points; novel views.\n")
    print("| method | CPU s | wall s | PSNR | SSIM |")
    print("|---|---|---|---|---|")
    for row in rows:
        print(f"| {row['name']} | {row['cpu']:.1f} | {row['wall']:.1f} | {row['psnr']:.2f} | {row['ssim']:.4f} |")
    print(f"\nOur curves over CPU seconds: {work / 'curves'}")


main()
