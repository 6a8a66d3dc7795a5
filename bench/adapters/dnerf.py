"""An export in the format nerfstudio with cube faces and a split as a data set in D-NeRF's layout, with times.

    DATA/transforms_train.json, transforms_test.json   camera_angle_x, and per face file, time and pose (OpenGL axes)
    DATA/points3d.ply                                  points with normals, which are 0

Times run from 0 to 1 over the clip. The files are written beside the export's own. Needs nothing but Python.
"""

import argparse
import csv
import json
import math
from pathlib import Path

import ply

FLOATS = ["x", "y", "z", "nx", "ny", "nz"]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    data = parser.parse_args().data
    scene = json.loads((data / "transforms.json").read_text())
    if "train_filenames" not in scene:
        parser.error(f"{data} has no split")
    with (data / "times.csv").open(newline="") as table:
        times = {f"images/{row['image']}": float(row["time_seconds"]) for row in csv.DictReader(table)}
    begin, end = min(times.values()), max(times.values())
    poses = {frame["file_path"]: frame["transform_matrix"] for frame in scene["frames"]}
    angle = 2 * math.atan(scene["w"] / (2 * scene["fl_x"]))
    for kind in ["train", "test"]:
        names = scene[f"{kind}_filenames"]
        if any(Path(name).suffix != ".png" for name in names):
            parser.error(f"{data} has images that are not .png")
        frames = [
            {
                "file_path": f"./{name[:-4]}",
                "time": (times[name] - begin) / ((end - begin) or 1.0),
                "transform_matrix": poses[name],
            }
            for name in names
        ]
        text = json.dumps({"camera_angle_x": angle, "frames": frames}, indent=1)
        (data / f"transforms_{kind}.json").write_text(text)
    columns = [("float", name) for name in FLOATS] + [("uchar", name) for name in ["red", "green", "blue"]]
    if not scene.get("ply_file_path"):
        parser.error(f"{data} has no points, and random ones would lie in the unit cube alone")
    ply.write(data / "points3d.ply", ply.read(data / scene["ply_file_path"]), columns)


if __name__ == "__main__":
    main()
