import sys
from pathlib import Path

import colmap

assert sys.argv[1:3] == ["--config-name", "apps/colmap_3dgut.yaml"], sys.argv
settings = dict(word.split("=", 1) for word in sys.argv[3:])
assert settings["dataset.test_split_interval"] == "-1", "otherwise every eighth image is held out"
assert settings["dataset.downsample_factor"] == "1"
data = Path(settings["path"])
assert colmap.check_faces(data)
out = Path(settings["out_dir"]) / settings["experiment_name"] / f"{data.stem}-0101_120000"
out.mkdir(parents=True)
(out / "ckpt_last.pt").write_text(settings["experiment_name"])
