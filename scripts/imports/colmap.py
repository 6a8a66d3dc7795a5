"""Folders of COLMAP, written by pycolmap, and by hand where other programs write its form."""

import numpy as np
import pycolmap

import scenes
from scenes import PANORAMA, PERSPECTIVE, Scene

F, FX, FY, CX, CY = 42.0, 43.0, 41.5, 29.5, 20.25
ONE, TWO = [F, CX, CY], [FX, FY, CX, CY]
# Lenses as moderate as those of real cameras; fisheyes have the focal length of theirs.
LENSES = {
    "SIMPLE_PINHOLE": ONE,
    "PINHOLE": TWO,
    "SIMPLE_RADIAL": ONE + [-0.08],
    "RADIAL": ONE + [-0.1, 0.02],
    "OPENCV": TWO + [-0.1, 0.02, 0.001, -0.002],
    "OPENCV_FISHEYE": TWO + [-0.03, 0.01, -0.004, 0.0005],
    "FULL_OPENCV": TWO + [0.2, -0.03, 0.001, -0.002, 0.004, 0.3, 0.01, 0.002],
    "FOV": TWO + [0.9],
    "SIMPLE_RADIAL_FISHEYE": ONE + [-0.04],
    "RADIAL_FISHEYE": ONE + [-0.04, 0.006],
    "THIN_PRISM_FISHEYE": TWO + [-0.03, 0.01, 0.001, -0.0015, -0.004, 0.0005, 0.002, -0.001],
    "RAD_TAN_THIN_PRISM_FISHEYE": TWO
    + [-0.03, 0.01, -0.004, 0.001, 0.0002, -0.00003, 0.001, -0.0015, 0.002, -0.0004, -0.001, 0.0003],
    "SIMPLE_DIVISION": ONE + [-0.12],
    "DIVISION": TWO + [-0.15],
    "SIMPLE_FISHEYE": ONE,
    "FISHEYE": TWO,
    "EUCM": TWO + [0.55, 1.1],
}


def camera(model="EQUIRECTANGULAR", id_=1, parameters=None):
    size = PANORAMA if model == "EQUIRECTANGULAR" else PERSPECTIVE
    parameters = parameters or (list(PANORAMA) if model == "EQUIRECTANGULAR" else LENSES[model])
    return pycolmap.Camera(
        model=model, width=size[0], height=size[1], params=[float(value) for value in parameters], camera_id=id_
    )


def projection(taken):
    """Pixels of directions, as COLMAP has them."""
    return lambda ray: taken.img_from_cam(np.asarray(ray))


def cam_from_world(pose):
    return pycolmap.Rigid3d(np.linalg.inv(pose)[:3])


def reconstruction(scene, cameras, ids=None, of_frame=lambda at: 0):
    """A model of these frames; `of_frame` gives the place of a frame's camera among `cameras`."""
    model = pycolmap.Reconstruction()
    for one in cameras:
        model.add_camera_with_trivial_rig(one)
    for at, frame in enumerate(scene.frames):
        image = pycolmap.Image(
            name=frame.name, camera_id=cameras[of_frame(at)].camera_id, image_id=ids[at] if ids else at + 1
        )
        model.add_image_with_trivial_frame(image, cam_from_world(frame.pose))
    add_points(model, scene)
    return model


def add_points(model, scene):
    for place in scene.points:
        model.add_point3D(np.array(place), pycolmap.Track(), np.array([9, 8, 7], np.uint8))


def rig(scene, cameras, faces):
    """A model whose frames were taken by a rig: `faces` are poses of its cameras in the rig, by the camera."""
    model, parts = pycolmap.Reconstruction(), pycolmap.Rig(rig_id=1)
    for at, one in enumerate(cameras):
        model.add_camera(one)
        if at == 0:
            parts.add_ref_sensor(one.sensor_id)
        else:
            parts.add_sensor(one.sensor_id, pycolmap.Rigid3d(np.linalg.inv(faces[at])[:3]))
    model.add_rig(parts)
    id_ = 0
    for moment in range(len(scene.frames) // len(cameras)):
        frame = pycolmap.Frame(frame_id=moment + 1, rig_id=1)
        together = scene.frames[moment * len(cameras) : (moment + 1) * len(cameras)]
        images = []
        for one, taken in zip(cameras, together):
            id_ += 1
            images.append(pycolmap.Image(name=taken.name, camera_id=one.camera_id, image_id=id_))
            images[-1].frame_id = frame.frame_id
            frame.add_data_id(images[-1].data_id)
        frame.rig_from_world = cam_from_world(together[0].pose)
        model.add_frame(frame)
        for image in images:
            model.add_image(image)
    add_points(model, scene)
    return model


def write(folder, scene, model, binary, place="sparse/0"):
    """Writes a model and its images."""
    scenes.write_images(folder / "images", scene)
    (folder / place).mkdir(parents=True, exist_ok=True)
    (model.write_binary if binary else model.write_text)(folder / place)
    return scene


def write_masks(folder, scene):
    """Masks in COLMAP's convention: black is not looked at."""
    for frame in scene.frames:
        if frame.number % 2:
            frame.hidden = scenes.hidden(frame.number, scene.size)
            pixels = np.where(frame.hidden, 0, 255).astype(np.uint8)
            scenes.write_png(folder / "masks" / f"{frame.name}.png", pixels)


def lens_case(model, binary):
    def build(folder):
        taken = camera(model)
        scene = Scene(scenes.frames(), PERSPECTIVE, projection(taken))
        return write(folder, scene, reconstruction(scene, [taken]), binary)

    return build


def sphere_case(binary, numbers=range(4), name="frame_{:05d}.png", ids=None, masks=False, cameras=None, of_frame=None):
    def build(folder):
        scene = Scene(scenes.frames(numbers, name))
        if masks:
            write_masks(folder, scene)
        taken = cameras() if cameras else [camera()]
        model = reconstruction(scene, taken, ids, of_frame or (lambda at: 0))
        return write(folder, scene, model, binary)

    return build


def equal_cameras():
    return [camera(id_=id_) for id_ in (3, 8)]


def unused_cameras():
    """All models that are in no image, and the panoramas'."""
    return [camera(id_=90)] + [camera(model, 2 + at) for at, model in enumerate(LENSES)]


def several_models(folder):
    scene = Scene(scenes.frames(range(5)))
    small = Scene(scenes.frames(range(5, 7)))
    write(folder, small, reconstruction(small, [camera()]), True, "sparse/0")
    return write(folder, scene, reconstruction(scene, [camera()]), True, "sparse/1")


def partly_registered(folder):
    whole = Scene(scenes.frames(range(6)))
    scene = Scene([frame for frame in whole.frames if frame.number not in (1, 4)])
    scenes.write_images(folder / "images", whole)
    return write(folder, scene, reconstruction(scene, [camera()]), True)


def rig_case(binary):
    """Two cameras back to back, as a rig: both views of a moment share its time."""

    def build(folder):
        back = np.diag([-1.0, 1.0, -1.0, 1.0])
        frames = []
        for moment in range(3):
            for side, (name, turn) in enumerate([("left", np.eye(4)), ("right", back)]):
                frame = scenes.Frame(2 * moment + side, f"{name}/{moment:03d}.png", scenes.pose(moment) @ turn)
                frame.seconds = moment / scenes.FRAMES_PER_SECOND
                frames.append(frame)
        cameras = [camera("PINHOLE", 1), camera("PINHOLE", 2)]
        scene = Scene(frames, PERSPECTIVE, projection(cameras[0]))
        return write(folder, scene, rig(scene, cameras, [np.eye(4), back]), binary)

    return build


def two_lenses(folder):
    scene = Scene(scenes.frames(), PERSPECTIVE)
    cameras = [camera("SIMPLE_RADIAL", 1), camera("SIMPLE_RADIAL", 2, ONE + [-0.2])]
    return write(folder, scene, reconstruction(scene, cameras, of_frame=lambda at: at % 2), True)


def fork(line):
    """The text model of a fork that names its panoramas otherwise."""

    def build(folder):
        scene = Scene(scenes.frames())
        write(folder, scene, reconstruction(scene, [camera()]), False)
        (folder / "sparse/0/cameras.txt").write_text(f"# Camera list\n{line}\n")
        return scene

    return build
