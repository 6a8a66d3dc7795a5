#!/usr/bin/env python3
"""Golden values of bench's metrics, from implementations apart from the Rust ones.

PSNR comes from scikit-image. SSIM is the definition of 3DGS (utils/loss_utils.py: 11x11 Gaussian of
sigma 1.5, zero padding, mean over the map) through scipy's Gaussian filter, and its inside is
checked here against scikit-image's map. WS-PSNR is the formula with weights sin((j + 1/2) pi / H).

    pip install numpy scipy scikit-image pillow
    scripts/golden/metrics.py pairs --street STREET/rgb --hall HALL/rgb   # makes the image pairs
    scripts/golden/metrics.py goldens                                     # scores the stored pairs

goldens.json names the versions it was made with.
"""

import argparse
import io
import json
from pathlib import Path

import numpy as np
import PIL
import scipy
import skimage
from PIL import Image
from scipy.ndimage import gaussian_filter
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

FOLDER = Path(__file__).resolve().parents[2] / "bench/tests/data/metrics"
MSE_FLOOR = 1e-10


def make_pairs(street: Path, hall: Path) -> None:
    """Writes <name>-prediction.png and <name>-truth.png of real frames and of extremes."""
    random = np.random.default_rng(360)

    def frame(folder: Path, number: int, size: tuple[int, int]) -> np.ndarray:
        file = sorted(folder.iterdir())[number]
        return np.asarray(Image.open(file).convert("RGB").resize(size, Image.Resampling.BOX))

    def jpeg(image: np.ndarray, quality: int) -> np.ndarray:
        buffer = io.BytesIO()
        Image.fromarray(image).save(buffer, "JPEG", quality=quality)
        return np.asarray(Image.open(buffer).convert("RGB"))

    def noisy(image: np.ndarray, sigma: float) -> np.ndarray:
        return np.clip(image + random.normal(0.0, sigma, image.shape), 0, 255).astype(np.uint8)

    street_96 = frame(street, 10, (96, 48))
    street_65 = frame(street, 20, (65, 33))
    street_80 = frame(street, 30, (80, 40))
    hall_48 = frame(hall, 5, (48, 24)).copy()
    one_channel = hall_48.copy()
    one_channel[..., 1] = noisy(hall_48[..., 1], 12.0)
    blurred = gaussian_filter(street_80.astype(float), (1.2, 1.2, 0)).round().astype(np.uint8)
    pairs = {
        "compressed": (jpeg(street_96, 25), street_96),
        "noise-odd-size": (noisy(street_65, 8.0), street_65),
        "blur-and-shift": (np.roll(blurred, 2, axis=1), street_80),
        "motion": (frame(street, 14, (64, 32)), frame(street, 10, (64, 32))),
        "smaller-than-window": (frame(hall, 12, (7, 5)), frame(hall, 2, (7, 5))),
        "narrow": (frame(hall, 12, (3, 40)), frame(hall, 2, (3, 40))),
        "one-channel": (one_channel, hall_48),
        "identical": (hall_48, hall_48),
        "black-white": (np.zeros((12, 24, 3), np.uint8), np.full((12, 24, 3), 255, np.uint8)),
        "one-pixel": (np.full((1, 1, 3), 90, np.uint8), np.full((1, 1, 3), 120, np.uint8)),
    }
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, (prediction, truth) in pairs.items():
        Image.fromarray(prediction).save(FOLDER / f"{name}-prediction.png", optimize=True)
        Image.fromarray(truth).save(FOLDER / f"{name}-truth.png", optimize=True)


def decibels(mse: float) -> float:
    return float(-10.0 * np.log10(max(mse, MSE_FLOOR)))


def psnr(prediction: np.ndarray, truth: np.ndarray) -> float:
    if np.mean((prediction - truth) ** 2) < MSE_FLOOR:
        return decibels(0.0)
    return float(peak_signal_noise_ratio(truth, prediction, data_range=1.0))


def psnr_channels(prediction: np.ndarray, truth: np.ndarray) -> float:
    return float(np.mean([psnr(prediction[..., c], truth[..., c]) for c in range(3)]))


def ws_psnr(prediction: np.ndarray, truth: np.ndarray) -> float:
    height = truth.shape[0]
    weights = np.sin((np.arange(height) + 0.5) * np.pi / height)
    weights = np.broadcast_to(weights[:, None, None], truth.shape)
    return decibels(float(np.average((prediction - truth) ** 2, weights=weights)))


def ssim(prediction: np.ndarray, truth: np.ndarray) -> float:
    maps = []
    for c in range(3):
        x, y = prediction[..., c], truth[..., c]

        def local_mean(image: np.ndarray) -> np.ndarray:
            # truncate 3.5 at sigma 1.5 is a radius of 5 pixels.
            return gaussian_filter(image, 1.5, mode="constant", cval=0.0, truncate=3.5)

        mean_x, mean_y = local_mean(x), local_mean(y)
        variance_x = local_mean(x * x) - mean_x**2
        variance_y = local_mean(y * y) - mean_y**2
        covariance = local_mean(x * y) - mean_x * mean_y
        c1, c2 = 0.01**2, 0.03**2
        values = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
        values /= (mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2)
        if min(x.shape) >= 11:
            _, other = structural_similarity(
                y, x, data_range=1.0, gaussian_weights=True, sigma=1.5,
                use_sample_covariance=False, full=True,
            )
            inside = (slice(5, -5), slice(5, -5))
            assert np.abs(values[inside] - other[inside]).max() < 1e-9
        maps.append(values)
    return float(np.mean(maps))


METRICS = {"psnr": psnr, "psnr-channels": psnr_channels, "ssim": ssim, "ws-psnr": ws_psnr}


def make_goldens() -> None:
    """Scores the stored pairs into goldens.json."""
    pairs = {}
    for file in sorted(FOLDER.glob("*-prediction.png")):
        name = file.name.removesuffix("-prediction.png")
        prediction, truth = (
            np.asarray(Image.open(FOLDER / f"{name}-{kind}.png").convert("RGB")) / 255.0
            for kind in ("prediction", "truth")
        )
        pairs[name] = {metric: function(prediction, truth) for metric, function in METRICS.items()}
    versions = {
        "numpy": np.__version__,
        "pillow": PIL.__version__,
        "scikit-image": skimage.__version__,
        "scipy": scipy.__version__,
    }
    text = json.dumps({"made_with": versions, "pairs": pairs}, indent=2)
    (FOLDER / "goldens.json").write_text(text + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    pairs = commands.add_parser("pairs")
    pairs.add_argument("--street", type=Path, required=True)
    pairs.add_argument("--hall", type=Path, required=True)
    commands.add_parser("goldens")
    arguments = parser.parse_args()
    if arguments.command == "pairs":
        make_pairs(arguments.street, arguments.hall)
    else:
        make_goldens()


if __name__ == "__main__":
    main()
