"""An export in the format openmvg with a split as the data set that OmniGS reads.

    DATA/openMVG/reconstruction/poses.json      images to train on: views, extrinsics and the spherical intrinsic
    DATA/openMVG/reconstruction/colorized.ply   points, whose coordinates must be double
    DATA/openMVG/data_openmvg_test.json         images to render, numbered from 0 in their order

The files are written beside the export's own. Needs nothing but Python.
"""

import argparse
import json
from pathlib import Path

import ply


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("data", type=Path)
    data = parser.parse_args().data
    views = json.loads((data / "data_views.json").read_text())
    extrinsics = json.loads((data / "data_extrinsics.json").read_text())["extrinsics"]
    poses = {item["key"]: item["value"] for item in extrinsics}
    whole = data / "openMVG"
    (whole / "reconstruction").mkdir(parents=True)
    for names, file in [("train.txt", "reconstruction/poses.json"), ("test.txt", "data_openmvg_test.json")]:
        wanted = set((data / names).read_text().split())
        part = dict(views, root_path=str((data / "images").resolve()), views=[], extrinsics=[])
        for view in views["views"]:
            content = view["value"]["ptr_wrapper"]["data"]
            if Path(content["filename"]).stem not in wanted:
                continue
            number = len(part["views"])
            content = dict(content, id_view=number, id_pose=number)
            pointer = dict(view["value"]["ptr_wrapper"], data=content)
            part["views"].append({"key": number, "value": dict(view["value"], ptr_wrapper=pointer)})
            part["extrinsics"].append({"key": number, "value": poses[view["key"]]})
        (whole / file).write_text(json.dumps(part, indent=1))
    columns = [("double", name) for name in "xyz"] + [("uchar", name) for name in ["red", "green", "blue"]]
    ply.write(whole / "reconstruction/colorized.ply", ply.read(data / "pcd.ply"), columns)


if __name__ == "__main__":
    main()
