import json
import subprocess
import sys
from pathlib import Path

import geometry
import images

settings = dict(word.lstrip("+").split("=", 1) for word in sys.argv[1:])
assert settings["experiment"] == "pansplat-512-360loc" and settings["mode"] == "test"
assert settings["dataset"] == "insta360" and settings["wandb.mode"] == "disabled"
assert settings["test.save_image"] == "true"
height, width = json.loads(settings["dataset.image_shape"])
sampler = {
    name.rsplit(".", 1)[1]: int(value) for name, value in settings.items() if name.startswith("dataset.view_sampler.")
}
[root] = settings["dataset.roots"].strip("[]").split(",")
out = Path(settings["output_dir"])
for folder in sorted(path for path in Path(root).glob("VID_*") if path.is_dir()):
    lines = (folder / "frame_trajectory.txt").read_text().splitlines()
    rows = [[float(word) for word in line.split()] for line in lines]
    assert all(len(row) == 12 for row in rows)
    for row in rows:
        geometry.check_rotation([row[0:3], row[4:7], row[8:11]])
    assert float((folder / "scale.txt").read_text()) > 0
    # The sampler at test time.
    gap = (sampler["max_distance_between_context_views"] + sampler["min_distance_between_context_views"]) // 2
    most = min(len(rows) - 1, gap)
    assert most >= max(2 * sampler["min_distance_to_context_views"], gap), "Example does not have enough frames!"
    frames = folder / "decoded"
    frames.mkdir()
    command = ["ffmpeg", "-v", "error", "-i", folder / "video.mp4", "-start_number", "0", frames / "%05d.png"]
    subprocess.run(command, check=True)
    assert len(list(frames.iterdir())) == len(rows), "a frame for every pose"
    for time in range(sampler["test_times_per_scene"]):
        left = (len(rows) - gap - 1) * time // max(sampler["test_times_per_scene"] - 1, 1)
        views = out / f"test/None_None/{folder.name}/color/{left:06}_{left + gap:06}"
        views.mkdir(parents=True)
        for index in range(left, left + gap + 1):
            own_width, own_height, lines = images.read(frames / f"{index:05}.png")
            assert (own_width, own_height) == (width, height)
            images.write(views / f"{index:06}.png", lines)
