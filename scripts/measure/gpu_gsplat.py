"""A training step of gsplat on six cube faces, beside that of the bench `steps` on an equirectangular image of
the same resolution at the equator: faces of a quarter of its columns.

    python3 gpu_gsplat.py GAUSSIANS WIDTHS STEPS    # lists; a JSON line for each size
    python3 gpu_gsplat.py check                     # the scene and the faces alone; needs numpy

A step renders all six faces in one call, compares them with noise by L1 - a structural term would make it
slower - takes the way back and steps with a fused Adam. Needs gsplat, and torch with a GPU.
"""

import json
import sys
import time

import numpy as np

WARM_UP_STEPS = 5
# Of each face's camera, in the world: x right, y down, z forward.
FORWARD = np.array([[0, 0, 1], [1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, -1, 0], [0, 1, 0]], float)
DOWN = np.array([[0, 1, 0]] * 4 + [[0, 0, 1], [0, 0, -1]], float)


def scene(count):
    """The scene of the bench `steps` (`scene.rs`), by another generator: Gaussians all around, as wide as
    the distance to their neighbours, flattened and turned, 1 to 10 units away."""
    random = np.random.default_rng(1)
    index = np.arange(count)
    y = 1 - (index + 0.5) / count * 2
    angle = 2.399963229728653 * index
    rho = np.sqrt(1 - y * y)
    distance = 10 ** random.uniform(size=count)
    directions = np.stack([rho * np.cos(angle), y, rho * np.sin(angle)], 1)
    spacing = np.sqrt(4 * np.pi / count)
    quaternions = random.normal(size=(count, 4))
    opacities = random.uniform(0.05, 0.95, count)
    return {
        "means": directions * distance[:, None],
        "log_scales": np.log(spacing * distance)[:, None] + 0.6 * random.normal(size=(count, 3)),
        "quaternions": quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True),
        "opacity_logits": np.log(opacities / (1 - opacities)),
        "harmonics": (random.uniform(size=(count, 1, 3)) - 0.5) / 0.28209479177387814,
    }


def cube(width):
    """World-to-camera matrices and intrinsics of faces of `width` / 4 columns."""
    side = width // 4
    matrices = np.tile(np.eye(4), (6, 1, 1))
    matrices[:, :3, :3] = np.stack([np.cross(DOWN, FORWARD), DOWN, FORWARD], 1)
    intrinsics = np.array([[side / 2, 0, side / 2], [0, side / 2, side / 2], [0, 0, 1]])
    return matrices, np.tile(intrinsics, (6, 1, 1)), side


def check():
    """Every Gaussian's centre is in one face, and the faces are rotations."""
    matrices, intrinsics, side = cube(512)
    points = scene(2000)["means"]
    assert np.allclose(np.linalg.det(matrices[:, :3, :3]), 1)
    local = np.einsum("fij,nj->fni", matrices[:, :3, :3], points)
    pixels = np.einsum("fij,fnj->fni", intrinsics, local)
    with np.errstate(divide="ignore"):
        pixels = pixels[..., :2] / pixels[..., 2:]
    inside = (local[..., 2] > 0) & (pixels >= 0).all(2) & (pixels < side).all(2)
    assert (inside.sum(0) == 1).all(), inside.sum(0)
    print(f"each of {len(points)} centres is in one of six faces of {side} pixels")


def measure(count, width, steps):
    import torch
    from gsplat import rasterization

    on_device = {"dtype": torch.float32, "device": "cuda"}
    parameters = {name: torch.tensor(value, **on_device, requires_grad=True) for name, value in scene(count).items()}
    matrices, intrinsics, side = cube(width)
    matrices, intrinsics = torch.tensor(matrices, **on_device), torch.tensor(intrinsics, **on_device)
    target = torch.rand(6, side, side, 3, **on_device)
    adam = torch.optim.Adam(parameters.values(), lr=1e-7, eps=1e-15, fused=True)

    def step():
        image, _, _ = rasterization(
            parameters["means"],
            parameters["quaternions"],
            parameters["log_scales"].exp(),
            parameters["opacity_logits"].sigmoid(),
            parameters["harmonics"],
            matrices,
            intrinsics,
            side,
            side,
            sh_degree=0,
        )
        (image - target).abs().mean().backward()
        adam.step()
        adam.zero_grad(set_to_none=True)

    least = float("inf")
    for number in range(WARM_UP_STEPS + steps):
        torch.cuda.synchronize()
        begun = time.perf_counter()
        step()
        torch.cuda.synchronize()
        if number >= WARM_UP_STEPS:
            least = min(least, time.perf_counter() - begun)
    return least


def main():
    if sys.argv[1:] == ["check"]:
        return check()
    counts, widths, steps = sys.argv[1:4]
    for width in map(int, widths.split(",")):
        for count in map(int, counts.split(",")):
            try:
                seconds = measure(count, width, int(steps))
            except RuntimeError as error:
                print(json.dumps({"gaussians": count, "width": width, "error": str(error).splitlines()[0]}), flush=True)
            else:
                print(json.dumps({"gaussians": count, "width": width, "seconds": seconds}), flush=True)


main()
