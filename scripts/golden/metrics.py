#!/usr/bin/env python3
"""Golden values of bench's metrics, from implementations apart from the Rust ones.

PSNR and `ssim-skimage` come from scikit-image. SSIM is the definition of 3DGS (utils/loss_utils.py:
11x11 Gaussian of sigma 1.5, zero padding, mean over the map) through scipy's Gaussian filter, and
its inside is checked here against scikit-image's map. LPIPS is the authors' package in PyTorch, its
backbones filled with the weights that scripts/setup --models fetches. WS-PSNR and WS-SSIM are the
formulas with weights sin((j + 1/2) pi / H). Cube faces are sampled with scipy.

    python3 -m venv peers
    peers/bin/pip install numpy scipy scikit-image pillow safetensors torchvision==0.29.2 lpips==0.1.4
    peers/bin/python scripts/golden/metrics.py pairs --street STREET/rgb --hall HALL/rgb
    peers/bin/python scripts/golden/metrics.py goldens [--models FOLDER]

`pairs` makes the image pairs, `goldens` scores the stored ones. goldens.json names the versions it
was made with. Masks, depth and the views before are made from the images by rules that
bench/tests/all/metrics.rs follows too (`evidence`).
"""

import argparse
import io
import json
import os
from pathlib import Path

import numpy as np
import PIL
import scipy
import skimage
from PIL import Image
from scipy.ndimage import gaussian_filter, map_coordinates
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

    def blurred(image: np.ndarray, sigma: float) -> np.ndarray:
        return gaussian_filter(image.astype(float), (sigma, sigma, 0)).round().astype(np.uint8)

    def tinted(image: np.ndarray) -> np.ndarray:
        return np.clip(image * [1.1, 0.95, 0.8] + 6, 0, 255).round().astype(np.uint8)

    street_96 = frame(street, 10, (96, 48))
    street_65 = frame(street, 20, (65, 33))
    street_80 = frame(street, 30, (80, 40))
    hall_48 = frame(hall, 5, (48, 24)).copy()
    one_channel = hall_48.copy()
    one_channel[..., 1] = noisy(hall_48[..., 1], 12.0)
    pairs = {
        "compressed": (jpeg(street_96, 25), street_96),
        "noise-odd-size": (noisy(street_65, 8.0), street_65),
        "blur-and-shift": (np.roll(blurred(street_80, 1.2), 2, axis=1), street_80),
        "motion": (frame(street, 14, (64, 32)), frame(street, 10, (64, 32))),
        "smaller-than-window": (frame(hall, 12, (7, 5)), frame(hall, 2, (7, 5))),
        "narrow": (frame(hall, 12, (3, 40)), frame(hall, 2, (3, 40))),
        "one-channel": (one_channel, hall_48),
        "identical": (hall_48, hall_48),
        "black-white": (np.zeros((12, 24, 3), np.uint8), np.full((12, 24, 3), 255, np.uint8)),
        "one-pixel": (np.full((1, 1, 3), 90, np.uint8), np.full((1, 1, 3), 120, np.uint8)),
        "hall-blurred": (blurred(frame(hall, 20, (64, 32)), 0.8), frame(hall, 20, (64, 32))),
        "hall-compressed": (jpeg(frame(hall, 30, (72, 36)), 10), frame(hall, 30, (72, 36))),
        "hall-motion": (frame(hall, 41, (70, 35)), frame(hall, 40, (70, 35))),
        "hall-tinted": (tinted(frame(hall, 50, (62, 31))), frame(hall, 50, (62, 31))),
        "street-tinted": (tinted(frame(street, 40, (64, 32))), frame(street, 40, (64, 32))),
        "street-mirrored": (frame(street, 45, (66, 33))[:, ::-1], frame(street, 45, (66, 33))),
        "street-upside-down": (frame(street, 50, (64, 32))[::-1], frame(street, 50, (64, 32))),
        "quarter-turn": (
            np.roll(frame(street, 55, (64, 32)), 16, axis=1),
            frame(street, 55, (64, 32)),
        ),
        "least-of-vgg": (frame(street, 3, (16, 16)), frame(street, 2, (16, 16))),
        "below-alex": (frame(street, 7, (60, 30)), frame(street, 6, (60, 30))),
        "least-of-alex": (frame(hall, 7, (31, 31)), frame(hall, 6, (31, 31))),
        "square-odd": (noisy(frame(hall, 33, (47, 45)), 20.0), frame(hall, 33, (47, 45))),
        "tall": (jpeg(frame(street, 22, (33, 70)), 40), frame(street, 22, (33, 70))),
        "grey": (np.full((32, 64, 3), 128, np.uint8), frame(street, 35, (64, 32))),
        "identical-street": (street_96, street_96),
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


def row_weights(truth: np.ndarray) -> np.ndarray:
    height = truth.shape[0]
    weights = np.sin((np.arange(height) + 0.5) * np.pi / height)
    return np.broadcast_to(weights[:, None, None], truth.shape)


def ws_psnr(prediction: np.ndarray, truth: np.ndarray) -> float:
    return decibels(float(np.average((prediction - truth) ** 2, weights=row_weights(truth))))


def ssim_map(prediction: np.ndarray, truth: np.ndarray) -> np.ndarray:
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
    return np.stack(maps, axis=-1)


def ssim_skimage(prediction: np.ndarray, truth: np.ndarray) -> float | None:
    if min(truth.shape[:2]) < 11:
        return None
    return float(structural_similarity(
        truth, prediction, win_size=11, gaussian_weights=True, channel_axis=-1, data_range=1.0,
    ))


def ssim_uniform(prediction: np.ndarray, truth: np.ndarray) -> float | None:
    if min(truth.shape[:2]) < 7:
        return None
    return float(structural_similarity(truth, prediction, channel_axis=-1, data_range=1.0))


def ssim_4dgf(prediction: np.ndarray, truth: np.ndarray) -> float | None:
    """Mip-NeRF's SSIM, which map4d's common/metric.py has: valid windows, moments held in their bounds."""
    if min(truth.shape[:2]) < 11:
        return None
    offsets = np.arange(11) - 5
    window = np.exp(-0.5 * (offsets / 1.5) ** 2)
    window /= window.sum()

    def valid(image: np.ndarray) -> np.ndarray:
        rows = np.stack([np.convolve(line, window, "valid") for line in image])
        return np.stack([np.convolve(line, window, "valid") for line in rows.T]).T

    means = []
    for c in range(3):
        x, y = prediction[..., c], truth[..., c]
        mean_x, mean_y = valid(x), valid(y)
        variance_x = np.maximum(valid(x * x) - mean_x**2, 0)
        variance_y = np.maximum(valid(y * y) - mean_y**2, 0)
        covariance = valid(x * y) - mean_x * mean_y
        most = np.sqrt(variance_x * variance_y)
        covariance = np.sign(covariance) * np.minimum(most, np.abs(covariance))
        c1, c2 = 0.01**2, 0.03**2
        above = (2 * mean_x * mean_y + c1) * (2 * covariance + c2)
        below = (mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2)
        means.append(np.mean(above / below))
    return float(np.mean(means))


def objects(score, prediction: np.ndarray, truth: np.ndarray, masks: list, is_masked: bool) -> float | None:
    """The mean over masks of a score of their boxes, black outside of the mask where asked for."""
    scores = []
    for mask in masks:
        if not mask.any():
            continue
        rows, columns = np.nonzero(mask)
        box = (slice(rows.min(), rows.max() + 1), slice(columns.min(), columns.max() + 1))
        inside = mask[box][..., None] if is_masked else True
        scores.append(score(prediction[box] * inside, truth[box] * inside))
    scores = [value for value in scores if value is not None]
    return float(np.mean(scores)) if scores else None


def cube_faces(image: np.ndarray) -> list[np.ndarray]:
    """Front, right, back, left, up, down; half as wide as the image is high."""
    height, width = image.shape[:2]
    side = max(1, height // 2)
    centres = (2 * np.arange(side) + 1) / side - 1
    b, a = np.meshgrid(centres, centres, indexing="ij")
    one = np.ones_like(a)
    directions = [(a, b, one), (one, b, -a), (-a, b, -one), (-one, b, a), (a, -one, b), (a, one, -b)]
    faces = []
    for x, y, z in directions:
        column = (np.arctan2(x, z) / (2 * np.pi) + 0.5) * width - 0.5
        row = (0.5 - np.arctan2(-y, np.hypot(x, z)) / np.pi) * height - 0.5
        # The seam and the poles by hand: a wrapped column and repeated rows on every side.
        padded = np.pad(np.pad(image, ((1, 1), (0, 0), (0, 0)), "edge"), ((0, 0), (1, 1), (0, 0)), "wrap")
        faces.append(np.stack([
            map_coordinates(padded[..., c], [row + 1, column + 1], order=1) for c in range(3)
        ], axis=-1))
    return faces


def cube(score, prediction: np.ndarray, truth: np.ndarray) -> float | None:
    pairs = zip(cube_faces(prediction), cube_faces(truth))
    scores = [score(p, t) for p, t in pairs]
    return None if None in scores else float(np.mean(scores))


def masked(prediction: np.ndarray, truth: np.ndarray, mask: np.ndarray) -> tuple:
    if not mask.any():
        return None, None
    errors = (prediction - truth)[mask] ** 2
    return decibels(float(errors.mean())), float(ssim_map(prediction, truth)[mask].mean())


def evidence(prediction: np.ndarray, truth: np.ndarray) -> dict:
    """Masks, depth and the view before, by rule from 8-bit images."""
    rows, columns = np.indices(truth.shape[:2])
    return {
        "dynamic": (columns + 2 * rows) % 7 < 3,
        "human": (columns + rows) % 5 == 0,
        # Empty in small images.
        "vehicle": (columns > 40) & (rows > 10),
        # Red is distance: 0 is unknown.
        "depth": (prediction[..., 0] / 16.0, truth[..., 0] / 16.0),
        "before": (prediction[:, ::-1], truth[:, ::-1]),
    }


def depth_errors(prediction: np.ndarray, truth: np.ndarray) -> tuple:
    known = truth > 0
    if not known.any():
        return None, None
    d, true = prediction[known], truth[known]
    with np.errstate(divide="ignore"):
        ratio = np.maximum(d / true, true / d)
    return float(np.mean(np.abs(d - true) / true)), float(np.mean(ratio < 1.25))


class Lpips:
    """The authors' package with the published backbones."""

    SMALLEST = {"alex": 31, "vgg": 16}

    def __init__(self, net: str, models: Path):
        import lpips
        import torch
        from safetensors.numpy import load_file

        self.net, self.torch = net, torch
        self.network = lpips.LPIPS(net=net, pnet_rand=True, verbose=False).eval()
        weights = load_file(models / f"lpips-{net}.safetensors")
        layers = [m for m in self.network.net.modules() if isinstance(m, torch.nn.Conv2d)]
        for number, layer in enumerate(layers):
            kernel = weights[f"convolution.{number}.kernel"].transpose(3, 2, 0, 1).copy()
            layer.weight.data = torch.from_numpy(kernel)
            layer.bias.data = torch.from_numpy(weights[f"convolution.{number}.bias"])
        for number, linear in enumerate(self.network.lins):
            stored = linear.model[-1].weight.detach().numpy().ravel()
            assert (stored == weights[f"linear.{number}.weight"]).all()

    def __call__(self, left: np.ndarray, right: np.ndarray, signed: bool = True) -> float | None:
        if min(left.shape[:2]) < self.SMALLEST[self.net]:
            return None
        tensors = [
            self.torch.from_numpy(image.transpose(2, 0, 1)[None].astype(np.float32))
            for image in (left, right)
        ]
        with self.torch.no_grad():
            return float(self.network(*tensors, normalize=signed))


def score(prediction8: np.ndarray, truth8: np.ndarray, networks: dict) -> dict:
    prediction, truth = prediction8 / 255.0, truth8 / 255.0
    known = evidence(prediction8, truth8)
    values = {
        "psnr": psnr(prediction, truth),
        "psnr-channels": psnr_channels(prediction, truth),
        "ssim": float(np.mean(ssim_map(prediction, truth))),
        "ssim-skimage": ssim_skimage(prediction, truth),
        "ssim-skimage-uniform": ssim_uniform(prediction, truth),
        "ssim-4dgf": ssim_4dgf(prediction, truth),
        "ws-psnr": ws_psnr(prediction, truth),
        "ws-ssim": float(np.average(ssim_map(prediction, truth), weights=row_weights(truth))),
        "cube-psnr": cube(psnr, prediction, truth),
        "cube-ssim": cube(ssim_skimage, prediction, truth),
    }
    for name, mask in [
        ("static", ~known["dynamic"]), ("dynamic", known["dynamic"]),
        ("human", known["human"]), ("vehicle", known["vehicle"]),
    ]:
        values[f"psnr-{name}"], values[f"ssim-{name}"] = masked(prediction, truth, mask)
    masks = [known["human"], known["vehicle"]]
    for suffix, is_masked in [("", False), ("-masked", True)]:
        values[f"psnr-object{suffix}"] = objects(psnr, prediction, truth, masks, is_masked)
        values[f"ssim-object{suffix}"] = objects(ssim_uniform, prediction, truth, masks, is_masked)
    for net, network in networks.items():
        values[f"lpips-{net}"] = network(prediction, truth)
        values[f"lpips-{net}-unscaled"] = network(prediction, truth, signed=False)
    before = [image / 255.0 for image in known["before"]]
    changes = [networks["alex"](*pair) for pair in zip(before, (prediction, truth))]
    values["temporal-lpips"], values["temporal-lpips-truth"] = changes
    values["temporal-lpips-error"] = None if None in changes else abs(changes[0] - changes[1])
    values["depth-abs-rel"], values["depth-delta"] = depth_errors(*known["depth"])
    return values


WITHOUT_NETWORKS = {
    "ssim-skimage": ssim_skimage,
    "ssim-skimage-uniform": ssim_uniform,
    "ssim-4dgf": ssim_4dgf,
}


def stored_pairs() -> dict:
    """Prediction and ground truth by name."""
    names = sorted(file.name.removesuffix("-prediction.png") for file in FOLDER.glob("*-prediction.png"))
    kinds = ("prediction", "truth")
    return {
        name: [np.asarray(Image.open(FOLDER / f"{name}-{kind}.png").convert("RGB")) for kind in kinds]
        for name in names
    }


def add_golden(metric: str, function) -> None:
    """Puts the values of one metric without a network into goldens.json, and leaves the others."""
    path = FOLDER / "goldens.json"
    known = json.loads(path.read_text())
    for name, (prediction, truth) in stored_pairs().items():
        known["pairs"][name][metric] = function(prediction / 255.0, truth / 255.0)
    path.write_text(json.dumps(known, indent=2) + "\n")


def make_goldens(models: Path) -> None:
    """Scores the stored pairs into goldens.json."""
    import lpips  # noqa: F401
    import torch

    networks = {net: Lpips(net, models) for net in ("alex", "vgg")}
    pairs = {name: score(*pair, networks) for name, pair in stored_pairs().items()}
    versions = {
        "lpips": "0.1.4",
        "numpy": np.__version__,
        "pillow": PIL.__version__,
        "scikit-image": skimage.__version__,
        "scipy": scipy.__version__,
        "torch": torch.__version__,
    }
    text = json.dumps({"made_with": versions, "pairs": pairs}, indent=2)
    (FOLDER / "goldens.json").write_text(text + "\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    pairs = commands.add_parser("pairs")
    pairs.add_argument("--street", type=Path, required=True)
    pairs.add_argument("--hall", type=Path, required=True)
    goldens = commands.add_parser("goldens")
    data = Path(os.environ.get("OMNILIFE_DATA") or Path.home() / ".local/share/omnilife")
    goldens.add_argument("--models", type=Path, default=data / "models")
    add = commands.add_parser("add", help="only the values of a metric that needs no network")
    add.add_argument("metric", choices=WITHOUT_NETWORKS)
    arguments = parser.parse_args()
    if arguments.command == "pairs":
        make_pairs(arguments.street, arguments.hall)
    elif arguments.command == "add":
        add_golden(arguments.metric, WITHOUT_NETWORKS[arguments.metric])
    else:
        make_goldens(arguments.models)


if __name__ == "__main__":
    main()
