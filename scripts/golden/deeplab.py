"""Golden scores for curate/tests/all/deeplab.rs, by walking the published graph with PyTorch.

    python3 scripts/golden/deeplab.py NPM_TARBALL >curate/tests/golden/deeplab.json

NPM_TARBALL is the package @codait/max-image-segmenter 0.3.0 (`npm pack` fetches it). Every node of
its graph is executed as TensorFlow defines it, with no knowledge of the network: this is what the
native network is held against. The picture is made by a formula, so that both sides have it.
"""

import io
import json
import math
import sys
import tarfile

import numpy
import torch
import torch.nn.functional as F

SIDE = 513
PLACES = [(0, 0), (0, 64), (64, 0), (64, 64), (32, 32), (10, 50), (47, 21), (5, 33), (60, 12)]


def picture():
    """Rings and ramps with hard edges: all three channels, 513x513."""
    y, x = numpy.mgrid[0:SIDE, 0:SIDE]
    rings = (x - 200) ** 2 + (y - 300) ** 2
    red = (x * 7 + y * 3) % 256
    green = (rings // 97) % 256
    blue = numpy.where((x // 64 + y // 48) % 2 == 0, 220, 35)
    return numpy.stack([red, green, blue], axis=-1).astype(numpy.uint8)


def load(tarball):
    with tarfile.open(tarball) as archive:
        read = lambda name: archive.extractfile(f"package/model/{name}").read()
        model = json.loads(read("model.json"))
        (group,) = model["weightsManifest"]
        data = io.BytesIO(b"".join(read(name) for name in group["paths"]))
    weights = {}
    for entry in group["weights"]:
        kind = {"float32": "<f4", "int32": "<i4"}[entry["dtype"]]
        values = numpy.frombuffer(data.read(4 * math.prod(entry["shape"])), kind)
        weights[entry["name"]] = torch.from_numpy(values.reshape(entry["shape"]).copy())
    return {node["name"]: node for node in model["modelTopology"]["node"]}, weights


def same_padding(size, kernel, stride):
    total = max((math.ceil(size / stride) - 1) * stride + kernel - size, 0)
    return total // 2, total - total // 2


def convolve(node, value, kernel, groups):
    attributes = node["attr"]
    stride = int(attributes["strides"]["list"]["i"][1])
    value = value.permute(0, 3, 1, 2)
    if attributes["padding"]["s"] == "U0FNRQ==":  # SAME
        top, bottom = same_padding(value.shape[2], kernel.shape[0], stride)
        left, right = same_padding(value.shape[3], kernel.shape[1], stride)
        value = F.pad(value, (left, right, top, bottom))
    if groups == 1:
        kernel = kernel.permute(3, 2, 0, 1)
    else:
        kernel = kernel.permute(2, 3, 0, 1)
    return F.conv2d(value, kernel, stride=stride, groups=groups).permute(0, 2, 3, 1)


def space_to_batch(value, block, paddings):
    (top, bottom), (left, right) = paddings.tolist()
    value = F.pad(value, (0, 0, left, right, top, bottom))
    n, h, w, c = value.shape
    b = block.tolist()
    value = value.reshape(n, h // b[0], b[0], w // b[1], b[1], c)
    return value.permute(2, 4, 0, 1, 3, 5).reshape(b[0] * b[1] * n, h // b[0], w // b[1], c)


def batch_to_space(value, block, crops):
    b = block.tolist()
    n, h, w, c = value.shape
    value = value.reshape(b[0], b[1], n // (b[0] * b[1]), h, w, c)
    value = value.permute(2, 3, 0, 4, 1, 5).reshape(n // (b[0] * b[1]), h * b[0], w * b[1], c)
    (top, bottom), (left, right) = crops.tolist()
    return value[:, top : value.shape[1] - bottom, left : value.shape[2] - right]


def run(nodes, weights, start, end):
    """The value of node `end`, where `start` gives those of some nodes."""
    values = dict(start)

    def value(name):
        if name not in values:
            values[name] = weights[name] if name in weights else apply(nodes[name])
        return values[name]

    def apply(node):
        inputs = [value(name) for name in node["input"]]
        match node["op"]:
            case "Conv2D":
                return convolve(node, *inputs, groups=1)
            case "DepthwiseConv2dNative":
                return convolve(node, *inputs, groups=inputs[0].shape[3])
            case "Mul":
                return inputs[0] * inputs[1]
            case "Sub":
                return inputs[0] - inputs[1]
            case "Add" | "AddN" | "BiasAdd":
                return sum(inputs[1:], inputs[0])
            case "Relu6":
                return inputs[0].clamp(0, 6)
            case "Relu":
                return inputs[0].clamp(min=0)
            case "SpaceToBatchND":
                return space_to_batch(*inputs)
            case "BatchToSpaceND":
                return batch_to_space(*inputs)
            case "AvgPool":
                return inputs[0].mean((1, 2), keepdim=True)
            case "ResizeBilinear":
                size = inputs[1].tolist()
                resized = F.interpolate(
                    inputs[0].permute(0, 3, 1, 2), size=size, mode="bilinear", align_corners=True
                )
                return resized.permute(0, 2, 3, 1)
            case "ConcatV2":
                return torch.cat(inputs[:-1], dim=int(inputs[-1]))
        raise ValueError(f"{node['name']} is a {node['op']}")

    return value(end)


def main():
    torch.set_num_threads(2)
    sys.setrecursionlimit(10_000)
    nodes, weights = load(sys.argv[1])
    image = torch.from_numpy(picture().astype(numpy.float32))[None]
    # A picture of full size is not padded: the graph's own preparation leaves it as it is.
    with torch.no_grad():
        scores = run(nodes, weights, {"ExpandDims_1": image}, "logits/semantic/BiasAdd")[0]
    assert scores.shape == (65, 65, 21), scores.shape
    rows = [
        {"row": row, "column": column, "scores": [round(v, 5) for v in scores[row, column].tolist()]}
        for row, column in PLACES
    ]
    classes = torch.bincount(scores.argmax(-1).flatten(), minlength=21).tolist()
    print(json.dumps({"torch": torch.__version__, "classes": classes, "places": rows}, indent=1))


if __name__ == "__main__":
    main()
