"""Folders of OpenMVG, as cereal writes its data, of ODGS and Splatter-360, and of ours without a record."""

import json

import numpy as np

import colmap
import scenes
from scenes import PANORAMA, PERSPECTIVE, Scene

FIRST_OF_ITS_KIND = 1 << 31
STATIC_TYPE = 1 << 30


def sfm_data(scene, intrinsics, of_view=lambda at: 0, version="0.3", with_ids=True, unposed=()):
    """Views, intrinsics (name of the type and data) and extrinsics: a type is named with its first object."""
    named, listed = [], []
    for key, (name, data) in enumerate(intrinsics):
        value = {"polymorphic_id": named.index(name) + 1} if name in named else None
        if value is None:
            named.append(name)
            value = {"polymorphic_id": FIRST_OF_ITS_KIND + len(named), "polymorphic_name": name}
        value["ptr_wrapper"] = {"id": FIRST_OF_ITS_KIND + 500 + key, "data": data}
        listed.append({"key": key, "value": value})
    views, poses = [], []
    for at, frame in enumerate(scene.frames):
        data = {"local_path": "", "filename": frame.name, "width": scene.size[0], "height": scene.size[1]}
        data |= {"id_view": at, "id_intrinsic": of_view(at), "id_pose": at + 30}
        value = {"polymorphic_id": STATIC_TYPE} if with_ids else {}
        value["ptr_wrapper"] = {"id": FIRST_OF_ITS_KIND + 1 + at, "data": data}
        views.append({"key": at, "value": value})
        rotation, centre = frame.pose[:3, :3].T.tolist(), frame.pose[:3, 3].tolist()
        if at not in unposed:
            poses.append({"key": at + 30, "value": {"rotation": rotation, "center": centre}})
    lists = {"views": views, "intrinsics": listed, "extrinsics": poses, "structure": [], "control_points": []}
    return {"sfm_data_version": version, "root_path": "/elsewhere/images", **lists}


def sphere(size=PANORAMA):
    return ("spherical", {"value0": {"width": size[0], "height": size[1]}})


def pinhole(model="pinhole", **terms):
    """A pinhole, and the terms of its lens beside it (src/openMVG/cameras/Camera_Pinhole_Radial.cpp, `save`)."""
    width, height = PERSPECTIVE
    data = {"width": width, "height": height, "focal_length": colmap.F, "principal_point": [colmap.CX, colmap.CY]}
    return (model, {**data, **terms})


def openmvg_case(intrinsics, taken=None, **how):
    """`taken` is the camera of COLMAP that the intrinsic speaks of."""

    def build(folder):
        size, project = (PANORAMA, None) if taken is None else (PERSPECTIVE, colmap.projection(taken()))
        scene = Scene(scenes.frames(), size, project, points=[])
        scenes.write_images(folder / "images", scene)
        (folder / "sfm_data.json").write_text(json.dumps(sfm_data(scene, intrinsics, **how), indent=4))
        return scene

    return build


def lens(model, *terms):
    one = model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
    head = [colmap.F, colmap.CX, colmap.CY] if one else [colmap.F, colmap.F, colmap.CX, colmap.CY]
    return lambda: colmap.camera(model, parameters=[*head, *terms])


def odgs(folder):
    """Views and extrinsics apart, no intrinsics, masks beside the images, lists of stems."""
    scene = Scene(scenes.frames(), points=[])
    for frame in scene.frames[1:3]:
        frame.hidden = scenes.hidden(frame.number, scene.size)
        pixels = np.where(frame.hidden, 0, 255).astype(np.uint8)
        scenes.write_png(folder / "images" / f"{frame.name.removesuffix('.png')}_mask.png", pixels)
    scenes.write_images(folder / "images", scene)
    data = sfm_data(scene, [])
    (folder / "data_views.json").write_text(json.dumps({**data, "extrinsics": []}))
    (folder / "data_extrinsics.json").write_text(json.dumps({**data, "views": []}))
    for name, numbers in (("train.txt", (0, 1, 3)), ("test.txt", (2,))):
        stems = [scene.frames[at].name.removesuffix(".png") for at in numbers]
        (folder / name).write_text("".join(f"{stem}\n" for stem in stems))
    return scene


def hm3d_case(numbers=range(4), name="{:05d}.png"):
    """Arrays of single precision in the axes of the panorama: x left, y up."""

    def build(folder):
        scene = Scene(scenes.frames(numbers, name), points=[], tolerance=1e-5)
        scenes.write_images(folder / "pano", scene)
        matrices = np.stack([frame.pose for frame in scene.frames]) @ np.diag([-1.0, -1.0, 1.0, 1.0])
        np.save(folder / "rotation.npy", matrices[:, :3, :3].astype("f4"))
        np.save(folder / "translation.npy", matrices[:, :3, 3].astype("f4"))
        return scene

    return build


def frames_case(numbers, name):
    """Images, masks and a poses.json, without the scene.json of an export."""

    def build(folder):
        scene = Scene(scenes.frames(numbers, name), points=[])
        scenes.write_images(folder / "rgb", scene)
        for frame in scene.frames[1:]:
            frame.hidden = scenes.hidden(frame.number, scene.size)
            scenes.write_png(folder / "mask" / frame.name, np.where(frame.hidden, 255, 0).astype(np.uint8))
        posed = [
            {
                "time_seconds": frame.number / scenes.FRAMES_PER_SECOND,
                "pose": {"rotation_wxyz": quaternion(frame.pose), "centre": frame.pose[:3, 3].tolist()},
                "mask": None,
            }
            for frame in scene.frames
        ]
        camera = {"model": "erp", "width": PANORAMA[0], "height": PANORAMA[1]}
        record = {"schema": "omnilife/poses/2", "scale": "arbitrary", "camera": camera, "frames": posed, "points": None}
        (folder / "poses.json").write_text(json.dumps(record))
        return scene

    return build


def quaternion(pose):
    """(w, x, y, z) of a rotation: the eigenvector of its sum over the elements, after Bar-Itzhack (2000)."""
    (a, b, c), (d, e, f), (g, h, i) = pose[:3, :3]
    matrix = np.array([
        [a - e - i, d + b, g + c, h - f],
        [d + b, e - a - i, h + f, c - g],
        [g + c, h + f, i - a - e, d - b],
        [h - f, c - g, d - b, a + e + i],
    ])
    x, y, z, w = np.linalg.eigh(matrix)[1][:, -1]
    return [w, x, y, z]
