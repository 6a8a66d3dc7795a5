"""Folders with a transforms.json, as ns-process-data of nerfstudio and colmap2nerf.py of instant-ngp write it.

Shapes are those of nerfstudio/process_data/{colmap,metashape,polycam,record3d}_utils.py and of
scripts/colmap2nerf.py; numbers are made here.
"""

import json

import numpy as np

import colmap
import scenes
from scenes import PANORAMA, PERSPECTIVE, Scene

# Axes of a camera: ours have y down and z forward, these y up and z back.
OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
POINTS_FILE = "sparse_pc.ply"


def turned(scene, transform):
    """The same scene in a world that is turned, as the program leaves it."""
    for frame in scene.frames:
        frame.pose = transform @ frame.pose
    scene.points = [(transform[:3, :3] @ place + transform[:3, 3]).tolist() for place in map(np.array, scene.points)]
    return scene


def write_points(folder, scene):
    """Text, as create_ply_from_colmap writes it."""
    fields = [f"property float {axis}" for axis in "xyz"]
    fields += [f"property uint8 {name}" for name in ("red", "green", "blue")]
    head = ["ply", "format ascii 1.0", f"element vertex {len(scene.points)}", *fields, "end_header"]
    rows = [f"{x:8f} {y:8f} {z:8f} 9 8 7" for x, y, z in scene.points]
    (folder / POINTS_FILE).write_text("\n".join(head + rows) + "\n")


def write(folder, scene, file, of_frame=lambda frame: {}, place="images/", points=True):
    scenes.write_images(folder / "images", scene)
    file = dict(file)
    file["frames"] = [
        {
            "file_path": f"{place}{frame.name}",
            "transform_matrix": (frame.pose @ OPENGL).tolist(),
            **of_frame(frame),
        }
        for frame in scene.frames
    ]
    if points:
        write_points(folder, scene)
        file["ply_file_path"] = POINTS_FILE
    else:
        scene.points = []
    (folder / "transforms.json").write_text(json.dumps(file, indent=4))
    return scene


def opencv(model, fisheye=False):
    """Entries of a camera, and the camera of COLMAP that they speak of."""
    taken = colmap.camera(model)
    values = list(colmap.LENSES[model])
    if model in ("SIMPLE_PINHOLE", "SIMPLE_RADIAL"):
        values = [values[0]] + values
    names = ["fl_x", "fl_y", "cx", "cy"] + (["k1", "k2", "k3", "k4"] if fisheye else ["k1", "k2", "p1", "p2"])
    values += [0.0] * (len(names) - len(values))
    entries = {"w": PERSPECTIVE[0], "h": PERSPECTIVE[1], **dict(zip(names, values))}
    return entries, Scene(scenes.frames(), PERSPECTIVE, colmap.projection(taken))


def images_case(model, per_frame=False, fisheye=False, names=range(1, 5)):
    """ns-process-data images: COLMAP's world with y and z exchanged."""

    def build(folder):
        camera, scene = opencv(model, fisheye)
        camera["camera_model"] = "OPENCV_FISHEYE" if fisheye else "OPENCV"
        transform = np.eye(4)[[0, 2, 1, 3]]
        transform[2] *= -1
        turned(scene, transform)
        file = {} if per_frame else dict(camera)
        file["applied_transform"] = transform[:3].tolist()
        entries = camera if per_frame else {}
        return write(folder, scene, file, lambda f: {"colmap_im_id": 9 - f.number, **entries}, "./images/")

    return build


def camera_mask(folder):
    """One mask for all frames, as ns-process-data writes it of a camera that sees itself."""
    camera, scene = opencv("PINHOLE")
    hidden = scenes.hidden(1, PERSPECTIVE)
    scenes.write_png(folder / "masks/mask.png", np.where(hidden, 0, 255).astype(np.uint8))
    for frame in scene.frames:
        frame.hidden = hidden
    camera["camera_model"] = "OPENCV"
    return write(folder, scene, camera, lambda _: {"mask_path": "masks/mask.png"}, "./images/")


def metashape_case(calibrated):
    """ns-process-data metashape of spherical cameras: all entries with every frame."""

    def build(folder):
        scene = Scene(scenes.frames())
        transform = np.eye(4)[[2, 0, 1, 3]]
        turned(scene, transform)
        width, height = PANORAMA
        camera = {"w": width, "h": height}
        if calibrated:
            camera |= {"fl_x": width / 2.0, "fl_y": height, "cx": width / 2.0, "cy": height / 2.0}
        file = {"camera_model": "EQUIRECTANGULAR", "applied_transform": transform[:3].tolist()}
        return write(folder, scene, file, lambda _: camera)

    return build


def metashape_frames(folder):
    """ns-process-data metashape of an ordinary camera: k3 and k4 are 0 and there."""
    camera, scene = opencv("OPENCV")
    file = {"w": camera.pop("w"), "h": camera.pop("h"), **camera, "k3": 0.0, "k4": 0.0}
    return write(folder, scene, {**file, "camera_model": "OPENCV"}, points=False)


def polycam(folder):
    """ns-process-data polycam: a camera with every frame, no world of COLMAP and no points."""
    camera, scene = opencv("PINHOLE")
    camera = {name: camera[name] for name in ("fl_x", "fl_y", "cx", "cy", "w", "h")}
    file = {"camera_model": "OPENCV", "orientation_override": "none"}
    return write(folder, scene, file, lambda _: camera, "./images/", points=False)


def record3d(folder):
    """ns-process-data record3d: matrices of single precision, the principal point in the middle."""
    width, height = PERSPECTIVE
    taken = colmap.camera("SIMPLE_PINHOLE", parameters=[colmap.F, width / 2, height / 2])
    scene = Scene(scenes.frames(), PERSPECTIVE, colmap.projection(taken))
    for frame in scene.frames:
        frame.pose = frame.pose.astype(np.float32).astype(float)
    file = {"fl_x": colmap.F, "fl_y": colmap.F, "cx": width / 2, "cy": height / 2, "w": width, "h": height}
    return write(folder, scene, {**file, "camera_model": "OPENCV"}, points=False)


def instant_ngp_case(model, fisheye=False):
    """colmap2nerf.py: sizes are floats, fields of view stand beside the focal lengths, there are no points."""

    def build(folder):
        camera, scene = opencv(model, fisheye)
        camera["w"], camera["h"] = float(camera["w"]), float(camera["h"])
        angles = {
            f"camera_angle_{axis}": 2 * np.arctan(camera[side] / (2 * camera[focal]))
            for axis, side, focal in (("x", "w", "fl_x"), ("y", "h", "fl_y"))
        }
        camera = {**angles, **camera, "aabb_scale": 32} | ({"is_fisheye": True} if fisheye else {})
        return write(folder, scene, camera, lambda frame: {"sharpness": 40.5 + frame.number}, "./images/", False)

    return build


def angles_alone(folder):
    """The synthetic scenes of NeRF: a field of view and nothing else, names without an extension."""
    _, scene = opencv("SIMPLE_PINHOLE")
    file = {"camera_angle_x": 2 * np.arctan(PERSPECTIVE[0] / (2 * colmap.F))}
    return write(folder, scene, file, points=False)
