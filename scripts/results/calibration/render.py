#!/usr/bin/env python3
"""Renders one clip of the calibration set, before footage, exposure, poses and masks are disturbed.

    python3 render.py GENERATOR CLIP OUT [--threads N]

GENERATOR is a generator of ERP scenes of three scenes with Blender as a Python package (`pip install bpy==4.5.15 numpy
opencv-python-headless OpenEXR`, Python 3.11). Its scenes are changed here: what moves, how glossy surfaces are,
how the camera turns. OUT gets rgb, depth, mask, inst, poses.json and points.ply.
"""

import argparse
import importlib.util
import math
import sys
from pathlib import Path

import numpy as np

from clips import FRAMES, FRAMES_PER_SECOND, WIDTH, clips

SEEDS_TRIED = 8


def generator(path):
    """The generator's module."""
    spec = importlib.util.spec_from_file_location("generator", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def hide(parts):
    """Takes objects out of the render."""
    for part in parts:
        part.hide_render = True


def keep_what_moves(module, motion):
    """Leaves out what the scene itself moves, unless the clip has walkers."""
    registered = module.World.register

    def register(world, parts, name, update):
        if motion in ("walkers", "crowd") or name.startswith("added"):
            registered(world, parts, name, update)
        else:
            hide(parts)

    module.World.register = register


def sway(module):
    """Trees and bushes turn about their feet by some degrees, each in a rhythm of its own."""
    from mathutils import Matrix

    for kind in ("tree", "bush"):
        plant = getattr(module.World, kind)

        def planted(world, x, y, *args, plant=plant, **named):
            before = set(module.bpy.data.objects)
            made = plant(world, x, y, *args, **named)
            parts = [part for part in module.bpy.data.objects if part not in before]
            rest = [part.matrix_world.copy() for part in parts]
            phase, speed, tilt = world.r.uniform(0, 6.3), world.r.uniform(3, 5), world.r.uniform(0.03, 0.06)

            def update(time):
                turn = Matrix.Rotation(tilt * math.sin(speed * time + phase), 4, "X")
                turn = turn @ Matrix.Rotation(tilt * math.sin(1.3 * speed * time + 2 * phase), 4, "Y")
                about = Matrix.Translation((x, y, 0)) @ turn @ Matrix.Translation((-x, -y, 0))
                for part, matrix in zip(parts, rest, strict=True):
                    part.matrix_world = about @ matrix
                return (x, y, 0)

            world.unmasked.append(update)
            return made

        setattr(module.World, kind, planted)


def add_water(module, world):
    """A pool beside the way, whose ripples run: no mask shows it."""
    texture = world.t.noise(256, 256, 6, 6)[..., None] * np.float32([0.5, 0.75, 0.85]) * 1.4
    material = module.mat_image(world.t.load(np.clip(texture, 0, 1)), 0.15, name="water")
    pool = module.box("pool", (3.0, 7.0, 0.04), (2.6, 3.0, 0.22), material, uvm=3.0)
    layer = pool.data.uv_layers[0].data
    still = np.array([corner.uv[:] for corner in layer])

    def update(time):
        for corner, uv in zip(layer, still, strict=True):
            corner.uv = (uv[0] + 0.35 * time, uv[1] + 0.15 * math.sin(2.5 * time))
        pool.data.update()
        return (2.6, 3.0, 0)

    world.unmasked.append(update)


def add_people(module, world, motion):
    """A walker far away, or a crowd."""
    random = np.random.default_rng(world.r.integers(1 << 31))
    if motion == "far-walker":
        bound = 6.0 if module.is_indoors else 15.0
        start = (random.uniform(-2, 2), bound)
        world.person(module.line_path(start, (random.choice([-1.0, 1.0]), 0.1)), "added_far")
    if motion == "crowd":
        for number in range(8):
            start = (random.uniform(-4, 4), random.uniform(-4, 8))
            angle = random.uniform(0, 2 * math.pi)
            speed = random.uniform(0.7, 1.6)
            path = module.line_path(start, (speed * math.cos(angle), speed * math.sin(angle)), wob=0.05)
            world.person(path, f"added_{number}", scale=random.uniform(0.9, 1.05))


def polish(module):
    """Every textured surface reflects as varnish does."""
    of_image = module.mat_image

    def glossy(image, rough=None, emit=0.0, name="m"):
        material = of_image(image, 0.12, emit, name)
        for node in material.node_tree.nodes:
            if node.type == "BSDF_PRINCIPLED":
                node.inputs["Roughness"].default_value = 0.12
                node.inputs["Metallic"].default_value = 0.35
                for link in [link for link in material.node_tree.links if link.to_socket == node.inputs["Roughness"]]:
                    material.node_tree.links.remove(link)
        return material

    module.mat_image = glossy


def turning(camera, motion):
    """The camera's path with fast turns."""

    def path(time):
        place, (yaw, pitch, roll) = camera(time)
        if motion == "yaw":
            yaw += 1.9 * time
        if motion == "tumble":
            pitch += math.radians(22) * math.sin(2.1 * time)
            roll += math.radians(28) * math.sin(1.6 * time + 1.0)
        return place, (yaw, pitch, roll)

    return path


def change(module, clip):
    """Makes the generator's scene that of the clip."""
    keep_what_moves(module, clip.motion)
    module.is_indoors = clip.scene == "hall"
    initialize = module.World.__init__

    def initialized(world, *args):
        initialize(world, *args)
        world.unmasked = []

    module.World.__init__ = initialized
    if clip.motion == "foliage":
        sway(module)
    if clip.surfaces == "glossy":
        polish(module)
    build = module.SCENES[clip.scene]

    def built(world):
        camera = build(world)
        add_people(module, world, clip.motion)
        if clip.motion == "water":
            add_water(module, world)
        path = turning(camera, clip.camera)

        def moved(time):
            for update in world.unmasked:
                update(time)
            return path(time)

        return moved

    module.SCENES[clip.scene] = built


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("generator", type=Path)
    parser.add_argument("clip")
    parser.add_argument("out", type=Path)
    parser.add_argument("--threads", type=int, default=0)
    options = parser.parse_args()
    clip = next((clip for clip in clips() if clip.name == options.clip), None)
    if clip is None:
        raise SystemExit(f"render: there is no clip {options.clip}")
    module = generator(options.generator)
    change(module, clip)
    # The generator draws facades that do not fit their house from some seeds, and stops.
    for seed in range(clip.seed, clip.seed + 100 * SEEDS_TRIED, 100):
        sys.argv = ["generator", "--scene", clip.scene, "--out", str(options.out), "--seed", str(seed)]
        sys.argv += ["--frames", str(FRAMES), "--fps", str(FRAMES_PER_SECOND), "--width", str(WIDTH)]
        sys.argv += ["--spp", "6", "--points", "20000", "--threads", str(options.threads)]
        try:
            return module.main()
        except ValueError as error:
            print(f"{clip.name}: seed {seed}: {error}", flush=True)
    raise SystemExit(f"{clip.name}: no seed of {SEEDS_TRIED} makes a scene")


if __name__ == "__main__":
    main()
