"""Perspective faces of panoramas: a rig of cameras that share a centre and whose rotations are known.

Camera axes are x right, y down, z forward; a panorama has +z at its centre. Every direction belongs to the
face whose axis is nearest, so that a feature of the sphere is found once.
"""

from pathlib import Path

import numpy as np
import pycolmap

# Yaws to the right and pitches upwards, in degrees; neighbouring faces overlap.
# The layout of COLMAP's panorama_sfm: poles are outside. The upper row stands between the faces of the others.
ROWS = tuple(
    (yaw + (45.0 if pitch > 0 else 0.0), pitch) for pitch in (-35.0, 0.0, 35.0) for yaw in (0.0, 90.0, 180.0, 270.0)
)
# A cube whose faces reach beyond its edges.
CUBE = ((0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (270.0, 0.0), (0.0, -90.0), (0.0, 90.0))


def frame_name(image):
    """Returns the name of the frame of a face, or of a frame itself."""
    return image.split("/", 1)[1] if image.startswith("face") and "/" in image else image


def rotations(layout):
    """Returns face-from-panorama rotations, N x 3 x 3."""
    every = []
    for yaw, pitch in np.radians(layout):
        forward = np.array([np.cos(pitch) * np.sin(yaw), -np.sin(pitch), np.cos(pitch) * np.cos(yaw)])
        right = np.array([np.cos(yaw), 0.0, -np.sin(yaw)])
        every.append(np.stack([right, np.cross(forward, right), forward]))
    return np.array(every)


def panorama_rays(pixels, width, height):
    """Returns unit rays of pixels of a panorama, N x 2 to N x 3."""
    longitude = 2 * np.pi * (pixels[:, 0] / width - 0.5)
    latitude = np.pi * (0.5 - pixels[:, 1] / height)
    level = np.cos(latitude)
    return np.stack([level * np.sin(longitude), -np.sin(latitude), level * np.cos(longitude)], 1)


def panorama_pixels(rays, width, height):
    """Returns pixels of rays of any length in a panorama, N x 3 to N x 2."""
    longitude = np.arctan2(rays[:, 0], rays[:, 2])
    latitude = -np.arctan2(rays[:, 1], np.hypot(rays[:, 0], rays[:, 2]))
    return np.stack([(0.5 + longitude / (2 * np.pi)) * width, (0.5 - latitude / np.pi) * height], 1)


def unit(rays):
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)


def bilinear(image, pixels):
    """Samples a panorama at pixels whose centres are at halves; it goes on around the sphere, not over the poles."""
    height, width = image.shape[:2]
    x, y = pixels[:, 0] - 0.5, np.clip(pixels[:, 1] - 0.5, 0, height - 1)
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    over_x, over_y = (x - left)[:, None], (y - top)[:, None]
    below, columns = np.minimum(top + 1, height - 1), (left % width, (left + 1) % width)
    upper = image[top, columns[0]] * (1 - over_x) + image[top, columns[1]] * over_x
    lower = image[below, columns[0]] * (1 - over_x) + image[below, columns[1]] * over_x
    return np.rint(upper * (1 - over_y) + lower * over_y).astype(np.uint8)


class Faces:
    """The faces of all frames of a sequence, in folders below --out."""

    def __init__(self, out, frames, layout, field_of_view):
        self.count = len(layout)
        self.images, self.masks = out / "faces", out / "face-masks"
        self.names = sorted(path.name for path in frames.iterdir() if path.is_file())
        if not self.names:
            raise SystemExit("there are no frames")
        first = read_colours(frames / self.names[0])
        self.height, self.width = first.shape[:2]
        # As many pixels across as the panorama's equator has for the field of view.
        self.size = int(round(self.width * field_of_view / 360))
        focal = self.size / (2 * np.tan(np.radians(field_of_view / 2)))
        self.camera = pycolmap.Camera.create_from_model_id(
            camera_id=0,
            model=pycolmap.CameraModelId.SIMPLE_PINHOLE,
            focal_length=focal,
            width=self.size,
            height=self.size,
        )
        self.camera.has_prior_focal_length = True
        self.rotations = rotations(layout)
        centres = np.arange(self.size) + 0.5
        grid = np.stack(np.meshgrid(centres, centres), -1).reshape(-1, 2)
        rays = self.face_rays(grid)
        self.pixels = [panorama_pixels(rays @ rotation, self.width, self.height) for rotation in self.rotations]
        nearest = [np.argmax((rays @ rotation) @ self.rotations[:, 2].T, 1) for rotation in self.rotations]
        self.own = [near == index for index, near in enumerate(nearest)]

    def face_rays(self, pixels):
        """Returns unit rays of pixels of a face, in its camera."""
        middle = self.size / 2
        plane = (pixels[:, :2] - middle) / self.camera.focal_length
        return unit(np.concatenate([plane, np.ones((len(plane), 1))], 1))

    def rays(self, image, pixels):
        """Returns unit rays in the panorama of pixels of a face by its name."""
        return self.face_rays(pixels) @ self.rotations[self.face_of(image)]

    @staticmethod
    def folder(index):
        return f"face{index:02d}"

    @staticmethod
    def face_of(image):
        return int(image[4:6])

    def render(self, frames, masks):
        """Writes the faces of all frames, and masks of the pixels that give features."""
        for index in range(self.count):
            (self.images / self.folder(index)).mkdir(parents=True)
            (self.masks / self.folder(index)).mkdir(parents=True)
        for name in self.names:
            colours = read_colours(frames / name)
            if colours.shape[:2] != (self.height, self.width):
                raise SystemExit(f"{name} has another size than {self.names[0]}")
            usable = read_mask(masks, name)
            for index in range(self.count):
                face = bilinear(colours, self.pixels[index]).reshape(self.size, self.size, 3)
                write(face, self.images / self.folder(index) / name)
                kept = self.own[index] & self.mask_of(usable, index)
                grey = (kept.reshape(self.size, self.size) * 255).astype(np.uint8)
                write(grey, self.masks / self.folder(index) / f"{name}.png")

    def mask_of(self, usable, index):
        if usable is None:
            return True
        height, width = usable.shape
        scale = np.array([width / self.width, height / self.height])
        at = np.floor(self.pixels[index] * scale).astype(int)
        return usable[np.clip(at[:, 1], 0, height - 1), at[:, 0] % width]

    def config(self):
        """Returns the rig: the first face is its reference, and all share its centre."""
        cameras = []
        for index in range(self.count):
            relative = self.rotations[index] @ self.rotations[0].T
            pose = pycolmap.Rigid3d(pycolmap.Rotation3d(relative), np.zeros((3, 1)))
            cameras.append(
                pycolmap.RigConfigCamera(
                    ref_sensor=index == 0,
                    image_prefix=f"{self.folder(index)}/",
                    cam_from_rig=None if index == 0 else pose,
                    camera=self.camera,
                )
            )
        return pycolmap.RigConfig(cameras=cameras)

    def put_back(self, on_faces, database):
        """Writes a database of panoramas with the features of their faces."""
        with pycolmap.Database.open(on_faces) as source, pycolmap.Database.open(database) as sphere:
            camera = pycolmap.Camera(
                model="EQUIRECTANGULAR", width=self.width, height=self.height, params=[self.width, self.height]
            )
            camera.camera_id = sphere.write_camera(camera)
            rig = pycolmap.Rig()
            rig.add_ref_sensor(camera.sensor_id)
            rig.rig_id = sphere.write_rig(rig)
            of_frame = {}
            for image in source.read_all_images():
                of_frame.setdefault(frame_name(image.name), []).append(image)
            for name in self.names:
                keypoints, descriptors = self.gather(source, of_frame.get(name, []))
                image = pycolmap.Image(name=name, camera_id=camera.camera_id)
                image.image_id = sphere.write_image(image)
                frame = pycolmap.Frame()
                frame.rig_id = rig.rig_id
                frame.add_data_id(image.data_id)
                sphere.write_frame(frame)
                sphere.write_keypoints(image.image_id, keypoints)
                sphere.write_descriptors(image.image_id, descriptors)

    def gather(self, source, images):
        """Returns keypoints on the panorama and descriptors of all faces of a frame."""
        keypoints, data, kind = [np.zeros((0, 2), np.float32)], [np.zeros((0, 128), np.uint8)], None
        for image in images:
            on_face, found = source.read_keypoints(image.image_id), source.read_descriptors(image.image_id)
            kind = found.type
            if len(on_face):
                rays = self.rays(image.name, on_face.astype(np.float64))
                keypoints.append(panorama_pixels(rays, self.width, self.height).astype(np.float32))
                data.append(found.data)
        return np.concatenate(keypoints), pycolmap.FeatureDescriptors(type=kind, data=np.concatenate(data))

    def write_text(self, model, folder):
        """Writes a model of faces as a text model of panoramas."""
        images, place = {}, {}
        for image in model.images.values():
            if not image.has_pose:
                continue
            name = frame_name(image.name)
            pose = image.cam_from_world()
            turn = self.rotations[self.face_of(image.name)].T
            whole = (turn @ pose.rotation.matrix(), turn @ pose.translation)
            entry = images.setdefault(name, dict(id=len(images) + 1, pose=whole, points=[]))
            if not image.points2D:
                continue
            pixels = np.array([point.xy for point in image.points2D])
            on_sphere = panorama_pixels(self.rays(image.name, pixels), self.width, self.height)
            for index, (point, pixel) in enumerate(zip(image.points2D, on_sphere)):
                place[image.image_id, index] = entry["id"], len(entry["points"])
                entry["points"].append((pixel[0], pixel[1], point.point3D_id if point.has_point3D() else -1))
        sphere = f"1 EQUIRECTANGULAR {self.width} {self.height} {self.width} {self.height}\n"
        (folder / "cameras.txt").write_text(sphere)
        with (folder / "images.txt").open("w") as out:
            for name, entry in images.items():
                rotation, translation = entry["pose"]
                x, y, z, w = pycolmap.Rotation3d(rotation).quat
                numbers = " ".join(repr(float(value)) for value in (w, x, y, z, *translation))
                points = " ".join(f"{float(x)!r} {float(y)!r} {id}" for x, y, id in entry["points"])
                out.write(f"{entry['id']} {numbers} 1 {name}\n{points}\n")
        with (folder / "points3D.txt").open("w") as out:
            for id, point in model.points3D.items():
                numbers = " ".join(repr(float(value)) for value in point.xyz)
                colour = " ".join(str(int(value)) for value in point.color)
                seen = [place[part.image_id, part.point2D_idx] for part in point.track.elements]
                track = " ".join(f"{image} {index}" for image, index in seen)
                out.write(f"{id} {numbers} {colour} {float(point.error)!r} {track}\n")


def rays_of(rig):
    """Returns a function of a camera, the name of its image and pixels to unit rays in the panorama."""
    if rig is not None:
        return lambda camera, image, pixels: rig.rays(image, pixels)
    return lambda camera, image, pixels: panorama_rays(pixels, camera.width, camera.height)


def read_colours(path):
    bitmap = pycolmap.Bitmap.read(path, as_rgb=True)
    if bitmap is None:
        raise SystemExit(f"{Path(path).name} cannot be read")
    return bitmap.to_array()


def read_mask(masks, name):
    """Returns true where features of a frame are used; nothing if it has no mask."""
    path = masks and masks / f"{name}.png"
    if not path or not path.exists():
        return None
    bitmap = pycolmap.Bitmap.read(path, as_rgb=False)
    if bitmap is None:
        raise SystemExit(f"the mask of {name} cannot be read")
    return bitmap.to_array().reshape(bitmap.height, bitmap.width) > 0


def write(pixels, path):
    if not pycolmap.Bitmap.from_array(pixels).write(path):
        raise SystemExit(f"{Path(path).name} cannot be written")
