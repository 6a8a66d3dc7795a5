"""The loader of Splatter-360 and PanoSplatt3R at test time."""

import json
from pathlib import Path

import geometry
import images
import torch

SIDE = 256


def read(roots, rgb_roots, index_path, shape):
    """Returns (scene, files of the targets) of every scene, after all that they read was there."""
    evaluation = json.loads(Path(index_path).read_text())
    assert len(roots) == len(rgb_roots)
    found = []
    for root, rgb_root in zip(roots, rgb_roots):
        root = Path(root) / "test"
        index = json.loads((root / "index.json").read_text())
        chunks = sorted(path for path in root.iterdir() if path.suffix == ".torch")
        for path in chunks:
            for example in torch.load(path):
                key = example["key"]
                assert index[key] == path.name
                entry = evaluation[key]
                files = scene(Path(rgb_root) / "test" / key / "pano", example, shape)
                for place in entry["context"] + entry["target"]:
                    frame(files[place], shape)
                found.append((key, [files[place] for place in entry["target"]]))
    return found


def scene(folder, example, shape):
    """Returns the frames of a scene, after its cameras were looked at."""
    files = sorted(path for path in folder.iterdir() if path.suffix == ".png")
    count = example["cameras"].shape[0]
    assert len(files) == count
    assert example["cameras"].shape == (count, 4, 4)
    assert example["c2ws_cubes"].shape == (count, 6, 4, 4)
    assert example["fxfycxcys"].shape == (count, 4)
    assert list(example["cube_shape"].values) == [SIDE, SIDE]
    for whole, faces in zip(example["cameras"].values, example["c2ws_cubes"].values):
        geometry.check_rotation(whole[:3])
        ahead = []
        for face in faces:
            geometry.check_rotation(face[:3])
            assert [row[3] for row in face] == [row[3] for row in whole]
            ahead.append(tuple(round(face[row][2], 3) for row in range(3)))
        # The second face looks along -z of the panorama, its left edge; the fourth along z, its middle.
        for number, sign in [(1, -1), (3, 1)]:
            assert all(abs(ahead[number][row] - sign * whole[row][2]) < 2e-3 for row in range(3)), ahead
        # The first looks up, along y, and the last down.
        for number, sign in [(0, 1), (5, -1)]:
            assert all(abs(ahead[number][row] - sign * whole[row][1]) < 2e-3 for row in range(3)), ahead
    return files


def frame(file, shape):
    assert images.read(file)[:2] == (shape[1], shape[0]), f"{file} is not of {shape}"
    # Every "pano" of the path is replaced.
    faces = torch.load(str(file).replace("pano", "cubemaps_depth").replace(".png", ".torch"))
    assert faces.shape == (6, SIDE, SIDE, 1)
    assert images.read(str(file).replace("pano", "pano_depth"))[:2] == (shape[1], shape[0])
