"""Open3D's fusion of the panoramas that `cargo bench --bench fusion` fuses: each as six faces of a cube.

usage: open3d_fusion.py SCENE SPLIT VOXEL ROUNDS SURFACE

Points of the surface that was found go to SURFACE (little-endian f32, world coordinates). The faces are sampled beforehand; what is timed is finding the blocks and integrating, the best of the rounds.
Prints one line of JSON. Needs Open3D, NumPy and Pillow.
"""

import json
import os
import resource
import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d
from PIL import Image

# Columns: right, down and forward of a face in the camera's frame (x right, y down, z forward).
FACES = [np.stack([right, np.cross(forward, right), forward], axis=1) for forward, right in [
    ((0, 0, 1), (1, 0, 0)), ((0, 0, -1), (-1, 0, 0)), ((1, 0, 0), (0, 0, -1)), ((-1, 0, 0), (0, 0, 1)),
    ((0, 1, 0), (1, 0, 0)), ((0, -1, 0), (1, 0, 0))]]
TRUNCATION_VOXELS = 4.0


def rotation(wxyz):
    w, x, y, z = np.array(wxyz) / np.linalg.norm(wxyz)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]])


def faces_of(distances, hidden, side):
    """Depths along the axis of each face, 0 where nothing is known."""
    height, width = distances.shape
    across = (np.arange(side) + 0.5) / side * 2 - 1
    x, y = np.meshgrid(across, across)
    in_face = np.stack([x, y, np.ones_like(x)], axis=-1)
    for axes in FACES:
        rays = in_face @ axes.T
        longitude = np.arctan2(rays[..., 0], rays[..., 2])
        latitude = np.arctan2(-rays[..., 1], np.hypot(rays[..., 0], rays[..., 2]))
        column = np.floor((longitude / (2 * np.pi) + 0.5) * width).astype(int) % width
        row = np.clip(np.floor((0.5 - latitude / np.pi) * height).astype(int), 0, height - 1)
        depth = distances[row, column] / np.linalg.norm(in_face, axis=-1)
        yield axes, np.where(hidden[row, column], 0, depth).astype(np.float32)


def distances_of(file, unit):
    image = np.load(file) if file.suffix == ".npy" else np.asarray(Image.open(file))
    return np.nan_to_num(image.astype(np.float64) * unit)


def views(scene_path, split_path):
    """Rotation, centre, distances and what is hidden of every given view, on the coarser of the grids of image and
    distances, as omnilife fuses them."""
    scene, split = json.loads(scene_path.read_text()), json.loads(split_path.read_text())
    camera = scene["camera"]
    for number in split["input_views"]:
        frame = scene["frames"][number]
        if "depth_prior" not in frame:
            sys.exit(f"open3d_fusion: {scene_path}: frame {number} has no distances")
        prior = frame["depth_prior"]
        distances = distances_of(scene_path.parent / prior["file"], prior["unit"])
        width, height = min(camera["width"], distances.shape[1]), min(camera["height"], distances.shape[0])
        rows = ((np.arange(height) + 0.5) * distances.shape[0] / height).astype(int)
        columns = ((np.arange(width) + 0.5) * distances.shape[1] / width).astype(int)
        distances = distances[np.ix_(rows, columns)]
        hidden = np.zeros(distances.shape, bool)
        if frame.get("mask"):
            image = Image.open(scene_path.parent / frame["mask"]).convert("L")
            hidden = np.asarray(image.resize((width, height), Image.NEAREST)) >= 128
        yield rotation(frame["pose"]["rotation_wxyz"]), np.array(frame["pose"]["centre"]), distances, hidden


def integrate(images, intrinsic, voxel, farthest):
    grid = o3d.t.geometry.VoxelBlockGrid(("tsdf", "weight"), (o3d.core.float32, o3d.core.float32), ((1), (1)),
                                         voxel, 16, 20_000)
    for image, extrinsic in images:
        blocks = grid.compute_unique_block_coordinates(image, intrinsic, extrinsic, 1.0, farthest, TRUNCATION_VOXELS)
        grid.integrate(blocks, image, intrinsic, extrinsic, 1.0, farthest, TRUNCATION_VOXELS)
    return grid


def main():
    if len(sys.argv) != 6:
        sys.exit(__doc__)
    scene, split, voxel, rounds = Path(sys.argv[1]), Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
    images, farthest, size, count = [], 0.0, None, 0
    for turn, centre, distances, hidden in views(scene, split):
        count += 1
        size = distances.shape[::-1]
        farthest = max(farthest, float(distances.max()) + 1)
        # As many pixels over the sphere: a face's middle is as fine as the panorama's equator.
        side = size[0] // 4
        for axes, depth in faces_of(distances, hidden, side):
            to_world = np.eye(4)
            to_world[:3, :3], to_world[:3, 3] = turn @ axes, centre
            images.append((o3d.t.geometry.Image(o3d.core.Tensor(depth)), o3d.core.Tensor(np.linalg.inv(to_world))))
    if not images:
        sys.exit(f"open3d_fusion: {split} gives no views")
    intrinsic = o3d.core.Tensor([[side / 2, 0, side / 2 - 0.5], [0, side / 2, side / 2 - 0.5], [0, 0, 1.0]])
    wall = processor = float("inf")
    for _ in range(rounds):
        begun, begun_processor = time.monotonic(), time.process_time()
        grid = integrate(images, intrinsic, voxel, farthest)
        wall = min(wall, time.monotonic() - begun)
        processor = min(processor, time.process_time() - begun_processor)
    blocks = int(grid.hashmap().size())
    # Voxels that were seen once have a distance too.
    grid.extract_point_cloud(1.0).point.positions.numpy().astype("<f4").tofile(sys.argv[5])
    print(json.dumps({"name": f"Open3D {o3d.__version__}", "views": count, "size": size, "wall_seconds": wall,
                      "cpu_seconds": processor, "field_bytes": blocks * 16**3 * 8,
                      "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024}))
    # Its threads outlive the interpreter's own end on some systems.
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
