import json
import sys
from pathlib import Path
from shutil import copyfile

import hm3d

settings = dict(word.lstrip("+").split("=", 1) for word in sys.argv[1:])
assert settings["experiment"] == "hm3d" and settings["mode"] == "test"
assert settings["dataset/view_sampler"] == "evaluation"
known = {"encoder.shim_patch_size", "encoder.downscale_factor", "encoder.depth_sampling_type"}
assert {f"model.{name}" for name in known} <= settings.keys()


def paths(name):
    return settings[name].strip("[]").split(",")


shape = json.loads(settings["dataset.image_shape"])
scenes = hm3d.read(
    paths("dataset.roots"), paths("dataset.rgb_roots"), settings["dataset.view_sampler.index_path"], shape
)
for scene, targets in scenes:
    out = Path(settings["output_dir"]) / settings["wandb.name"] / "render" / scene / "color"
    out.mkdir(parents=True)
    for index, file in enumerate(targets):
        copyfile(file, out / f"{index:06}_erp.png")
