"""The projected footprint, compositing, loss and Adam of omnilife in PyTorch autograd.

A compact reference to compare speed with, not to train with: the equations of
reconstruct/engine/src/{render/project,render/raster,losses/photometric,parameters/adam}, tile by tile so that memory suffices. Footprints
near the poles stay ellipses here (0.4 % of the sphere), so losses agree to a few per mille only.

Reads the folder that `cargo bench --bench steps -- profile --export FOLDER` writes; prints one JSON line.
"""

import argparse
import json
import math
import resource
import time
from pathlib import Path

import torch
import torch.nn.functional as F

TILE = 16


def load(folder):
    meta = json.loads((folder / "scene.json").read_text())

    def array(name, width):
        values = torch.frombuffer(bytearray((folder / f"{name}.f32").read_bytes()), dtype=torch.float32)
        return values.reshape(-1, width).clone()

    parameters = {
        name: array(name, width).requires_grad_()
        for name, width in meta["arrays"].items()
    }
    height, width = meta["height"], meta["width"]
    target = array("target", 3).reshape(height, width, 3)
    rotation = torch.tensor(meta["rotation"]).reshape(3, 3)
    return meta, parameters, target, rotation


def rotation_matrices(raw):
    w, x, y, z = F.normalize(raw, dim=1).unbind(1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]
    return torch.stack(rows, 1).reshape(-1, 3, 3)


def project(parameters, rotation, width, height, near):
    scale = parameters["log_scales"].exp()
    opacity = parameters["opacity_logits"].sigmoid()[:, 0]
    p = parameters["positions"] @ rotation.T
    x, y, z = p.unbind(1)
    d = p.norm(dim=1)
    rho = (x * x + z * z).sqrt().clamp_min(1e-6)
    kx, ky = width / (2 * math.pi), height / math.pi
    u = (torch.atan2(x, z) / (2 * math.pi) + 0.5) * width
    v = (0.5 - torch.atan2(-y, rho) / math.pi) * height
    zero = torch.zeros_like(x)
    j_u = torch.stack([z, zero, -x], 1) * (kx / rho**2)[:, None]
    j_v = torch.stack([-x * y / rho, rho, -y * z / rho], 1) * (ky / d**2)[:, None]
    axes = rotation @ rotation_matrices(parameters["quaternions"]) * scale[:, None, :]
    v_u = (j_u[:, None, :] @ axes)[:, 0]
    v_v = (j_v[:, None, :] @ axes)[:, 0]
    a = (v_u * v_u).sum(1) + 0.3
    b = (v_u * v_v).sum(1)
    c = (v_v * v_v).sum(1) + 0.3
    det = a * c - b * b
    colour = (0.5 + 0.28209479177387814 * parameters["sh_constant"]).clamp_min(0)
    seen = (d > near) & (scale.amax(1) < d) & (opacity >= 1 / 255)
    q_max = 2 * (255 * opacity.detach().clamp_min(1 / 255)).log()
    extent = torch.stack([(q_max * a.detach()).sqrt(), (q_max * c.detach()).sqrt()], 1)
    order = torch.argsort(d.detach())
    order = order[seen[order]]
    fields = torch.stack([u, v, c / det, -b / det, a / det, opacity], 1)
    return fields[order], colour[order], extent[order]


def composite(fields, colour, pixels_u, pixels_v, width):
    u, v, a, b, c, opacity = fields.unbind(1)
    dx = pixels_u[None, :] - u[:, None]
    dx = dx - width * (dx / width).round().detach()
    dy = pixels_v[None, :] - v[:, None]
    q = a[:, None] * dx * dx + 2 * b[:, None] * dx * dy + c[:, None] * dy * dy
    alpha = (opacity[:, None] * (-0.5 * q).exp()).clamp_max(0.99)
    alpha = torch.where(alpha >= 1 / 255, alpha, torch.zeros_like(alpha))
    after = (1 - alpha).cumprod(0)
    alpha = torch.where(after >= 1e-4, alpha, torch.zeros_like(alpha))
    before = torch.cat([torch.ones_like(after[:1]), after[:-1]])
    return (before * alpha).T @ colour


def render(parameters, rotation, width, height, near):
    fields, colour, extent = project(parameters, rotation, width, height, near)
    centre = fields[:, :2].detach()
    rows = []
    for top in range(0, height, TILE):
        middle = top + TILE / 2
        in_row = (centre[:, 1] - middle).abs() <= extent[:, 1] + TILE / 2
        row_fields, row_colour = fields[in_row], colour[in_row]
        row_centre, row_extent = centre[in_row], extent[in_row]
        tiles = []
        for left in range(0, width, TILE):
            distance = row_centre[:, 0] - (left + TILE / 2)
            distance = (distance - width * (distance / width).round()).abs()
            here = distance <= row_extent[:, 0] + TILE / 2
            v, u = torch.meshgrid(
                torch.arange(top, top + TILE) + 0.5,
                torch.arange(left, left + TILE) + 0.5,
                indexing="ij",
            )
            tile = composite(row_fields[here], row_colour[here], u.flatten(), v.flatten(), width)
            tiles.append(tile.reshape(TILE, TILE, 3))
        rows.append(torch.cat(tiles, 1))
    return torch.cat(rows, 0)


def loss_of(image, target, weight):
    taps = torch.exp(-(torch.arange(11) - 5.0) ** 2 / (2 * 1.5**2))
    taps = taps / taps.sum()
    window = (taps[:, None] * taps[None, :]).expand(3, 1, 11, 11)

    def blur(values):
        values = F.pad(values, (5, 5, 0, 0), mode="circular")
        return F.conv2d(F.pad(values, (0, 0, 5, 5)), window, groups=3)

    x, y = (value.permute(2, 0, 1)[None] for value in (image, target))
    mx, my = blur(x), blur(y)
    sx, sy, sxy = blur(x * x) - mx * mx, blur(y * y) - my * my, blur(x * y) - mx * my
    c1, c2 = 0.01**2, 0.03**2
    similarity = (2 * mx * my + c1) * (2 * sxy + c2) / ((mx**2 + my**2 + c1) * (sx + sy + c2))
    return (1 - weight) * (x - y).abs().mean() + weight * (1 - similarity.mean())


def processor_seconds():
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--iterations", type=int, default=3)
    arguments = parser.parse_args()
    meta, parameters, target, rotation = load(arguments.folder)
    optimizer = torch.optim.Adam(parameters.values(), lr=0.0, eps=1e-15)
    wall, processor, losses = [], [], []
    for _ in range(arguments.iterations):
        begun, begun_processor = time.perf_counter(), processor_seconds()
        image = render(parameters, rotation, meta["width"], meta["height"], meta["near"])
        loss = loss_of(image, target, 0.2)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        wall.append(time.perf_counter() - begun)
        processor.append(processor_seconds() - begun_processor)
        losses.append(loss.item())
    print(
        json.dumps(
            {
                "name": f"PyTorch {torch.__version__} autograd",
                "wall_seconds": min(wall),
                "processor_seconds": min(processor),
                "loss": losses[0],
                "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
                "threads": torch.get_num_threads(),
            }
        )
    )


if __name__ == "__main__":
    main()
