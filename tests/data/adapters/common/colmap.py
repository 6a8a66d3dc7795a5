"""COLMAP's text model, as trainers read it."""

import geometry


def read(folder):
    """Returns (model, width, height, parameters) of the one camera, and the names of the images in their order."""
    model = folder / "sparse/0"
    lines = {}
    for name in ["cameras", "images", "points3D"]:
        text = (model / f"{name}.txt").read_text().split("\n")
        lines[name] = [line for line in text if not line.startswith("#")]
    [camera] = [line.split() for line in lines["cameras"] if line]
    points = [line.split() for line in lines["points3D"] if line]
    assert points and all(len(point) >= 8 for point in points), f"{len(points)} points"
    names = []
    for pose, observed in zip(lines["images"][::2], lines["images"][1::2]):
        number, *values = pose.split(" ", 9)
        assert not observed, observed
        geometry.check_rotation(geometry.turn([float(value) for value in values[:4]]))
        assert values[7] == camera[0] and int(number) == len(names) + 1, pose
        names.append(values[8])
    return (camera[1], *map(int, camera[2:4]), [float(value) for value in camera[4:]]), names


def check_faces(folder):
    """Returns the names of the images of a square perspective camera; all must have its size."""
    import images

    (model, width, height, parameters), names = read(folder)
    assert model == "PINHOLE" and width == height, (model, width, height)
    assert all(abs(value - width / 2) < 1e-6 for value in parameters), parameters
    for name in names:
        assert images.read(folder / "images" / name)[:2] == (width, height), name
    return names
