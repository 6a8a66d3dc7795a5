import os
import sys
from pathlib import Path

import images
from core import loader

found = loader.overrides(sys.argv[1:])
assert Path(found["model"]).is_file(), "weights are found from the folder in which it runs"
root, out = Path(found["input"]), Path(found["output"])
files = sorted(os.listdir(root))
width, height, _ = images.read(root / files[0])
for folder in ["flow", "flow_backward"]:
    (out / folder).mkdir(parents=True, exist_ok=True)
    for name in files[:-1]:
        loader.write_flow(out / folder / (os.path.splitext(name)[0] + ".flo"), width, height)
