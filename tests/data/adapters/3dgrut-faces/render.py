import argparse
from pathlib import Path
from shutil import copyfile

import colmap

parser = argparse.ArgumentParser()
parser.add_argument("--checkpoint", type=Path, required=True)
parser.add_argument("--path", type=Path, required=True)
parser.add_argument("--out-dir", type=Path, required=True)
arguments = parser.parse_args()
out = arguments.out_dir / arguments.checkpoint.read_text() / f"{arguments.path.stem}-0101_130000/ours_30000/renders"
out.mkdir(parents=True)
for index, name in enumerate(colmap.check_faces(arguments.path)):
    copyfile(arguments.path / "images" / name, out / f"{index:05}.png")
