"""A method in 150 lines: a network from camera place, time and direction to colour.

It is no good reconstruction (it knows no geometry); it shows everything that a method has to do to be
scored by omnilife: read `scene.json` and `split.json`, learn from the input views alone, and leave
one 8-bit PNG per view at the scored size, named as `method.toml` says.

    light_field.py train  --scene scene.json --split split.json --seed 0 --model model.pt
    light_field.py render --scene scene.json --split split.json --model model.pt --out views
"""

import argparse
import json
import math
from pathlib import Path

import numpy as np
import torch
from PIL import Image

STEPS = 200
BATCH = 4096
FREQUENCIES = 6


def scored_size(scene, protocol):
    """Width and height at which predictions are scored: the scene's, or less where the protocol has a
    largest width."""
    width, height = scene["camera"]["width"], scene["camera"]["height"]
    largest = protocol["largest_width"]
    if largest is None or width <= largest:
        return width, height
    return largest, max(1, math.floor(largest * height / width + 0.5))


def camera_rays(width, height):
    """Unit rays of all pixels in the camera frame (x right, y down, z forward), row by row.

    Pixel (i, j) has its centre at (i + 1/2, j + 1/2); the image centre looks along +z.
    """
    longitude = ((torch.arange(width) + 0.5) / width - 0.5) * 2 * math.pi
    latitude = (0.5 - (torch.arange(height) + 0.5) / height) * math.pi
    latitude, longitude = torch.meshgrid(latitude, longitude, indexing="ij")
    rays = [
        latitude.cos() * longitude.sin(),
        -latitude.sin(),
        latitude.cos() * longitude.cos(),
    ]
    return torch.stack(rays, dim=-1).reshape(-1, 3)


def camera_to_world(pose):
    """Rotation matrix of a pose's quaternion (w, x, y, z)."""
    w, x, y, z = (value / np.linalg.norm(pose["rotation_wxyz"]) for value in pose["rotation_wxyz"])
    return torch.tensor(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ],
        dtype=torch.float32,
    )


class Views:
    """Places, times and rays of a scene's frames, normalized by the input views."""

    def __init__(self, scene_file, split_file):
        self.folder = scene_file.parent
        self.scene = json.loads(scene_file.read_text())
        self.split = json.loads(split_file.read_text())
        self.width, self.height = scored_size(self.scene, self.split["protocol"])
        self.rays = camera_rays(self.width, self.height)
        frames = [self.scene["frames"][frame] for frame in self.split["input_views"]]
        centres = np.array([frame["pose"]["centre"] for frame in frames])
        times = np.array([frame["time_seconds"] for frame in frames])
        self.middle = centres.mean(axis=0)
        self.radius = max(np.linalg.norm(centres - self.middle, axis=1).max(), 1e-9)
        self.begin, self.duration = times.min(), max(np.ptp(times), 1e-9)

    def inputs(self, frame):
        """What the network sees of every pixel of a frame: place (3), time (1), direction (3)."""
        entry = self.scene["frames"][frame]
        place = (np.array(entry["pose"]["centre"]) - self.middle) / self.radius
        time = (entry["time_seconds"] - self.begin) / self.duration
        station = torch.tensor([*place, time], dtype=torch.float32)
        directions = self.rays @ camera_to_world(entry["pose"]).T
        return torch.cat([station.expand(len(directions), 4), directions], dim=1)

    def image(self, frame):
        """The colours of a frame, [0, 1], brought to the scored size by area averaging."""
        file = self.folder / self.scene["frames"][frame]["image"]
        image = Image.open(file).convert("RGB")
        if image.size != (self.width, self.height):
            image = image.resize((self.width, self.height), Image.Resampling.BOX)
        pixels = np.asarray(image, dtype=np.float32) / 255
        return torch.from_numpy(pixels.reshape(-1, 3))


def network():
    inputs = 4 + 3 + 3 * 2 * FREQUENCIES
    layers = [torch.nn.Linear(inputs, 96), torch.nn.ReLU()]
    for _ in range(3):
        layers += [torch.nn.Linear(96, 96), torch.nn.ReLU()]
    return torch.nn.Sequential(*layers, torch.nn.Linear(96, 3), torch.nn.Sigmoid())


def encoded(inputs):
    """Directions also as sines and cosines of growing frequency, so that detail can be learned."""
    directions = inputs[:, 4:]
    waves = [directions * (2.0**power) * math.pi for power in range(FREQUENCIES)]
    waves = [function(wave) for wave in waves for function in (torch.sin, torch.cos)]
    return torch.cat([inputs, *waves], dim=1)


def train(views, seed, model_file):
    # One thread: sums are taken in one order, so that a seed gives the same views every time.
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    frames = views.split["input_views"]
    model = network()
    optimizer = torch.optim.Adam(model.parameters(), lr=2e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
    data = [(views.inputs(frame), views.image(frame)) for frame in frames]
    inputs = torch.cat([pair[0] for pair in data])
    colours = torch.cat([pair[1] for pair in data])
    for step in range(STEPS):
        chosen = torch.randint(len(inputs), (BATCH,))
        loss = (model(encoded(inputs[chosen])) - colours[chosen]).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % 100 == 0:
            print(f"step {step}: {-10 * math.log10(loss.item()):.2f} dB", flush=True)
    torch.save(model.state_dict(), model_file)


def render(views, model_file, out):
    torch.set_num_threads(1)
    model = network()
    model.load_state_dict(torch.load(model_file))
    out.mkdir(parents=True, exist_ok=True)
    with torch.no_grad():
        for frame in sorted(views.split["input_views"] + views.split["novel_views"]):
            colours = model(encoded(views.inputs(frame)))
            pixels = (colours * 255).round().clamp(0, 255).to(torch.uint8)
            pixels = pixels.reshape(views.height, views.width, 3).numpy()
            Image.fromarray(pixels).save(out / f"{frame:06}.png")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("work", choices=["train", "render"])
    parser.add_argument("--scene", type=Path, required=True)
    parser.add_argument("--split", type=Path, required=True)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    views = Views(arguments.scene, arguments.split)
    if arguments.work == "train":
        train(views, arguments.seed, arguments.model)
    else:
        render(views, arguments.model, arguments.out)


if __name__ == "__main__":
    main()
