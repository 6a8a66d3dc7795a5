"""Metrics of images in any layout, single and in batches."""

from __future__ import annotations

import unittest
from typing import Any

import extras
import numpy as np

from omnilife import InputError, compute
from omnilife.metrics import METRICS, psnr, psnr_dynamic, ssim

SHAPE = (4, 32, 64, 3)
RANDOM = np.random.default_rng(5)
TRUTH = RANDOM.integers(0, 256, SHAPE, np.uint8)
PREDICTION = RANDOM.integers(0, 256, SHAPE, np.uint8)
MASKS = RANDOM.integers(0, 2, SHAPE[:3]).astype(bool)


def channels_first(images: Any) -> Any:
    return np.moveaxis(images, -1, -3)


class Layouts(unittest.TestCase):
    def test_channels_first_are_the_same_image(self) -> None:
        for metric in (psnr, ssim, METRICS["ws-psnr"]):
            expected = metric(PREDICTION[0], TRUTH[0])
            self.assertIsInstance(expected, float)
            first = channels_first(PREDICTION[0])
            layouts: list[tuple[Any, Any]] = [(None, TRUTH[0]), ("CHW", channels_first(TRUTH[0]))]
            for layout, truth in layouts:
                self.assertEqual(metric(first, truth, layout=layout), expected)
                self.assertEqual(metric(first / 255, truth, layout=layout), expected)

    def test_a_batch_gives_an_array_of_the_same_numbers(self) -> None:
        expected = [psnr(*pair) for pair in zip(PREDICTION, TRUTH)]
        for images in (
            (PREDICTION, TRUTH),
            (channels_first(PREDICTION), channels_first(TRUTH / 255)),
        ):
            found = psnr(*images)
            self.assertIsInstance(found, np.ndarray)
            self.assertEqual(found.tolist(), expected)
        self.assertEqual(psnr(PREDICTION[:1], TRUTH[:1]).shape, (1,))
        several = compute(PREDICTION, TRUTH, ["ssim", "psnr"])
        self.assertEqual(several["psnr"].tolist(), expected)
        self.assertEqual(list(several), ["ssim", "psnr"])

    def test_a_batch_takes_masks_of_every_form(self) -> None:
        expected = [psnr_dynamic(p, t, mask=m) for p, t, m in zip(PREDICTION, TRUTH, MASKS)]
        for masks in (MASKS, MASKS[:, None], MASKS[..., None], list(MASKS[:, None])):
            self.assertEqual(psnr_dynamic(PREDICTION, TRUTH, mask=masks).tolist(), expected)
        some = [None, *MASKS[1:]]
        found = psnr_dynamic(PREDICTION, TRUTH, mask=some)
        self.assertTrue(np.isnan(found[0]))
        self.assertEqual(found[1:].tolist(), expected[1:])
        one = [psnr(p, t, ignored=MASKS[0]) for p, t in zip(PREDICTION, TRUTH)]
        self.assertEqual(psnr(PREDICTION, TRUTH, ignored=MASKS[0]).tolist(), one)

    def test_a_batch_takes_distances_and_objects(self) -> None:
        ids = [id for id, metric in METRICS.items() if "depth" in dict(metric.needs)]
        objects = {"one": MASKS, "two": [None, *MASKS[1:]]}
        ids += [id for id, metric in METRICS.items() if "object-masks" in dict(metric.needs)]
        depth = RANDOM.uniform(1.0, 9.0, (2, *SHAPE[:3])).astype(np.float32)
        several = compute(
            PREDICTION, TRUTH, ids, depth=(depth[0], depth[1][:, None]), objects=objects
        )
        for at in range(len(PREDICTION)):
            seen = {"one": MASKS[at]} if at == 0 else {"one": MASKS[at], "two": MASKS[at]}
            single = compute(
                PREDICTION[at], TRUTH[at], ids, depth=(depth[0][at], depth[1][at]), objects=seen
            )
            for id in ids:
                value = np.nan if single[id] is None else single[id]
                np.testing.assert_equal(several[id][at], value, id)

    def test_what_is_ambiguous_or_does_not_fit_is_told(self) -> None:
        thin = np.zeros((3, 16, 3), np.uint8)
        with self.assertRaisesRegex(
            InputError, r"^prediction of shape \(3, 16, 3\) may be HWC or CHW.*layout=.*$"
        ):
            psnr(thin, thin)
        self.assertEqual(psnr(thin, thin, layout="HWC"), 100.0)
        wide = np.zeros((32, 64, 3), np.uint8)
        for images, options, reason in (
            ((wide, wide), {"layout": "CHW"}, "prediction is of shape .* as CHW has them"),
            ((wide, wide), {"layout": "WHC"}, "layout is 'WHC', expected"),
            ((wide[..., :2], wide), {}, "prediction is of shape .* expected three channels"),
            ((wide[..., 0], wide), {}, r"prediction is of shape \(32, 64\), expected"),
            (
                (PREDICTION, TRUTH[:2]),
                {},
                r"truth is of shape \(2, 32, 64, 3\), the prediction of \(4, ",
            ),
            (
                (PREDICTION, TRUTH[0]),
                {},
                r"truth is of shape \(32, 64, 3\), the prediction of \(4, ",
            ),
            ((PREDICTION, TRUTH), {"ignored": MASKS[:2]}, "is for 2 images, the batch has 4"),
            (
                (PREDICTION, TRUTH),
                {"ignored": MASKS[:, :16]},
                "image 0: the mask of .* is of shape",
            ),
        ):
            with self.assertRaisesRegex(InputError, f"^[^\n]*{reason}[^\n]*$"):
                psnr(*images, **options)  # type: ignore[arg-type,unused-ignore]

    @extras.needs("torch")
    def test_tensors_are_arrays(self) -> None:
        import torch

        expected = [psnr_dynamic(p, t, mask=m) for p, t, m in zip(PREDICTION, TRUTH, MASKS)]
        prediction = torch.from_numpy(PREDICTION).permute(0, 3, 1, 2)
        truth = (torch.from_numpy(TRUTH) / 255).requires_grad_()
        masks = torch.from_numpy(MASKS)[:, None]
        self.assertEqual(psnr_dynamic(prediction, truth, mask=masks).tolist(), expected)
        self.assertEqual(psnr_dynamic(prediction[0], truth[0], mask=masks[0]), expected[0])
        rounded = truth.to(torch.bfloat16)
        self.assertEqual(psnr(rounded, TRUTH).tolist(), psnr(rounded.float(), TRUTH).tolist())


if __name__ == "__main__":
    unittest.main()
