"""The way back: what an export of a scene says by the rules of the programs that read it.

Models of COLMAP are read by pycolmap. Of nerfstudio the rules are those of its data parser
(nerfstudio/data/dataparsers/nerfstudio_dataparser.py), of OpenMVG those of Camera_Spherical and Camera_Pinhole, of
Splatter-360 those of its loader (src/dataset/dataset_hm3d.py). All give poses from the camera (y down, z forward) to
the world, by the names of images.
"""

import csv
import json

import numpy as np
import pycolmap

from scenes import expect, read_png, rotation


def of_colmap(folder):
    model = pycolmap.Reconstruction(folder / "sparse/0")
    poses, masks = {}, {}
    for image in model.images.values():
        matrix = np.eye(4)
        matrix[:3] = image.cam_from_world().matrix()
        poses[image.name] = np.linalg.inv(matrix)
        mask = folder / "masks" / f"{image.name}.png"
        masks[image.name] = read_png(mask)[..., 0] == 0 if mask.is_file() else None
        expect((folder / "images" / image.name).is_file(), f"no image {image.name}")
    cameras = list(model.cameras.values())
    expect(len(cameras) == 1, "several cameras")
    return poses, masks, [point.xyz for point in model.points3D.values()]


def of_nerfstudio(folder):
    meta = json.loads((folder / "transforms.json").read_text())
    fixed = ["fl_x", "fl_y", "cx", "cy", "h", "w"]
    ordered = sorted(meta["frames"], key=lambda frame: frame["file_path"])
    poses, masks = {}, {}
    for frame in ordered:
        expect(all(name in meta or name in frame for name in fixed), "a camera without all of its entries")
        expect((folder / frame["file_path"]).is_file(), "no image")
        name = frame["file_path"].removeprefix("images/")
        poses[name] = np.array(frame["transform_matrix"]) @ np.diag([1.0, -1.0, -1.0, 1.0])
        if "mask_path" in frame:
            masks[name] = read_png(folder / frame["mask_path"])[..., 0] == 0
    # Masks are those of all frames or of none.
    expect(len(masks) in (0, len(poses)), "masks of some of the frames")
    return poses, masks or dict.fromkeys(poses), None


def of_openmvg(folder):
    views = json.loads((folder / "data_views.json").read_text())["views"]
    listed = json.loads((folder / "data_extrinsics.json").read_text())["extrinsics"]
    by_key = {entry["key"]: entry["value"] for entry in listed}
    poses, masks = {}, {}
    for view in views:
        data = view["value"]["ptr_wrapper"]["data"]
        matrix, name = np.eye(4), data["filename"]
        # x_c = R (x_w - C)
        matrix[:3, :3] = np.array(by_key[data["id_pose"]]["rotation"]).T
        matrix[:3, 3] = by_key[data["id_pose"]]["center"]
        poses[name] = matrix
        mask = folder / "images" / f"{name.rpartition('.')[0]}_mask.png"
        masks[name] = read_png(mask)[..., 0] == 0 if mask.is_file() else None
    return poses, masks, None


def of_hm3d(folder):
    rotations, places = (np.load(folder / f"{name}.npy").astype(float) for name in ("rotation", "translation"))
    poses, masks = {}, {}
    for number, (turn, place) in enumerate(zip(rotations, places)):
        name = f"{number:05d}.png"
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn @ np.diag([-1.0, -1.0, 1.0]), place
        poses[name] = matrix
        mask = folder / "mask" / name
        masks[name] = read_png(mask)[..., 0] > 127 if mask.is_file() else None
    return poses, masks, None


def of_frames(folder):
    """By the table of times, whose rows are in the order of the poses."""
    posed = json.loads((folder / "poses.json").read_text())["frames"]
    poses, masks = {}, {}
    for name, frame in zip(times(folder), posed, strict=True):
        matrix, mask = np.eye(4), folder / "mask" / f"{name.rpartition('.')[0]}.png"
        matrix[:3, :3], matrix[:3, 3] = rotation(frame["pose"]["rotation_wxyz"]), frame["pose"]["centre"]
        poses[name] = matrix
        masks[name] = read_png(mask)[..., 0] > 127 if mask.is_file() else None
    return poses, masks, None


def times(folder):
    """Seconds by the name of the image."""
    with open(folder / "times.csv", newline="") as file:
        return {row["image"]: float(row["time_seconds"]) for row in csv.DictReader(file)}


READERS = {
    "colmap": of_colmap,
    "colmap-binary": of_colmap,
    "nerfstudio": of_nerfstudio,
    "openmvg": of_openmvg,
    "hm3d": of_hm3d,
    "frames": of_frames,
}


def compare(scene, folder, format_):
    """Compares an export with the scene that it was made of, by the readers' rules. Raises Wrong."""
    record = json.loads((scene / "scene.json").read_text())
    poses, masks, points = READERS[format_](folder)
    seconds = times(folder)
    expect(len(poses) == len(record["frames"]), "other frames")
    tolerance = 1e-5 if format_ == "hm3d" else 1e-6
    for number, frame in enumerate(record["frames"]):
        name = f"{number:05d}.png" if format_ == "hm3d" else frame["image"].removeprefix("frames/")
        expect(name in poses, f"no pose of {name}")
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation(frame["pose"]["rotation_wxyz"]), frame["pose"]["centre"]
        expect(np.abs(poses[name] - matrix).max() < tolerance, f"{name} at another pose")
        expect(seconds[name] == frame["time_seconds"], f"{name} at another time")
        mask = read_png(scene / frame["mask"])[..., 0] > 127 if frame["mask"] else None
        found = masks[name]
        same = (found is None or not found.any()) if mask is None else found is not None and (found == mask).all()
        expect(same, f"{name} with another mask")
    if points is not None:
        expect(len(points) == 2, "other points")
