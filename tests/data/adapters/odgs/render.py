import argparse
from pathlib import Path
from shutil import copyfile

import openmvg

parser = argparse.ArgumentParser()
parser.add_argument("--model_path", "-m", type=Path, required=True)
parser.add_argument("--iteration", type=int, default=-1)
arguments = parser.parse_args()
source = Path((arguments.model_path / "cfg_args").read_text())
assert (arguments.model_path / f"point_cloud/iteration_{arguments.iteration}").is_dir()
for kind in ["train", "test"]:
    names = openmvg.stems(source, kind)
    out = arguments.model_path / kind / f"iters_{arguments.iteration}/renders"
    out.mkdir(parents=True)
    for stem, file, _ in openmvg.read(source):
        if stem in names:
            copyfile(file, out / f"{stem}.png")
