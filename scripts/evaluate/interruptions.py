"""Kills the curation of real footage at random moments, and compares what it ends with.

    python3 scripts/evaluate/interruptions.py --omnilife target/release/omnilife VIDEO_OR_FOLDER... \\
        [--kills 10] [--seed 1] [--work DIR] [-- --slices]

Curates once undisturbed (`curate build ... --criteria none`, and what follows `--`), then again and
again into another folder, killed (SIGKILL) after times drawn at random. What is done already is not
done again, so every kill meets a later stage. Whenever a run gets to its end before its time, and
after the last kill, every file is compared byte by byte with the undisturbed dataset, `curate verify`
has to pass, and nothing may be left of what was killed; then it begins anew in an empty folder.
Exits with 1 where anything differs.
"""

import argparse
import hashlib
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile
import time


def published(folder):
    """Hashes of all files that are part of a dataset, by name; hidden ones are not."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not any(part.startswith(".") for part in path.relative_to(folder).parts)
    }


def faults(omnilife, folder, expected):
    found = published(folder)
    yield from (f"{name}: only in one" for name in sorted(expected.keys() ^ found.keys()))
    yield from (f"{name}: differs" for name in sorted(expected.keys() & found.keys())
                if expected[name] != found[name])
    yield from (f"{path}: left over" for path in folder.rglob("*") if ".tmp" in path.name)
    verify = [omnilife, "--quiet", "curate", "verify", str(folder)]
    if subprocess.run(verify, stdout=subprocess.DEVNULL).returncode != 0:
        yield f"{folder}: verify does not pass"


def arguments():
    words, further = sys.argv[1:], []
    if "--" in words:
        at = words.index("--")
        words, further = words[:at], words[at + 1:]
    parser = argparse.ArgumentParser()
    parser.add_argument("--omnilife", required=True)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", type=pathlib.Path)
    parser.add_argument("videos", nargs="+")
    return parser.parse_args(words), further


def main():
    options, further = arguments()
    chance = random.Random(options.seed)
    with tempfile.TemporaryDirectory(dir=options.work) as work:
        whole, broken = (pathlib.Path(work) / name / "set" for name in ("whole", "broken"))

        def begin(out):
            command = [options.omnilife, "--quiet", "curate", "build", *options.videos,
                       "--criteria", "none", *further, "--out", str(out)]
            return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

        began = time.monotonic()
        code = begin(whole).wait()
        takes = time.monotonic() - began
        # 2: some of the videos are not ERP, which is an outcome like others.
        if code not in (0, 2):
            sys.exit(f"interruptions: the undisturbed run ended with {code}")
        expected = published(whole)
        print(f"undisturbed: {takes:.1f} s, exit code {code}, {len(expected)} files", flush=True)
        wrong = list(faults(options.omnilife, whole, expected))
        killed, at = 0, []
        while killed < options.kills or at:
            process = begin(broken)
            wait = chance.uniform(0.02, 0.4) * takes if killed < options.kills else None
            try:
                ended = process.wait(timeout=wait)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                killed += 1
                at.append(f"{wait:.1f}")
                continue
            new = list(faults(options.omnilife, broken, expected))
            if ended != code:
                new.append(f"it ended with {ended}")
            print(f"killed after {', '.join(at)} s, then ended: "
                  + ("all the same" if not new else "; ".join(new)), flush=True)
            wrong += new
            shutil.rmtree(broken.parent)
            at = []
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
