"""LPIPS's VGG through a runtime that Python has: OpenCV's dnn module, tract, or PyTorch.

    runtimes_worker.py opencv|tract|torch MODEL.onnx INPUT.f32 WIDTH HEIGHT SAMPLES THREADS

Loads everything and prints its name, then answers every line of its input as `compare-runtimes` does.
"""

import json
import os
import sys
import time

import numpy as np

# Convolutions before the pooling, as runtimes/src/main.rs has them.
STAGES = [2, 2, 3, 3, 3]
SAMPLES = 4096


def opencv(model, threads):
    import cv2

    cv2.setNumThreads(threads)
    network = cv2.dnn.readNetFromONNX(model)
    names = [f"stage{index}" for index in range(len(STAGES))]

    def run(picture):
        network.setInput(picture)
        return network.forward(names)

    return run


def tract(model, _):
    import tract

    plan = tract.onnx().load(model).into_model().into_runnable()
    return lambda picture: [features.to_numpy() for features in plan.run([picture])]


def torch(_, threads):
    import torch
    from torch.nn import functional

    from runtimes_report import convolutions

    torch.set_num_threads(threads)
    layers = [tuple(torch.from_numpy(array) for array in layer) for layer in convolutions()]

    def run(picture):
        features, maps, layer = torch.from_numpy(picture), [], iter(layers)
        with torch.inference_mode():
            for index, count in enumerate(STAGES):
                if index:
                    features = functional.max_pool2d(features, 2)
                for _ in range(count):
                    kernel, bias = next(layer)
                    features = functional.relu(functional.conv2d(features, kernel, bias, padding=1))
                maps.append(features.numpy())
        return maps

    return run


def main():
    name, model, source, width, height, folder, threads = sys.argv[1:]
    picture = np.fromfile(source, np.float32).reshape(1, 3, int(height), int(width))
    run = {"opencv": opencv, "tract": tract, "torch": torch}[name](model, int(threads))
    print(name, flush=True)
    for _ in sys.stdin:
        begun, before = time.perf_counter(), time.process_time()
        maps = run(picture)
        answer = {
            "wall": time.perf_counter() - begun,
            "processor": time.process_time() - before,
        }
        at = np.arange(SAMPLES)
        samples = [
            features[0, at * 7 % features.shape[1], at * 13 % features.shape[2], at * 29 % features.shape[3]]
            for features in maps
        ]
        np.concatenate(samples).astype(np.float32).tofile(os.path.join(folder, f"{name}.f32"))
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
