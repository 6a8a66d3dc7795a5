"""Groups of a sparse-interpolation split as videos in the layout that PanSplat keeps its own in, and their views.

    OUT/VID_000/video.mp4               the frames of a group from its first context view to its last, lossless
    OUT/VID_000/frame_trajectory.txt    their poses as KITTI has them: 3 x 4, camera to world, row by row
    OUT/VID_000/scale.txt               1
    OUT/groups.json                     the frames of each group, for the names of the views

Its sampler takes the first and the last frame of a video for context if the gap between them is that of its
configuration, so that all groups must have one gap. Needs Python and ffmpeg.
"""

import argparse
import json
import struct
import subprocess
import sys
from pathlib import Path


def png_size(path):
    data = path.read_bytes()[:24]
    if data[:8] != b"\x89PNG\r\n\x1a\n":
        raise SystemExit(f"{path} is not a PNG")
    return "{}x{}".format(*struct.unpack(">II", data[16:24]))


def prepare(arguments):
    split = json.loads(arguments.split.read_text())
    groups = [sorted({*group["context"], *group["novel_views"]}) for group in split.get("groups", [])]
    if not groups or split["unposed"]:
        raise SystemExit(f"{arguments.split}: needs groups and the poses of all frames")
    if any(frames != list(range(frames[0], frames[-1] + 1)) for frames in groups):
        raise SystemExit(f"{arguments.split}: has groups with gaps between their frames")
    gaps = {len(frames) - 1 for frames in groups}
    if len(gaps) > 1:
        raise SystemExit(f"{arguments.split}: has groups with gaps of {sorted(gaps)} frames; one was expected")
    data = arguments.data
    views = json.loads((data / "data_views.json").read_text())["views"]
    files = [data / "images" / view["value"]["ptr_wrapper"]["data"]["filename"] for view in views]
    extrinsics = json.loads((data / "data_extrinsics.json").read_text())["extrinsics"]
    poses = {item["key"]: item["value"] for item in extrinsics}
    for number, frames in enumerate(groups):
        folder = arguments.out / f"VID_{number:03}"
        (folder / "frames").mkdir(parents=True)
        rows = []
        for place, frame in enumerate(frames):
            if png_size(files[frame]) != arguments.size:
                raise SystemExit(f"{files[frame]} is not of {arguments.size} pixels, which the weights are for")
            (folder / f"frames/{place:05}.png").symlink_to(files[frame].resolve())
            pose = poses[views[frame]["key"]]
            # World to camera: its columns are the rows of camera to world.
            for column, place_along in enumerate(pose["center"]):
                rows.append([row[column] for row in pose["rotation"]] + [place_along])
        lines = [" ".join(repr(value) for row in rows[i : i + 3] for value in row) for i in range(0, len(rows), 3)]
        (folder / "frame_trajectory.txt").write_text("\n".join(lines) + "\n")
        (folder / "scale.txt").write_text("1\n")
        source = ["-framerate", "30", "-i", folder / "frames/%05d.png"]
        # Every frame by itself, because its reader jumps to frames.
        code = ["-c:v", "libx264rgb", "-qp", "0", "-g", "1"]
        subprocess.run(["ffmpeg", "-v", "error", *source, *code, folder / "video.mp4"], check=True)
    (arguments.out / "groups.json").write_text(json.dumps(groups))


def render(arguments):
    groups = json.loads((arguments.data / "groups.json").read_text())
    gap = len(groups[0]) - 1
    width, height = arguments.size.split("x")
    command = [
        *[sys.executable, "-m", "src.main", "+experiment=pansplat-512-360loc", "mode=test", "dataset=insta360"],
        *[f"dataset.roots=[{arguments.data.resolve()}]", f"dataset.image_shape=[{height},{width}]"],
        f"dataset.view_sampler.min_distance_between_context_views={gap}",
        f"dataset.view_sampler.max_distance_between_context_views={gap}",
        *["dataset.view_sampler.min_distance_to_context_views=0", "dataset.view_sampler.test_times_per_scene=1"],
        f"++model.weights_path={arguments.weights.resolve()}",
        *["test.compute_scores=false", "test.save_image=true", "wandb.mode=disabled"],
        f"output_dir={arguments.out.resolve() / 'run'}",
    ]
    subprocess.run(command, check=True, cwd=arguments.code)
    for number, frames in enumerate(groups):
        left = arguments.out / f"run/test/None_None/VID_{number:03}/color/{0:06}_{gap:06}"
        for place, frame in enumerate(frames):
            view = arguments.out / f"{number:03}/{frame:06}.png"
            view.parent.mkdir(exist_ok=True)
            view.symlink_to((left / f"{place:06}.png").resolve(strict=True))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(required=True)
    for name, run, options in [("prepare", prepare, ["split"]), ("render", render, ["code", "weights"])]:
        command = commands.add_parser(name)
        command.set_defaults(run=run)
        command.add_argument("--size", default="1024x512", help="of the frames")
        for option in ["data", "out", *options]:
            command.add_argument(f"--{option}", type=Path, required=True)
    arguments = parser.parse_args()
    arguments.run(arguments)


if __name__ == "__main__":
    main()
