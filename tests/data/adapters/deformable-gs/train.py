import argparse
from pathlib import Path

import scene

parser = argparse.ArgumentParser()
parser.add_argument("--source_path", "-s", default="")
parser.add_argument("--model_path", "-m", default="")
parser.add_argument("--resolution", "-r", type=int, default=-1)
parser.add_argument("--eval", action="store_true")
parser.add_argument("--iterations", type=int, default=40_000)
arguments = parser.parse_args()
assert arguments.eval and arguments.resolution == 1
train, test = scene.read(Path(arguments.source_path))
times = [{time for _, time in views} for views in (train, test)]
assert len(times[0]) == len(train) // 6 and not times[0] & times[1], "faces of a frame have one time"
model = Path(arguments.model_path)
(model / f"point_cloud/iteration_{arguments.iterations}").mkdir(parents=True)
(model / "cfg_args").write_text(str(arguments))
