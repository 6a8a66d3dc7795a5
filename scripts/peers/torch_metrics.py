"""Scores a folder as `omnilife bench score` does, with torchmetrics and lpips in PyTorch.

    python3 torch_metrics.py FOLDER MODELS METRIC... > result.json

FOLDER is that of metrics_scene.py, MODELS holds the weights that scripts/setup --models fetches.
Images are read once and scored one after the other, with all cores at each. The time begins when
everything is imported and the networks are there.
"""

import json
import resource
import sys
import time
from pathlib import Path

import lpips
import numpy as np
import torch
from PIL import Image
from safetensors.numpy import load_file
from torchmetrics.functional.image import (
    peak_signal_noise_ratio,
    structural_similarity_index_measure,
)


def network(net, models):
    model = lpips.LPIPS(net=net, pnet_rand=True, verbose=False).eval()
    weights = load_file(Path(models) / f"lpips-{net}.safetensors")
    layers = [layer for layer in model.net.modules() if isinstance(layer, torch.nn.Conv2d)]
    for number, layer in enumerate(layers):
        kernel = weights[f"convolution.{number}.kernel"].transpose(3, 2, 0, 1).copy()
        layer.weight.data = torch.from_numpy(kernel)
        layer.bias.data = torch.from_numpy(weights[f"convolution.{number}.bias"])
    return lambda p, t: model(p, t, normalize=True)


def read(path):
    image = np.asarray(Image.open(path).convert("RGB"), dtype=np.float32) / 255.0
    return torch.from_numpy(image.transpose(2, 0, 1).copy())[None]


def main():
    folder, models, *metrics = sys.argv[1:]
    functions = {
        "psnr": lambda p, t: peak_signal_noise_ratio(p, t, data_range=1.0),
        "ssim-skimage": lambda p, t: structural_similarity_index_measure(
            p, t, gaussian_kernel=True, sigma=1.5, kernel_size=11, data_range=1.0
        ),
    }
    for net in ("vgg", "alex"):
        if f"lpips-{net}" in metrics:
            functions[f"lpips-{net}"] = network(net, models)
    scene = json.loads((Path(folder) / "scene.json").read_text())
    sums = dict.fromkeys(metrics, 0.0)
    views = sorted((Path(folder) / "novel").iterdir())
    began, used = time.perf_counter(), time.process_time()
    with torch.no_grad():
        for view in views:
            prediction = read(view)
            truth = read(Path(folder) / scene["frames"][int(view.stem)]["image"])
            for metric in metrics:
                sums[metric] += float(functions[metric](prediction, truth))
    json.dump(
        {
            "wall_seconds": time.perf_counter() - began,
            "processor_seconds": time.process_time() - used,
            "peak_bytes": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024,
            "torch": torch.__version__,
            "threads": torch.get_num_threads(),
            "means": {metric: total / len(views) for metric, total in sums.items()},
        },
        sys.stdout,
    )


if __name__ == "__main__":
    main()
