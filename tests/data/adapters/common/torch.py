"""What scripts of adapters and stand-ins use of PyTorch: tensors that are kept and not computed with."""

import pickle

float32 = "float32"


class Tensor:
    def __init__(self, values, shape):
        self.values, self.shape = values, tuple(shape)

    def __getitem__(self, index):
        return self.values[index]


def shape_of(values):
    return (len(values), *shape_of(values[0])) if isinstance(values, list) else ()


def tensor(values, dtype=None):
    return Tensor(values, shape_of(values))


def ones(*shape):
    return Tensor(None, shape)


def save(value, path):
    with open(path, "wb") as file:
        pickle.dump(value, file)


def load(path, map_location=None):
    with open(path, "rb") as file:
        return pickle.load(file)
