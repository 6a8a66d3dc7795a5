from pathlib import Path

import images
import loader

GAP = 2
settings = loader.settings()
model = Path(settings["model_path"])
iteration = (model / "chkpnt30000.pth").read_text()
for kind, views in zip(["train", "test"], loader.read(settings)):
    for number, file in views:
        width, _, rows = images.read(file)
        empty = bytes(3 * (2 * width + 3 * GAP))
        side = bytes(3 * GAP)
        upper = [side + row + side + row + side for row in rows]
        lower = [side + bytes(len(row)) + side + bytes(len(row)) + side for row in rows]
        grid = [empty] * GAP + upper + [empty] * GAP + lower + [empty] * GAP
        images.write(model / f"eval/{kind}_{iteration}_render/{number:03}.png", grid)
