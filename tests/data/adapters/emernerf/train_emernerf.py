import argparse
from pathlib import Path

import waymo
from radiance_fields.video_utils import render_pixels, save_videos

ORIGINAL_SIZE = (1280, 1920)

parser = argparse.ArgumentParser()
parser.add_argument("--config_file", type=Path)
parser.add_argument("--eval_only", action="store_true")
parser.add_argument("--render_video_postfix")
parser.add_argument("--output_root", type=Path)
parser.add_argument("--project", required=True)
parser.add_argument("--run_name", required=True)
parser.add_argument("opts", nargs=argparse.REMAINDER)
arguments = parser.parse_args()
assert arguments.config_file.is_file(), "read from the code's folder"
found = dict(word.split("=", 1) for word in arguments.opts)
assert found["data.pixel_source.num_cams"] == "1" and found["supervision.sky.loss_coef"] == "0"
size = [int(word) for word in found["data.pixel_source.load_size"].strip("[]").split(",")]
files = waymo.read(Path(found["data.data_root"]), size, intrinsics_of=ORIGINAL_SIZE)
run = arguments.output_root / arguments.project / arguments.run_name
run.mkdir(parents=True, exist_ok=True)
if arguments.eval_only:
    step = Path(found["resume_from"]).read_text()
    save_videos(render_pixels(files), run / f"full_videos/{step}_{arguments.render_video_postfix}.mp4")
else:
    (run / "checkpoint_25000.pth").write_text("25000")
