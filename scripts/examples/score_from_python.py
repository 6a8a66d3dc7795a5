"""Scores a method that learns nothing, from Python: pip install ., then

    python scripts/examples/score_from_python.py [OUT]

Every novel view is predicted by the given view that is nearest in time, turned as the new camera is:
each pixel's ray is looked up in the given image. The sample's video becomes a scene first.
"""

import sys
from pathlib import Path

import numpy as np
import numpy.typing as npt

import omnilife
from omnilife.metrics import ws_psnr

STREET = Path(__file__).resolve().parents[2] / "tests/data/street"


def curate(out: Path) -> omnilife.Scene:
    """From the sample's video to a scene: frames, poses, masks of what moves."""
    dataset = omnilife.curate(STREET / "street.mp4", out / "dataset", fps=5, criteria="none")
    return omnilife.find_poses(dataset.sequences[0], poses=STREET / "poses.json")


def predict(scene: omnilife.Scene, split: omnilife.Split, index: int) -> npt.NDArray[np.float32]:
    """What a novel view is taken to look like, (height, width, 3) in [0, 1]."""
    frame = scene.frames[index]
    given = [scene.frames[view] for view in split.input_views]
    nearest = min(given, key=lambda view: abs(view.time_seconds - frame.time_seconds))
    assert nearest.pose is not None
    width, height = split.scored_size(scene)
    _, directions = frame.rays((width, height))
    # Rows times a rotation from the camera to the world: turned the other way, into the camera.
    in_nearest = directions @ nearest.pose.rotation
    pixels = scene.camera.resized(width, height).project(in_nearest)
    columns = pixels[..., 0].astype(int) % width
    rows = pixels[..., 1].astype(int).clip(0, height - 1)
    image = nearest.image((width, height)).astype(np.float32) / 255
    view: npt.NDArray[np.float32] = image[rows, columns]
    return view


def main() -> None:
    out = Path(sys.argv[1] if len(sys.argv) > 1 else "out/score-from-python")
    views = out / "views"
    views.mkdir(parents=True, exist_ok=True)
    scene = curate(out)
    split = omnilife.split_scene(scene.path, out / "split.json")
    for index in split.novel_views:
        view = predict(scene, split, index)
        truth = scene.frames[index].image(split.scored_size(scene))
        print(f"frame {index}: WS-PSNR {ws_psnr(view, truth):.2f} dB")
        np.save(views / f"{index:06}.npy", view)
    result = omnilife.score(
        scene, split, novel_views=views, method="turned", out=out / "scores", without_lpips=True
    )
    for metric in ("psnr", "ssim"):
        print(f"{metric} {result.mean(metric):.2f} over {len(result.views['frame'])} views")


if __name__ == "__main__":
    main()
