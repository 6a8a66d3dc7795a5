import argparse
from argparse import Namespace  # For the file of arguments.
from pathlib import Path
from shutil import copyfile

import scene

parser = argparse.ArgumentParser()
parser.add_argument("--model_path", "-m", required=True)
parser.add_argument("--skip_train", action="store_true")
parser.add_argument("--mode", default="render", choices=["render", "time", "view", "all", "pose", "original"])
arguments = parser.parse_args()
model = Path(arguments.model_path)
trained = eval((model / "cfg_args").read_text(), {"Namespace": Namespace})
[iteration] = [int(folder.name.split("_")[1]) for folder in (model / "point_cloud").iterdir()]
train, test = scene.read(Path(trained.source_path))
for kind, views in [("train", train), ("test", test)]:
    if kind == "train" and arguments.skip_train:
        continue
    out = model / kind / f"ours_{iteration}/renders"
    out.mkdir(parents=True)
    for index, (file, _) in enumerate(views):
        copyfile(file, out / f"{index:05}.png")
