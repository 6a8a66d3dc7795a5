import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import colmap
import images

parser = argparse.ArgumentParser(allow_abbrev=False)
parser.add_argument("strategy", choices=["default", "mcmc"])
parser.add_argument("--data-dir", type=Path, required=True)
parser.add_argument("--data-factor", type=int, default=4)
parser.add_argument("--test-every", type=int, default=8)
parser.add_argument("--no-normalize-world-space", action="store_true")
parser.add_argument("--max-steps", type=int, default=30_000)
parser.add_argument("--disable-viewer", action="store_true")
parser.add_argument("--result-dir", type=Path, required=True)
parser.add_argument("--ckpt", type=Path)
arguments = parser.parse_args()
assert arguments.no_normalize_world_space, "novel views would lie elsewhere"
assert arguments.disable_viewer, "the viewer waits for ever at the end"
folder = arguments.data_dir / ("images" if arguments.data_factor == 1 else f"images_{arguments.data_factor}")
names = sorted(colmap.check_faces(arguments.data_dir))
# Files and names are matched by their order.
files = sorted(str(file.relative_to(folder)) for file in folder.rglob("*.png"))
assert files == names
held_out = [name for index, name in enumerate(names) if index % arguments.test_every == 0]
given = [name for name in names if name not in held_out]
if arguments.ckpt is None:
    assert held_out == ["!held-out.png"], held_out
    assert given[0].endswith("_0_front.png")
    file = arguments.result_dir / f"ckpts/ckpt_{arguments.max_steps - 1}_rank0.pt"
    file.parent.mkdir(parents=True)
    file.write_text(json.dumps({"step": arguments.max_steps - 1}))
else:
    assert not given
    step = json.loads(arguments.ckpt.read_text())["step"]
    for index, name in enumerate(held_out):
        _, _, rows = images.read(folder / name)
        images.write(arguments.result_dir / f"renders/val_step{step}_{index:04}.png", [row + row for row in rows])
