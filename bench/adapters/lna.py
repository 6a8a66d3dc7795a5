"""A scene's frames and masks as a clip of Layered Neural Atlases, and the frames of its video.

    OUT/clip/00000.png ...             the frames
    OUT/clip_maskrcnn/00000.png ...    the masks, which stand for those of Mask R-CNN
    OUT/config.json                    its own configuration with size, number of frames and folders of this clip

Needs Python, and ffmpeg for the views.
"""

import argparse
import json
import os
import struct
import subprocess
from pathlib import Path


def png_size(path):
    data = path.read_bytes()[:24]
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise SystemExit(f"{path} is not a PNG")
    return struct.unpack(">II", data[16:24])


def prepare(arguments):
    frames = sorted((arguments.data / "rgb").iterdir())
    clip, masks = arguments.out / "clip", arguments.out / "clip_maskrcnn"
    clip.mkdir(parents=True)
    masks.mkdir()
    for number, frame in enumerate(frames):
        mask = arguments.data / "mask" / f"{frame.stem}.png"
        if not mask.is_file():
            raise SystemExit(f"{frame.name} has no mask of one foreground, without which its layers do not part")
        (clip / f"{number:05}.png").symlink_to(frame.resolve())
        (masks / f"{number:05}.png").symlink_to(mask.resolve())
    width, height = png_size(frames[0])
    config = json.loads((arguments.code / "config/config.json").read_text())
    # Its evaluations are at multiples of evaluate_every, and the last iteration is not counted.
    last = config["iters_num"] // config["evaluate_every"] * config["evaluate_every"]
    config.update(
        maximum_number_of_frames=len(frames),
        resx=width,
        resy=height,
        iters_num=last + 1,
        data_folder=str(clip.resolve()),
        results_folder_name=os.path.relpath(arguments.model, arguments.code),
        load_checkpoint=False,
    )
    (arguments.out / "config.json").write_text(json.dumps(config, indent=4))


def views(arguments):
    videos = sorted(arguments.model.glob("*/[0-9]*/reconstruction_clip.mp4"), key=lambda path: int(path.parent.name))
    if not videos:
        raise SystemExit(f"{arguments.model} has no reconstruction; its code keeps the reason to itself")
    config = json.loads((arguments.data / "config.json").read_text())
    arguments.out.mkdir()
    # Its videos have sides of multiples of 16 pixels.
    scale = f"scale={config['resx']}:{config['resy']}"
    images = ["-vf", scale, "-start_number", "0", arguments.out / "%05d.png"]
    subprocess.run(["ffmpeg", "-v", "error", "-i", videos[-1], *images], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    for name, run in [("prepare", prepare), ("views", views)]:
        command = commands.add_parser(name)
        command.set_defaults(run=run)
        for option in ["data", "model", "out"] + ["code"] * (run is prepare):
            command.add_argument(f"--{option}", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
