"""Groups of a sparse-interpolation split as test scenes in the layout of Splatter-360, which PanoSplatt3R shares.

    OUT/rgb/test/000/pano/00000.png ...           the frames, one folder of them for all groups
    OUT/rgb/test/000/pano_depth/00000.png ...     16 bits, millimetres
    OUT/rgb/test/000/cubemaps_depth/00000.torch   6 x 256 x 256 x 1
    OUT/pt/test/000000.torch                      a dictionary per group: key, cameras, faces, lenses, size
    OUT/pt/test/index.json                        the chunk of each group
    OUT/evaluation_index.json                     {"000": {"context": [0, 9], "target": [1, ...]}, ...}
    OUT/dataset.yaml                              the same as a configuration of PanoSplatt3R

Their loaders read depth with every frame. No network of theirs reads it at test time, so that it is one metre
everywhere here; depth metrics of theirs mean nothing. Paths in the files are those of --out as it is given.
Needs Python and the PyTorch of their environment.
"""

import argparse
import ast
import json
import struct
import subprocess
import zlib
from pathlib import Path

import torch

SIDE = 256
# Turns of the faces up, then once around, then down, as their converter stores them: about x or y, degrees.
FACES = [("x", 90), ("y", 0), ("y", -90), ("y", -180), ("y", -270), ("x", -90)]
# Cosine and sine.
RIGHT_ANGLES = {0: (1, 0), 90: (0, 1), -90: (0, -1), -180: (-1, 0), -270: (0, 1)}


def array(path):
    """Returns the values of a little-endian f32 array in C order."""
    data = path.read_bytes()
    (length,) = struct.unpack("<H", data[8:10])
    header = ast.literal_eval(data[10 : 10 + length].decode("latin1"))
    if data[:8] != b"\x93NUMPY\x01\x00" or header["descr"] != "<f4" or header["fortran_order"]:
        raise SystemExit(f"{path}: must be an array of ours")
    return [value for (value,) in struct.iter_unpack("<f", data[10 + length :])]


def poses(frames):
    """Returns the camera-to-world matrices of the frames, 4 x 4, and of their faces, 6 x 4 x 4."""
    rotations, centres = array(frames / "rotation.npy"), array(frames / "translation.npy")
    cameras, faces = [], []
    for frame in range(len(centres) // 3):
        rotation = [rotations[9 * frame + 3 * row : 9 * frame + 3 * row + 3] for row in range(3)]
        centre = centres[3 * frame : 3 * frame + 3]
        cameras.append(rigid(rotation, centre))
        faces.append([face(rotation, centre, *turn) for turn in FACES])
    return cameras, faces


def face(rotation, centre, axis, degrees):
    """Returns a face's matrix with OpenCV's axes: those of y and z are turned round."""
    cosine, sine = RIGHT_ANGLES[degrees]
    turn = {
        "x": [[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]],
        "y": [[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]],
    }[axis]
    turned = [[sum(row[k] * turn[k][column] for k in range(3)) for column in range(3)] for row in rotation]
    return rigid([[row[0], -row[1], -row[2]] for row in turned], centre)


def rigid(rotation, centre):
    return [[*row, place] for row, place in zip(rotation, centre)] + [[0.0, 0.0, 0.0, 1.0]]


def png_size(path):
    data = path.read_bytes()[:24]
    return struct.unpack(">II", data[16:24]) if data[:8] == b"\x89PNG\r\n\x1a\n" else None


def write_depth(path, width, height):
    """Writes one metre everywhere as a 16-bit grey PNG."""
    rows = (b"\x00" + struct.pack(">H", 1000) * width) * height

    def chunk(name, body):
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 16, 0, 0, 0, 0))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))


def configuration(out, width, height):
    return {
        "view_sampler": {
            "name": "evaluation",
            "index_path": str(out / "evaluation_index.json"),
            "num_context_views": 2,
        },
        "name": "hm3d",
        "roots": [str(out / "pt")],
        "rgb_roots": [str(out / "rgb")],
        "image_shape": [height, width],
        "make_baseline_1": False,
        "augment": False,
        "background_color": [0.0, 0.0, 0.0],
        "cameras_are_circular": False,
        "baseline_epsilon": 0.001,
        "max_fov": 100.0,
        "skip_bad_shape": True,
        "near": 0.1,
        "far": 10.0,
        "baseline_scale_bounds": False,
        "shuffle_val": False,
        "test_len": -1,
        "test_chunk_interval": 1,
        "test_times_per_scene": 1,
        "overfit_to_scene": None,
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--omnilife", required=True)
    parser.add_argument("--scene", type=Path, required=True)
    parser.add_argument("--split", type=Path, required=True)
    parser.add_argument("--size", default="1024x512", help="of the frames, which the networks expect")
    parser.add_argument("--out", type=Path, required=True)
    arguments = parser.parse_args()
    out = arguments.out
    split = json.loads(arguments.split.read_text())
    groups = split.get("groups", [])
    if not groups:
        parser.error(f"{arguments.split}: has no groups; its protocol is {split['protocol']['id']}")
    if split["unposed"]:
        parser.error(f"{len(split['unposed'])} frames have no pose: their numbers would shift")
    if "pano" in str(out):
        parser.error(f"{out}: their loaders replace every 'pano' in the path of a frame; choose a relative --out")
    test, frames = out / "rgb/test", out / "frames"
    test.mkdir(parents=True)
    export = ["curate", "export", arguments.scene, "--format", "hm3d", "--out", frames]
    subprocess.run([arguments.omnilife, "--quiet", *map(str, export)], check=True)
    width, height = map(int, arguments.size.split("x"))
    (frames / "pano_depth").mkdir()
    (frames / "cubemaps_depth").mkdir()
    for image in sorted((frames / "pano").iterdir()):
        if png_size(image) != (width, height):
            parser.error(f"{image} is not of {arguments.size} pixels: curate the scene with --width {width}")
        write_depth(frames / "pano_depth" / image.name, width, height)
        torch.save(torch.ones(6, SIDE, SIDE, 1), frames / "cubemaps_depth" / f"{image.stem}.torch")
    cameras, faces = poses(frames)
    # Their names say focal length first, their values have the centre first.
    lens = [SIDE / 2 - 0.5, SIDE / 2 - 0.5, SIDE / 2, SIDE / 2]
    chunk, evaluation = [], {}
    for number, group in enumerate(groups):
        key = f"{number:03}"
        (test / key).symlink_to(frames.resolve())
        chunk.append(
            {
                "key": key,
                "cameras": torch.tensor(cameras, dtype=torch.float32),
                "c2ws_cubes": torch.tensor(faces, dtype=torch.float32),
                "fxfycxcys": torch.tensor([lens] * len(cameras), dtype=torch.float32),
                "cube_shape": torch.tensor([SIDE, SIDE]),
            }
        )
        evaluation[key] = {"context": group["context"], "target": group["novel_views"]}
    chunks = out / "pt/test"
    chunks.mkdir(parents=True)
    torch.save(chunk, chunks / "000000.torch")
    (chunks / "index.json").write_text(json.dumps({key: "000000.torch" for key in evaluation}))
    (out / "evaluation_index.json").write_text(json.dumps(evaluation))
    # JSON is YAML.
    (out / "dataset.yaml").write_text(json.dumps(configuration(out, width, height), indent=1))


if __name__ == "__main__":
    main()
