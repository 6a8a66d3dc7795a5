"""Makes what `scripts/compare metrics` scores: real views with predictions that are a frame off.

    python3 metrics_scene.py make RGB_FOLDER OUT VIEWS   # OUT/scene.json, OUT/frames, OUT/novel
    python3 metrics_scene.py ask SPLIT METRIC...         # the split with these metrics, to stdout
    python3 metrics_scene.py ask-novel SPLIT METRIC...   # and novel views alone

With Pillow alone. The poses are made up: metrics do not look at them.
"""

import hashlib
import json
import shutil
import sys
from pathlib import Path

from PIL import Image


def make(rgb, out, views):
    images = sorted(Path(rgb).iterdir())
    (out / "frames").mkdir(parents=True)
    (out / "novel").mkdir()
    frames = []
    # Of five frames the last is a novel view.
    for number in range(5 * views):
        source = images[number % (len(images) - 1)]
        name = f"frames/{number:06}{source.suffix}"
        shutil.copy(source, out / name)
        pose = {"rotation_wxyz": [1.0, 0.0, 0.0, 0.0], "centre": [0.1 * number, 0.0, 0.0]}
        frames.append({"image": name, "time_seconds": number / 30, "pose": pose, "mask": None})
        if number % 5 == 4:
            shown = images[number % (len(images) - 1) + 1]
            Image.open(shown).convert("RGB").save(out / "novel" / f"{number:06}.png")
    width, height = Image.open(images[0]).size
    scene = {
        "schema": "omnilife/scene/1",
        "id": "compared/seq-000",
        "camera": {"width": width, "height": height},
        "scale": "arbitrary",
        "frames": frames,
        "points": None,
        "pose_source": {"kind": "given", "file": "none"},
        "validation": {
            "status": "unchecked",
            "registered_frames": len(frames),
            "total_frames": len(frames),
            "measures": {},
            "problems": [],
        },
    }
    (out / "scene.json").write_text(json.dumps(scene))


def ask(split, metrics, scored=None):
    split = json.loads(Path(split).read_text())
    split["protocol"]["scored"] = scored or split["protocol"]["scored"]
    split["protocol"]["metrics"] = metrics
    text = json.dumps(split["protocol"], separators=(",", ":"))
    split["protocol_hash"] = hashlib.sha256(text.encode()).hexdigest()
    print(json.dumps(split))


def main():
    match sys.argv[1:]:
        case ["make", rgb, out, views]:
            make(rgb, Path(out), int(views))
        case ["ask", split, *metrics]:
            ask(split, metrics)
        case ["ask-novel", split, *metrics]:
            ask(split, metrics, "novel")
        case _:
            sys.exit(__doc__)


if __name__ == "__main__":
    main()
