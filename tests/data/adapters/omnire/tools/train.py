import argparse
import json
from pathlib import Path

import waymo
from datasets.driving_dataset import DrivingDataset

parser = argparse.ArgumentParser()
parser.add_argument("--config_file", type=Path)
parser.add_argument("--output_root", type=Path)
parser.add_argument("--project")
parser.add_argument("--run_name")
parser.add_argument("opts", nargs=argparse.REMAINDER)
arguments = parser.parse_args()
found, known = waymo.settings(arguments.opts), waymo.nodes(arguments.config_file)
assert "Background" in known and "RigidNodes" in known
assert DrivingDataset(found, known).files
run = arguments.output_root / arguments.project / arguments.run_name
run.mkdir(parents=True)
(run / "config.yaml").write_text(json.dumps([found, known]))
(run / "checkpoint_final.pth").write_text("30000")
