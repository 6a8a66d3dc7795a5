"""What the metadata of map4d needs of NumPy: arrays that are kept and not computed with."""

float64 = float
int64 = int


def flat(values):
    return [one for value in values for one in flat(value)] if isinstance(values, list) else [values]


def shape_of(values):
    return (len(values), *shape_of(values[0] if values else None)) if isinstance(values, list) else ()


class ndarray:
    def __init__(self, values, dtype, shape):
        self.values, self.dtype, self.shape = values, dtype, shape

    def reshape(self, rows, columns):
        values = flat(self.values)
        assert len(values) == rows * columns, f"{len(values)} values for {rows} x {columns}"
        lines = [values[columns * row : columns * (row + 1)] for row in range(rows)]
        return ndarray(lines, self.dtype, (rows, columns))

    def tolist(self):
        return self.values


def array(values, dtype):
    def converted(inner):
        return [converted(value) for value in inner] if isinstance(inner, list) else dtype(inner)

    return ndarray(converted(values), dtype, shape_of(values))
