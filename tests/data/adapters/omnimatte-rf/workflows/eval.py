import json
import sys
from pathlib import Path

import images
from core import loader

found = loader.overrides(sys.argv[1:])
checkpoint = Path(found["checkpoint"])
assert checkpoint.read_text() == "15000"
trained = json.loads((checkpoint.parent.parent / "config.yaml").read_text())
path = Path(trained["dataset.path"])
# The data set is looked for by the last two parts of its path.
path = Path(found["data_root"]) / path.parent.name / path.name
for number, file in enumerate(loader.read(path, loader.sources_of(trained))):
    images.write(Path(found["output"]) / f"composite_rgb/{number:08}.png", images.read(file)[2])
