"""Frames of a scene as a dataset of PyTorch, which is the extra `torch`.

from omnilife.torch import SceneFrames, collate
DataLoader(SceneFrames(scene, split), batch_size=4, collate_fn=collate, num_workers=2)
"""

from __future__ import annotations

import operator
import warnings
from typing import Any, Literal, Optional, Union

import numpy as np
import numpy.typing as npt

from . import _arrays
from ._extras import extra
from .errors import InputError
from .scene import Frame, Scene, Split, load_scene, load_split

extra("torch", "torch")

import torch  # noqa: E402
from torch.utils.data import Dataset  # noqa: E402

Item = dict[str, Any]
Views = Literal["input", "novel", "all"]

#: Entries that only some frames have.
_OPTIONAL = ("mask", "ignore_mask")
#: Rounding of coordinates that is not seen, in units of the radius of a scene's cameras.
_UNSEEN_ROUNDING = 1e-5


class SceneFrames(Dataset[Item]):
    """The frames of a scene, in order of time; files are read when an item is.

    Every item has

    - `image`: (3, H, W) float32 in [0, 1], sRGB;
    - `mask`: (1, H, W) bool, the dynamic region, and `ignore_mask`: (1, H, W) bool, the ignored region, each where
      the frame has one;
    - `c2w`: (4, 4) float32, camera to world. Camera axes are those of OpenCV: x right, y down, z forward;
    - `K`: (3, 3) float32 in pixels, of pinholes; the centre of the first pixel is at (0.5, 0.5);
    - `rays`: (H, W, 3) float32, of panoramas: unit directions through the pixel centres on the camera's axes.
      `rays @ c2w[:3, :3].T` are those on the world's axes;
    - `time_seconds`: float, `index`: int, the frame's number in the scene, and `file`: str, its image.
    """

    def __init__(
        self,
        scene: Union[Scene, _arrays.Path],
        split: Optional[Union[Split, _arrays.Path]] = None,
        views: Optional[Views] = None,
        downscale: int = 1,
        *,
        origin: Optional[npt.ArrayLike] = None,
    ) -> None:
        """Lists the frames, without reading their images.

        `views` is `input`, `novel` or `all`: by default `input` with a split and `all` without. `all` is every
        view of the split, or every frame with a pose. `downscale` divides width and height, rounded down:
        images are then averaged by area, masks are resized as those of scores, and cameras scale along.
        `origin` (3) becomes the origin of the world; give it where coordinates are large.

        Warns where float32 rounds camera centres by more than 1e-5 of the radius around them.
        """
        self.scene = scene if isinstance(scene, Scene) else load_scene(scene)
        if split is not None and not isinstance(split, Split):
            split = load_split(split)
        self.frames: list[Frame] = _frames(self.scene, split, views)
        camera = self.scene.camera
        step = operator.index(downscale)
        if not 1 <= step <= min(camera.size):
            raise InputError(f"downscale is {step}, expected 1 to {min(camera.size)}")
        self._size = None if step == 1 else (camera.width // step, camera.height // step)
        #: The camera of the items.
        self.camera = camera if self._size is None else camera.resized(*self._size)
        given = np.zeros(3) if origin is None else np.asarray(origin, dtype=np.float64)
        if given.shape != (3,):
            raise InputError(f"origin is of shape {given.shape}, expected (3,)")
        self._origin = given
        self._warn_of_rounding()
        self._rays: Optional[torch.Tensor] = None

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, at: int) -> Item:
        frame = self.frames[operator.index(at)]
        assert frame.pose is not None
        image = torch.from_numpy(frame.image(self._size)).permute(2, 0, 1)
        item: Item = {"image": image.to(torch.float32).div_(255).contiguous()}
        masks = (frame.mask(self._size), frame.ignored(self._size))
        for name, mask in zip(_OPTIONAL, masks):
            if mask is not None:
                item[name] = torch.from_numpy(mask)[None]
        pose = frame.pose.camera_to_world
        pose[:3, 3] -= self._origin
        item["c2w"] = torch.from_numpy(pose.astype(np.float32))
        if self.camera.model == "pinhole":
            item["K"] = torch.from_numpy(self.camera.K.astype(np.float32))
        else:
            item["rays"] = self._directions().clone()
        item.update(time_seconds=frame.time_seconds, index=frame.index, file=str(frame.image_path))
        return item

    def _directions(self) -> torch.Tensor:
        # The same for every frame; computed by the worker that needs them.
        if self._rays is None:
            self._rays = torch.from_numpy(self.camera.rays().astype(np.float32))
        return self._rays

    def _warn_of_rounding(self) -> None:
        centres = np.array([frame.pose.centre for frame in self.frames if frame.pose is not None])
        if len(centres) == 0:
            return
        offset = np.linalg.norm(centres.mean(axis=0) - self._origin)
        radius = np.linalg.norm(centres - centres.mean(axis=0), axis=1).max()
        rounding = float(np.finfo(np.float32).eps * offset)
        # Cameras in one place give no measure.
        if radius > 1e-9 * offset and rounding > _UNSEEN_ROUNDING * radius:
            warnings.warn(
                f"{self.scene.path}: float32 rounds camera centres to {rounding:.2g} units of the world; "
                "give SceneFrames an origin near them",
                stacklevel=3,
            )


def collate(items: list[Item]) -> Item:
    """Collates items of `SceneFrames` into a batch.

    Tensors are stacked, times become float64 (N), frame numbers int64 (N), files a list. A mask is stacked where
    every item has one, and otherwise a list with None for the items without; it is absent where all are.
    """
    batch: Item = {}
    cameras = {(*item["image"].shape[1:], "K" in item) for item in items}
    if len(cameras) != 1:
        raise InputError("a batch needs frames of one size and one camera model")
    for name in dict.fromkeys(name for item in items for name in item):
        values: list[Any] = [item.get(name) for item in items]
        is_whole = all(value is not None for value in values)
        if is_whole and isinstance(values[0], torch.Tensor):
            batch[name] = torch.stack(values)
        elif name == "time_seconds":
            batch[name] = torch.tensor(values, dtype=torch.float64)
        elif name == "index":
            batch[name] = torch.tensor(values, dtype=torch.int64)
        else:
            batch[name] = values
    return batch


def _frames(scene: Scene, split: Optional[Split], views: Optional[str]) -> list[Frame]:
    if views is None:
        views = "all" if split is None else "input"
    if views not in ("input", "novel", "all"):
        raise InputError(f'views is {views!r}, expected "input", "novel" or "all"')
    if split is None:
        if views != "all":
            raise InputError(f'views="{views}" needs a split')
        return [frame for frame in scene.frames if frame.pose is not None]
    if split.scene != scene.id:
        raise InputError(f"{split.path}: is a split of {split.scene}, the scene is {scene.id}")
    numbers = {"input": split.input_views, "novel": split.novel_views}
    of_views = numbers.get(views, split.input_views + split.novel_views)
    for number in of_views:
        if not 0 <= number < len(scene.frames) or scene.frames[number].pose is None:
            raise InputError(f"{split.path}: frame {number} is not in the scene or has no pose")
    return [scene.frames[number] for number in sorted(of_views)]
