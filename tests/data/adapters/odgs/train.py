import argparse
from pathlib import Path

import openmvg

parser = argparse.ArgumentParser()
parser.add_argument("--source_path", "-s", type=Path, required=True)
parser.add_argument("--model_path", "-m", type=Path, required=True)
parser.add_argument("--eval", action="store_true")
parser.add_argument("--iterations", type=int, default=30_000)
arguments = parser.parse_args()
assert arguments.eval, "without it the test views are trained on"
views = openmvg.read(arguments.source_path)
train, test = (openmvg.stems(arguments.source_path, kind) for kind in ["train", "test"])
assert sorted(train + test) == [stem for stem, _, _ in views], "every view is in one of the lists"
(arguments.model_path / f"point_cloud/iteration_{arguments.iterations}").mkdir(parents=True)
(arguments.model_path / "cfg_args").write_text(str(arguments.source_path))
