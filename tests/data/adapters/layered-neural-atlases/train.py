import json
import subprocess
import sys
from pathlib import Path

import images

with open(sys.argv[1]) as file:
    config = json.load(file)
data = Path(config["data_folder"])
size = (config["resx"], config["resy"])
assert not config["load_checkpoint"]
frames = sorted([*data.glob("*.jpg"), *data.glob("*.png")])
masks = sorted((data.parent / f"{data.name}_maskrcnn").glob("*.png"))
count = min(config["maximum_number_of_frames"], len(frames))
assert count == len(frames) == len(masks)
for frame, mask in zip(frames, masks):
    assert images.read(frame)[:2] == size
    assert images.read(mask)[2] is not None
flows = data.parent / f"{data.name}_flow"
for one, two in zip(frames, frames[1:]):
    for names in [(one.name, two.name), (two.name, one.name)]:
        assert (flows / "{}_{}.npy".format(*names)).is_file()
results = Path(f"./{config['results_folder_name']}/{data.name}_01_01_2025__00_00_00_000000")
every = config["evaluate_every"]
for iteration in range(every, config["iters_num"], every):
    out = results / f"{iteration:06}"
    out.mkdir(parents=True)
    if iteration + every < config["iters_num"]:
        continue
    source = ["-framerate", "10", "-i", str(data / "%05d.png")]
    video = ["-c:v", "mpeg4", "-q:v", "1", str(out / f"reconstruction_{data.name}.mp4")]
    subprocess.run(["ffmpeg", "-v", "error", *source, *video], check=True)
