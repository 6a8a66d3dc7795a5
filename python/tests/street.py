"""The sample's scene with everything that a metric may need, made by the command."""

from __future__ import annotations

import hashlib
import json
import shutil
import struct
import subprocess
import sysconfig
import tempfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import omnilife

ROOT = Path(__file__).resolve().parents[2]
STREET = ROOT / "tests/data/street"
#: The command of the wheel that is tested.
COMMAND = Path(sysconfig.get_path("scripts")) / "omnilife"


def omnilife_command(*arguments: object) -> subprocess.CompletedProcess[str]:
    words = [str(COMMAND), "--quiet", *map(str, arguments)]
    return subprocess.run(words, capture_output=True, text=True, check=False)


def expect_success(*arguments: object) -> str:
    ended = omnilife_command(*arguments)
    assert ended.returncode == 0, ended.stderr
    return ended.stdout


class Street:
    """A folder with a scene of 10 frames, its split and predictions of the novel views."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="omnilife-tests-"))
        dataset = self.folder / "dataset"
        expect_success(
            "curate", STREET / "street.mp4", "--fps", 5, "--criteria", "none", "--out", dataset
        )
        self.sequence = dataset / "videos/street/seq-000"
        expect_success("curate", "poses", self.sequence, "--poses", STREET / "poses.json")
        self._annotate()
        self.scene = omnilife.load_scene(self.sequence)
        self.split = self._split_with_all_metrics()
        self.views = self.folder / "views"
        self._predict()

    def remove(self) -> None:
        shutil.rmtree(self.folder)

    def _annotate(self) -> None:
        """Masks of what moves, of classes and of objects, and true distances for every frame."""
        file = self.sequence / "scene.json"
        record = json.loads(file.read_text())
        width, height = record["camera"]["width"], record["camera"]["height"]
        generator = np.random.default_rng(0)
        for folder in ("given-masks", "given-depth"):
            (self.sequence / folder).mkdir()
        for index, frame in enumerate(record["frames"]):
            names = [f"given-masks/{index:06}-{kind}.png" for kind in ("a", "b")]
            shutil.copy(STREET / f"masks/{index:06}.png", self.sequence / names[0])
            block = np.zeros((height, width), np.uint8)
            block[40 : 90 + index, 100:160] = 255
            write_png(self.sequence / names[1], block)
            depth = generator.integers(0, 65536, (height, width)).astype(np.uint16)
            write_png(self.sequence / f"given-depth/{index:06}.png", depth)
            frame["mask"] = names[0]
            frame["classes"] = {"human": names[1], "vehicle": names[0]}
            frame["objects"] = {"one": names[0], "two": names[1]}
            frame["depth"] = {"file": f"given-depth/{index:06}.png", "unit": 0.001}
        file.write_text(json.dumps(record))

    def _split_with_all_metrics(self) -> omnilife.Split:
        split = omnilife.split_scene(self.sequence, self.folder / "split.json")
        record = split.record
        record["protocol"]["metrics"] = list(omnilife.METRICS)
        # A predicted image is scored at half its size, so that resizing is part of what is compared.
        record["protocol"]["largest_width"] = self.scene.camera.width // 2
        text = json.dumps(record["protocol"], separators=(",", ":"), ensure_ascii=False)
        record["protocol_hash"] = hashlib.sha256(text.encode()).hexdigest()
        record["schema"] = json.loads(split.path.read_text())["schema"]
        split.path.write_text(json.dumps(record))
        return omnilife.load_split(split.path)

    def _predict(self) -> None:
        """Views that are wrong in many ways, as arrays; their distances too."""
        (self.views / "depth").mkdir(parents=True)
        size = self.split.scored_size(self.scene)
        generator = np.random.default_rng(1)
        for index in self.split.novel_views:
            truth = self.scene.frames[index].image(size) / 255
            noise = generator.normal(0.0, 0.05, truth.shape)
            view = np.clip(np.roll(truth, 2, axis=1) + noise, 0.0, 1.0).astype(np.float32)
            np.save(self.views / f"{index:06}.npy", view)
            depth = generator.uniform(0.0, 60.0, truth.shape[:2]).astype(np.float32)
            np.save(self.views / f"depth/{index:06}.npy", depth)


def write_png(path: Path, pixels: npt.NDArray[Any]) -> None:
    """Writes grey values of 8 or 16 bits (height, width), or colours of 8 bits (height, width, 3)."""
    height, width = pixels.shape[:2]
    rows = pixels.astype(pixels.dtype.newbyteorder(">"))
    data = b"".join(b"\0" + row.tobytes() for row in rows)

    def chunk(kind: bytes, content: bytes) -> bytes:
        checked = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checked)

    head = struct.pack(">IIBBBBB", width, height, 8 * pixels.itemsize, 2 if pixels.ndim == 3 else 0, 0, 0, 0)
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(data, 1)) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunks)
