import argparse
from pathlib import Path

import images
from core import loader

parser = argparse.ArgumentParser()
parser.add_argument("dataroot", type=Path)
parser.add_argument("--rgb", type=Path, required=True)
found = parser.parse_args()
forward = sorted((found.dataroot / "flow").glob("*.flo"))
backward = sorted((found.dataroot / "flow_backward").glob("*.flo"))
assert len(forward) == len(backward)
frames = sorted(found.rgb.glob("*"))
for number, (one, two, frame) in enumerate(zip(forward, backward, frames)):
    size = loader.read_flow(one)
    assert size == loader.read_flow(two) == images.read(frame)[:2]
    rows = [b"\xff" * (3 * size[0])] * size[1]
    images.write(found.dataroot / f"confidence/{number + 1:04}.png", rows)
