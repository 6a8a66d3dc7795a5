import argparse
import json
from pathlib import Path
from types import SimpleNamespace

import images
from datasets.driving_dataset import DrivingDataset

cfg = SimpleNamespace(render=SimpleNamespace(fps=10))


def save_videos(folder, files, fps, save_images=False):
    folder.parent.mkdir()
    folder.with_suffix(".mp4").write_text(f"{fps} frames a second")
    for number, file in enumerate(files if save_images else []):
        images.write(folder / f"{number:03}_000.png", images.read(file)[2])


parser = argparse.ArgumentParser()
parser.add_argument("--resume_from", type=Path, required=True)
parser.add_argument("opts", nargs=argparse.REMAINDER)
arguments = parser.parse_args()
run = arguments.resume_from.parent
found, known = json.loads((run / "config.yaml").read_text())
dataset = DrivingDataset(found, known)
save_videos(
    run / f"videos_eval/full_set_{arguments.resume_from.read_text()}_rgbs",
    dataset.files,
    fps=cfg.render.fps,
)
