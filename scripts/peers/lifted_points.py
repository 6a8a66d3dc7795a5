"""Normals and radii of lifted panoramas beside Open3D's normals and scipy's neighbours of the same points.

usage: lifted_points.py LIFTED OURS

LIFTED and OURS are what `cargo bench --bench lift` writes and prints. Open3D fits planes to the 30 nearest points of
each, and is told on which side the camera is; cKDTree looks up the nearest four. Both search all views' points
together, where ours looks at a window of the panorama. Prints a Markdown table. Needs Open3D, SciPy and NumPy.
"""

import json
import os
import sys
import time
from pathlib import Path

import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree

NEIGHBOURS = 30


def timed(work):
    begun, begun_cpu = time.monotonic(), time.process_time()
    result = work()
    return result, time.monotonic() - begun, time.process_time() - begun_cpu


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    rows = np.fromfile(sys.argv[1], "<f4").reshape(-1, 10).astype(np.float64)
    ours = json.loads(Path(sys.argv[2]).read_text())
    places, normals, radii, cameras = rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7:]
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(places))
    _, wall, cpu = timed(lambda: cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS)))
    found = np.asarray(cloud.normals)
    away = np.einsum("ij,ij->i", found, cameras - places) < 0
    found = np.where(away[:, None], -found, found)
    degrees = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", found, normals), -1, 1)))

    def nearest():
        distances, _ = cKDTree(places).query(places, k=4, workers=-1)
        return distances[:, 1:].mean(axis=1)
    spacing, wall_tree, cpu_tree = timed(nearest)
    ratio = spacing / radii
    print(f"{ours['samples']:,} samples of {ours['views']} views.\n")
    print("| | wall s | CPU s | beside ours |")
    print("|---|---:|---:|---|")
    print(f"| omnilife: normals, radii, samples | {ours['wall_seconds']:.2f} | {ours['cpu_seconds']:.2f} | |")
    print(f"| Open3D {o3d.__version__}: normals of {NEIGHBOURS} neighbours | {wall:.2f} | {cpu:.2f} | "
          f"{np.median(degrees):.2f} degrees apart (median), {np.percentile(degrees, 90):.1f} (90 %) |")
    print(f"| SciPy's cKDTree: three nearest neighbours | {wall_tree:.2f} | {cpu_tree:.2f} | mean distance over radius "
          f"{np.median(ratio):.2f} (median), {np.percentile(ratio, 10):.2f} to {np.percentile(ratio, 90):.2f} (80 %) |")
    # Open3D's threads outlive the interpreter's own end on some systems.
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
