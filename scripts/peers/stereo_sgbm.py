"""OpenCV's StereoSGBM on rectified pairs of a rendered flight, against its true distances, as JSON.

usage: stereo_sgbm.py RENDERING DENSE.json

RENDERING is what scripts/results/uav_scene.py takes. Every frame of DENSE.json (`omnilife curate dense`) is paired with
the other one from which its middle is seen under about ten degrees, as ours takes up to four; both are turned
so that their rows lie along the line between them. Prints what scripts/results/uav_geometry.py prints of ours.
"""

import json
import sys
import time
from pathlib import Path

import cv2
import numpy as np

ANGLE = np.radians(10)
BLOCK = 5


def main():
    rendering, dense = Path(sys.argv[1]), json.loads(Path(sys.argv[2]).read_text())
    record = json.loads((rendering / "tracks.json").read_text())
    camera, scale = record["camera"], record["depth_scale"]
    width, height, f = camera["width"], camera["height"], camera["fx"]
    u, v = np.meshgrid(np.arange(width) + 0.5 - camera["cx"], np.arange(height) + 0.5 - camera["cy"])
    rays = np.stack([u / f, v / f, np.ones_like(u)], -1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    numbers = [frame["frame"] for frame in dense["frames"]]
    poses = {number: np.array(record["frames"][number]["c2w"]) for number in numbers}
    images = {number: cv2.imread(str(rendering / record["frames"][number]["rgb"]), cv2.IMREAD_GRAYSCALE) for number in numbers}
    truths = {number: cv2.imread(str(rendering / record["frames"][number]["depth"]), cv2.IMREAD_UNCHANGED) / scale
              for number in numbers}
    # Both programs know between which depths to search: ours by the points of the scene.
    known = np.concatenate([truth[truth > 0] for truth in truths.values()])
    near, far = np.quantile(known, 0.001) * 0.8, np.quantile(known, 0.999) * 1.2
    seen = found = close = wrong = 0
    begun = time.process_time()
    for number in numbers:
        distances = of_pair(number, poses, images, rays, f, (near, far))
        truth = truths[number]
        there = truth > 0
        kept = there & (distances > 0)
        error = np.abs(distances / np.where(there, truth, 1) - 1)
        seen, found = seen + there.sum(), found + kept.sum()
        close, wrong = close + (kept & (error < 0.01)).sum(), wrong + (kept & (error > 0.05)).sum()
    print(json.dumps({"frames": len(numbers), "known": found / seen, "within_1_percent": close / seen,
                      "wrong_of_known": wrong / max(found, 1), "cpu_seconds": time.process_time() - begun}, default=float))


def of_pair(number, poses, images, rays, f, depths):
    """Distances along the rays of a frame; 0 where none is found."""
    pose = poses[number]
    middle = pose[:3, 3] + pose[:3, 2] * np.sqrt(depths[0] * depths[1])

    def angle(other):
        a, b = pose[:3, 3] - middle, poses[other][:3, 3] - middle
        return np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1))
    other = min((key for key in poses if key != number), key=lambda key: abs(angle(key) - ANGLE))
    baseline = poses[other][:3, 3] - pose[:3, 3]
    across = baseline / np.linalg.norm(baseline)
    ahead = pose[:3, 2] + poses[other][:3, 2]
    ahead -= (ahead @ across) * across
    ahead /= np.linalg.norm(ahead)
    turned = np.stack([across, np.cross(ahead, across), ahead], 1)
    # The rectified image holds all of the frame.
    own = rays @ pose[:3, :3].T @ turned
    at = f * own[..., :2] / own[..., 2:]
    low, high = np.floor(at.reshape(-1, 2).min(0)), np.ceil(at.reshape(-1, 2).max(0))
    columns, rows = (high - low).astype(int) + 1
    reach = f * np.linalg.norm(baseline)
    least, most = int(reach / depths[1]), int(np.ceil(reach / depths[0]))
    count = max(16, (most - least + 15) // 16 * 16)
    # Columns left of the frame, so that every disparity has its place in both.
    left = least + count
    x, y = np.meshgrid(np.arange(columns + left) + low[0] - left, np.arange(rows) + low[1])
    plane = np.stack([x, y, np.full_like(x, f)], -1) @ turned.T

    def rectified(key):
        seen = plane @ poses[key][:3, :3]
        u = f * seen[..., 0] / seen[..., 2] + images[key].shape[1] / 2 - 0.5
        v = f * seen[..., 1] / seen[..., 2] + images[key].shape[0] / 2 - 0.5
        return cv2.remap(images[key], u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR)
    matcher = cv2.StereoSGBM_create(
        minDisparity=least, numDisparities=count, blockSize=BLOCK, P1=8 * BLOCK ** 2, P2=32 * BLOCK ** 2, disp12MaxDiff=1,
        uniquenessRatio=5, speckleWindowSize=100, speckleRange=2, mode=cv2.STEREO_SGBM_MODE_SGBM)
    disparity = matcher.compute(rectified(number), rectified(other)).astype(np.float32) / 16
    column, row = (at[..., 0] - low[0] + left).astype(np.float32), (at[..., 1] - low[1]).astype(np.float32)
    value = cv2.remap(disparity, column, row, cv2.INTER_NEAREST)
    return np.where(value > max(least, 0), reach / np.maximum(value, 1e-3) / own[..., 2], 0)


if __name__ == "__main__":
    main()
