"""ODGS's layout of OpenMVG's data."""

import json
import os.path

import geometry
import images


def read(folder):
    """Returns (stem, file, key) of the posed views, in order of their stems."""
    views = json.loads((folder / "data_views.json").read_text())["views"]
    files = {view["key"]: view["value"]["ptr_wrapper"]["data"]["filename"] for view in views}
    found = []
    for item in json.loads((folder / "data_extrinsics.json").read_text())["extrinsics"]:
        geometry.check_rotation(item["value"]["rotation"])
        assert len(item["value"]["center"]) == 3
        file = folder / "images" / files[item["key"]]
        width, height, _ = images.read(file)
        assert width == 2 * height, f"{file} is no panorama"
        found.append((os.path.splitext(file.name)[0], file, item["key"]))
    names = [name for _, name in geometry.columns(folder / "pcd.ply")[0]]
    assert names[:3] == ["x", "y", "z"] and names[-3:] == ["red", "green", "blue"], names
    return sorted(found)


def stems(folder, kind):
    return (folder / f"{kind}.txt").read_text().splitlines()
