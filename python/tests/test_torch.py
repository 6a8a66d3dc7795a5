"""Frames of a scene as tensors, held against plain numbers; they need PyTorch."""

from __future__ import annotations

import dataclasses
import pickle
import subprocess
import sys
import unittest
import warnings
from typing import Any

import extras
import numpy as np
from small import ERP, PINHOLE, Small

import omnilife
from omnilife import InputError


@extras.needs("torch")
class Frames(unittest.TestCase):
    erp: Small
    pinhole: Small

    @classmethod
    def setUpClass(cls) -> None:
        cls.erp, cls.pinhole = Small(ERP), Small(PINHOLE)
        cls.addClassCleanup(cls.erp.remove)
        cls.addClassCleanup(cls.pinhole.remove)

    def dataset(self, small: Small, *arguments: Any, **options: Any) -> Any:
        from omnilife.torch import SceneFrames

        return SceneFrames(small.scene, *arguments, **options)

    def test_items_are_what_the_files_hold(self) -> None:
        import torch

        item = self.dataset(self.erp)[0]
        self.assertEqual((item["image"].shape, item["image"].dtype), ((3, 4, 8), torch.float32))
        pixels = item["image"].numpy().transpose(1, 2, 0) * 255
        np.testing.assert_allclose(pixels, self.erp.images[0], atol=1e-4)
        self.assertTrue(item["image"].is_contiguous())
        for name, expected in (("mask", self.erp.mask), ("ignore_mask", self.erp.ignored)):
            self.assertEqual((item[name].shape, item[name].dtype), ((1, 4, 8), torch.bool))
            np.testing.assert_array_equal(item[name][0].numpy(), expected)
        self.assertEqual((item["time_seconds"], item["index"]), (0.0, 0))
        self.assertEqual(item["file"], str(self.erp.folder / "0.png"))
        self.assertFalse({"mask", "ignore_mask", "K"} & set(self.dataset(self.erp)[1]))

    def test_rays_of_a_panorama_are_independent_numbers(self) -> None:
        dataset = self.dataset(self.erp)
        rays = dataset[1]["rays"].numpy()
        self.assertEqual((rays.shape, rays.dtype), ((4, 8, 3), np.float32))
        # Longitude and latitude of pixel centres are odd multiples of 22.5 degrees.
        sine, cosine = 0.38268343, 0.92387953
        corner = [-sine * sine, -cosine, -sine * cosine]
        np.testing.assert_allclose(rays[0, 0], corner, atol=1e-6)
        np.testing.assert_allclose(rays[2, 4], [cosine * sine, sine, cosine * cosine], atol=1e-6)
        # Both sides of the seam, and both poles.
        np.testing.assert_allclose(rays[:, 0] * [-1, 1, 1], rays[:, 7], atol=1e-6)
        np.testing.assert_allclose(rays[0].mean(axis=0), [0, -cosine, 0], atol=1e-6)
        np.testing.assert_allclose(rays[3] * [1, -1, 1], rays[0], atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, atol=1e-6)
        # What is returned belongs to the caller.
        dataset[0]["rays"].zero_()
        np.testing.assert_array_equal(dataset[1]["rays"].numpy(), rays)

    def test_poses_take_the_camera_to_the_world(self) -> None:
        item = self.dataset(self.erp)[2]
        expected = [[0, 0, 1, 2], [0, 1, 0, 2], [-1, 0, 0, 3], [0, 0, 0, 1]]
        np.testing.assert_allclose(item["c2w"].numpy(), expected, atol=1e-6)
        of_world = item["rays"] @ item["c2w"][:3, :3].T
        _, directions = self.erp.scene.frames[2].rays()
        np.testing.assert_allclose(of_world.numpy(), directions, atol=1e-6)

    def test_a_pinhole_has_a_matrix_and_no_rays(self) -> None:
        item = self.dataset(self.pinhole, downscale=2)[0]
        np.testing.assert_array_equal(item["K"], [[2, 0, 1.5], [0, 2.5, 1], [0, 0, 1]])
        self.assertNotIn("rays", item)
        ray = np.linalg.inv(item["K"].numpy()) @ [0.5, 0.5, 1]
        np.testing.assert_allclose(ray, [-0.5, -0.2, 1], atol=1e-6)
        np.testing.assert_allclose(
            PINHOLE.resized(3, 2).rays()[0, 0], ray / np.linalg.norm(ray), atol=1e-6
        )
        with self.assertRaisesRegex(InputError, "^a camera of the model erp has no K"):
            ERP.K

    def test_smaller_items_are_those_of_scores(self) -> None:
        item = self.dataset(self.erp, downscale=2)[0]
        blocks = self.erp.images[0, ::2, ::2].transpose(2, 0, 1) / 255
        np.testing.assert_allclose(item["image"].numpy(), blocks, atol=1e-6)
        self.assertEqual(item["rays"].shape, (2, 4, 3))
        np.testing.assert_array_equal(item["mask"][0], [[0, 1, 0, 0], [0, 0, 0, 0]])
        # A single pixel is enough to ignore one.
        np.testing.assert_array_equal(item["ignore_mask"][0], [[0, 0, 0, 0], [1, 0, 0, 0]])
        for downscale in (0, 5):
            with self.assertRaisesRegex(InputError, "^downscale is ., expected 1 to 4$"):
                self.dataset(self.erp, downscale=downscale)

    def test_views_are_those_of_the_split(self) -> None:
        split = self.erp.split
        chosen: list[tuple[tuple[Any, ...], list[int]]] = [
            ((), [0, 1, 2]),
            ((split,), [0, 2]),
            ((split, "novel"), [1]),
            ((split, "all"), [0, 1, 2]),
        ]
        for arguments, expected in chosen:
            dataset = self.dataset(self.erp, *arguments)
            self.assertEqual([item["index"] for item in dataset], expected)
            self.assertEqual(len(dataset), len(expected))
        refused: list[tuple[tuple[Any, ...], str]] = [
            ((None, "input"), 'views="input" needs a split'),
            ((split, "given"), "views is 'given', expected"),
            ((dataclasses.replace(split, scene="other"),), "split of other, the scene is small"),
            (
                (dataclasses.replace(split, input_views=[3]),),
                "frame 3 is not in the scene or has no",
            ),
        ]
        for arguments, reason in refused:
            with self.assertRaisesRegex(InputError, reason):
                self.dataset(self.erp, *arguments)

    def test_workers_load_batches(self) -> None:
        import torch
        from omnilife.torch import collate
        from torch.utils.data import DataLoader

        dataset = pickle.loads(pickle.dumps(self.dataset(self.erp)))
        for workers in (0, 2):
            loader = DataLoader(dataset, batch_size=2, collate_fn=collate, num_workers=workers)
            first, last = list(loader)
            self.assertEqual(first["image"].shape, (2, 3, 4, 8))
            self.assertEqual(first["rays"].shape, (2, 4, 8, 3))
            self.assertEqual(first["c2w"].shape, (2, 4, 4))
            self.assertEqual(first["index"].tolist(), [0, 1])
            self.assertEqual(first["time_seconds"].dtype, torch.float64)
            self.assertIsInstance(first["mask"], list)
            self.assertIsNone(first["mask"][1])
            self.assertEqual(last["file"], [str(self.erp.folder / "2.png")])
            self.assertNotIn("mask", last)
        both = collate([dataset[0], dataset[0]])
        self.assertEqual((both["mask"].shape, both["mask"].dtype), ((2, 1, 4, 8), torch.bool))
        with self.assertRaisesRegex(InputError, "a batch needs frames of one size and one camera"):
            collate([dataset[0], self.dataset(self.pinhole)[0]])

    def test_metrics_take_what_it_collates(self) -> None:
        from omnilife.torch import collate

        batch = collate(list(self.dataset(self.erp)))
        prediction = batch["image"].roll(1, -1)
        found = omnilife.compute(
            prediction,
            batch["image"],
            ["psnr", "psnr-dynamic"],
            mask=batch["mask"],
            ignored=batch["ignore_mask"],
        )
        frame = self.erp.scene.frames[0]
        first = omnilife.compute(
            np.roll(frame.image(), 1, axis=1),
            frame.image(),
            list(found),
            mask=frame.mask(),
            ignored=frame.ignored(),
        )
        self.assertEqual({id: values[0] for id, values in found.items()}, first)
        self.assertTrue(np.isfinite(found["psnr"]).all())
        self.assertTrue(np.isnan(found["psnr-dynamic"][1:]).all())

    def test_coordinates_far_out_are_told(self) -> None:
        frames = []
        for frame in self.erp.scene.frames[:3]:
            assert frame.pose is not None
            pose = dataclasses.replace(frame.pose, centre=frame.pose.centre + [5e6, 0, 0])
            frames.append(dataclasses.replace(frame, pose=pose))
        far = Small(ERP)
        self.addCleanup(far.remove)
        far.scene = dataclasses.replace(self.erp.scene, frames=frames)
        with self.assertWarnsRegex(UserWarning, "rounds camera centres to 0.6 units"):
            self.dataset(far)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            item = self.dataset(far, origin=[5e6, 2, 3])[1]
        np.testing.assert_array_equal(item["c2w"][:3, 3], [1, 0, 0])


class WithoutExtras(unittest.TestCase):
    def test_a_missing_package_is_one_line_with_its_extra(self) -> None:
        for package, extra, program in (
            ("torch", "torch", "import omnilife.torch"),
            ("pandas", "pandas", "omnilife.Table(a=[1]).to_pandas()"),
            ("polars", "polars", "omnilife.Table(a=[1]).to_polars()"),
            ("matplotlib", "plots", "omnilife.plot_curve('.')"),
        ):
            program = f"""
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == {package!r}:
            raise ModuleNotFoundError(name, name={package!r})
sys.meta_path.insert(0, Without())
import omnilife
try:
    {program}
except ImportError as error:
    print(error)
"""
            words = [sys.executable, "-c", program]
            ended = subprocess.run(words, capture_output=True, text=True, check=False)
            expected = f"{package} is not installed: install the extra omnilife[{extra}]\n"
            self.assertEqual(ended.stdout, expected, ended.stderr)


if __name__ == "__main__":
    unittest.main()
