"""A COLMAP export with a split as two data sets, for trainers that hold every n-th image out.

    OUT/given/    images to train on, behind a second copy of the first one, which such trainers hold out (--sacrifice)
    OUT/novel/    images to render

Names are NNNNNN_N_FACE.png: order by name is order of the views, and of the faces of a view. Needs nothing but Python.
"""

import argparse
from pathlib import Path

FACES = ["front", "right", "back", "left", "up", "down"]


def images_of(model):
    """Returns (pose and camera, name) of every image of a text model."""
    lines = (model / "images.txt").read_text().split("\n")
    rows = [line for line in lines[::2] if line and not line.startswith("#")]
    parts = [row.split(" ", 9) for row in rows]
    return [(part[1:9], part[9]) for part in parts]


def numbered(images, inputs, check):
    """Returns (new name, pose and camera, old name), views in their order and faces within them."""
    views, result = {}, []
    for pose, name in images:
        if (name in inputs) == (check is None):
            views.setdefault(Path(name).name, {})[Path(name).parent.name] = (pose, name)
    for index, (view, faces) in enumerate(views.items()):
        if check is not None and set(faces) != set(FACES):
            raise SystemExit(f"{view} of {check} has the faces {', '.join(faces)}: views must be whole")
        for number, face in enumerate(FACES):
            if face in faces:
                pose, name = faces[face]
                result.append((f"{index:06}_{number}_{face}.png", pose, name))
    return result


def write(source, out, images):
    model = out / "sparse/0"
    model.mkdir(parents=True)
    (out / "images").mkdir()
    for name in ["cameras.txt", "points3D.txt"]:
        (model / name).symlink_to((source / "sparse/0" / name).resolve())
    lines = []
    for number, (name, pose, old) in enumerate(images, start=1):
        (out / "images" / name).symlink_to((source / "images" / old).resolve())
        lines += [f"{number} {' '.join(pose)} {name}", ""]
    (model / "images.txt").write_text("\n".join(lines) + "\n")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="export in the format colmap, with cube faces")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--sacrifice", action="store_true")
    arguments = parser.parse_args()
    images = images_of(arguments.data / "sparse/0")
    inputs = set((arguments.data / "train.txt").read_text().split("\n"))
    given = numbered(images, inputs, None)
    if not given:
        parser.error(f"{arguments.data} has no training images")
    if arguments.sacrifice:
        given.insert(0, ("!held-out.png", *given[0][1:]))
    write(arguments.data, arguments.out / "given", given)
    write(arguments.data, arguments.out / "novel", numbered(images, inputs, str(arguments.data)))


if __name__ == "__main__":
    main()
