"""LPIPS's VGG through our convolutions and through runtimes for networks, in turn on this machine.

    runtimes_report.py COMPARE_RUNTIMES IMAGE [ROUNDS [WIDTH HEIGHT]]

COMPARE_RUNTIMES is the program of `scripts/peers/runtimes`. The same weights, those of
`scripts/setup --models`, go to all: as an ONNX graph that is written here, or from their file. Whole
pictures go through thirteen convolutions with rectifiers and four poolings; the maps of all five stages
come back and are compared with PyTorch's. The first run of each is not counted; of the others the table
has the best and, behind it, the worst: a busy machine makes runs longer, never shorter.
"""

import json
import os
import re
import subprocess
import sys
import tempfile

import numpy as np

CHANNELS = [[64] * 2, [128] * 2, [256] * 3, [512] * 3, [512] * 3]
IN_PYTHON = ["opencv", "tract", "torch"]
# What has no way to set its threads from Python.
ONE_THREAD = ["tract"]
CRATES = {"candle": "candle-core", "rten": "rten"}
SHIFT, SCALE = [-0.030, -0.088, -0.188], [0.458, 0.448, 0.450]
LARGEST_DIFFERENCE = 1e-3


def convolutions():
    """Kernels (output, input, row, column) and biases of all convolutions."""
    from safetensors.numpy import load_file

    home = os.environ.get("HOME", "")
    data = os.environ.get("XDG_DATA_HOME") or os.path.join(home, ".local/share")
    folder = os.environ.get("OMNILIFE_DATA") or os.path.join(data, "omnilife")
    path = os.path.join(folder, "models", "lpips-vgg.safetensors")
    if not os.path.exists(path):
        sys.exit(f"{path} is missing: scripts/setup --models fetches it")
    tensors = load_file(path)
    return [
        (
            np.ascontiguousarray(tensors[f"convolution.{layer}.kernel"].transpose(3, 2, 0, 1)),
            tensors[f"convolution.{layer}.bias"],
        )
        for layer in range(sum(map(len, CHANNELS)))
    ]


def varint(value):
    out = b""
    while value > 127:
        out, value = out + bytes([value & 127 | 128]), value >> 7
    return out + bytes([value])


def field(number, value):
    """A field of a protocol buffer: a whole number, text, or bytes of a message."""
    if isinstance(value, int):
        return varint(number << 3) + varint(value)
    value = value.encode() if isinstance(value, str) else value
    return varint(number << 3 | 2) + varint(len(value)) + value


def node(kind, inputs, output, attributes):
    """onnx.NodeProto; attributes are lists of whole numbers."""
    message = b"".join(field(1, name) for name in inputs) + field(2, output) + field(4, kind)
    for name, values in attributes.items():
        packed = b"".join(field(8, value) for value in values)
        message += field(5, field(1, name) + packed + field(20, 7))
    return message


def tensor(name, array):
    """onnx.TensorProto of f32."""
    dimensions = b"".join(field(1, size) for size in array.shape)
    return dimensions + field(2, 1) + field(8, name) + field(9, array.astype("<f4").tobytes())


def value(name, shape):
    """onnx.ValueInfoProto of f32."""
    dimensions = b"".join(field(1, field(1, size)) for size in shape)
    return field(1, name) + field(2, field(1, field(1, 1) + field(2, dimensions)))


def onnx_model(layers, width, height):
    nodes, initializers, outputs, features = b"", b"", b"", "image"
    layer = 0
    for stage, channels in enumerate(CHANNELS):
        if stage:
            attributes = {"kernel_shape": [2, 2], "strides": [2, 2]}
            nodes += field(1, node("MaxPool", [features], f"pooled{stage}", attributes))
            features, width, height = f"pooled{stage}", width // 2, height // 2
        for number in range(len(channels)):
            kernel, bias = layers[layer]
            initializers += field(5, tensor(f"kernel{layer}", kernel))
            initializers += field(5, tensor(f"bias{layer}", bias))
            inputs = [features, f"kernel{layer}", f"bias{layer}"]
            attributes = {"kernel_shape": [3, 3], "pads": [1] * 4, "strides": [1, 1]}
            nodes += field(1, node("Conv", inputs, f"sum{layer}", attributes))
            features = f"stage{stage}" if number + 1 == len(channels) else f"features{layer}"
            nodes += field(1, node("Relu", [f"sum{layer}"], features, {}))
            layer += 1
        outputs += field(12, value(features, [1, channels[-1], height, width]))
    return nodes, initializers, outputs


def write_model(path, width, height):
    nodes, initializers, outputs = onnx_model(convolutions(), width, height)
    image = field(11, value("image", [1, 3, height, width]))
    graph = nodes + field(2, "vgg") + initializers + image + outputs
    opset = field(8, field(1, "") + field(2, 13))
    with open(path, "wb") as file:
        file.write(field(1, 8) + field(2, "omnilife") + field(7, graph) + opset)


def write_input(image, path, width, height):
    from PIL import Image

    with Image.open(image) as picture:
        picture = picture.convert("RGB").resize((width, height), Image.Resampling.BOX)
    values = (np.asarray(picture, np.float32) / 255 * 2 - 1 - SHIFT) / SCALE
    values.transpose(2, 0, 1).astype("<f4").tofile(path)


def largest_difference(found, expected):
    """Relative to the root mean square of each map."""
    shape = (len(CHANNELS), -1)
    found, expected = found.reshape(shape), expected.reshape(shape)
    typical = np.sqrt((expected.astype(np.float64) ** 2).mean(axis=1, keepdims=True))
    return float((np.abs(found - expected) / typical).max())


class Worker:
    """A process that names runtimes, and answers the name of one with the seconds that it took."""

    def __init__(self, command, threads):
        environment = dict(
            os.environ, RAYON_NUM_THREADS=str(threads), OMP_NUM_THREADS=str(threads)
        )
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
        )
        self.runtimes = self.process.stdout.readline().split()
        if not self.runtimes:
            sys.exit(f"{command[0]} failed")

    def run(self, name):
        self.process.stdin.write(name + "\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline()
        if not answer:
            sys.exit(f"{name} failed")
        return json.loads(answer)

    def end(self):
        self.process.stdin.close()
        self.process.wait()


def versions():
    """Of the peers: those that the crate beside this file is built with, and Python's."""
    import cv2
    import torch
    import tract

    folder = os.path.dirname(os.path.abspath(__file__))
    with open(os.path.join(folder, "runtimes", "Cargo.lock"), encoding="utf-8") as file:
        locked = dict(re.findall(r'name = "(.+)"\nversion = "(.+)"', file.read()))
    crates = {name: locked[crate] for name, crate in CRATES.items()}
    peers = {"opencv": cv2.__version__, "torch": torch.__version__, "tract": tract.version()}
    return crates | peers


def measure(program, folder, threads, rounds, size):
    """Seconds of every counted run, by runtime, and how far its maps are from PyTorch's."""
    arguments = [os.path.join(folder, "vgg.onnx"), os.path.join(folder, "image.f32")]
    arguments += [*map(str, size), folder]
    script = os.path.join(os.path.dirname(os.path.abspath(__file__)), "runtimes_worker.py")
    commands = [[program, *arguments]]
    commands += [
        [sys.executable, script, name, *arguments, str(threads)]
        for name in IN_PYTHON
        if threads == 1 or name not in ONE_THREAD
    ]
    workers = {}
    for command in commands:
        worker = Worker(command, threads)
        workers |= dict.fromkeys(worker.runtimes, worker)
    seconds = {name: [] for name in workers}
    for turn in range(rounds + 1):
        for name, worker in workers.items():
            answer = worker.run(name)
            print(f"  {threads} threads, turn {turn}, {name}: {answer}", file=sys.stderr, flush=True)
            if turn:
                seconds[name].append(answer)
    for worker in set(workers.values()):
        worker.end()
    samples = {name: np.fromfile(os.path.join(folder, f"{name}.f32"), "<f4") for name in seconds}
    differences = {
        name: largest_difference(found, samples["torch"]) for name, found in samples.items()
    }
    return seconds, differences


def best(runs, what):
    return min(run[what] for run in runs)


def cell(runs, what):
    return f"{best(runs, what):.2f} (to {max(run[what] for run in runs):.2f})"


def main():
    program, image = sys.argv[1:3]
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 3
    size = tuple(map(int, sys.argv[4:6])) if len(sys.argv) > 5 else (512, 256)
    with tempfile.TemporaryDirectory() as folder:
        write_model(os.path.join(folder, "vgg.onnx"), *size)
        write_input(image, os.path.join(folder, "image.f32"), *size)
        results = {
            threads: measure(program, folder, threads, rounds, size) for threads in (1, 2)
        }
    known = versions()
    print(f"VGG of LPIPS, {size[0]}x{size[1]}, {rounds} rounds in turn: best (to worst)\n")
    print("| | threads | wall s | processor s | processor, of ours | apart from PyTorch |")
    print("|---|---:|---:|---:|---:|---:|")
    failed = set()
    for threads, (seconds, differences) in results.items():
        ours = best(seconds["omnilife"], "processor")
        for name, runs in seconds.items():
            if not differences[name] <= LARGEST_DIFFERENCE:
                failed.add(name)
            print(
                f"| {name} {known.get(name, '')} | {threads} | {cell(runs, 'wall')} "
                f"| {cell(runs, 'processor')} | {best(runs, 'processor') / ours:.2f} "
                f"| {differences[name]:.1e} |"
            )
    if failed:
        sys.exit(f"more than {LARGEST_DIFFERENCE} apart from PyTorch: {', '.join(sorted(failed))}")


if __name__ == "__main__":
    main()
