import json
import sys
from pathlib import Path

from core import loader

assert sys.argv[1:3] == ["--config-name", "train_both"], sys.argv
found = loader.overrides(sys.argv[3:])
assert found["contraction"] in ("ndc", "mipnerf", "none") and float(found["dataset.scale"]) == 1
points = loader.read(Path(found["dataset.path"]), loader.sources_of(found))
assert points
checkpoints = Path(found["output"]) / "checkpoints"
checkpoints.mkdir(parents=True)
(checkpoints.parent / "config.yaml").write_text(json.dumps(found))
(checkpoints / "checkpoint_15000.pth").write_text("15000")
