"""Points of an exported scene in the column types that a reader asks for. Needs nothing but Python."""

import struct

CODES = {"float": "f", "double": "d", "uchar": "B"}


def read(path):
    """Returns the rows of a binary little-endian PLY of vertices as dictionaries."""
    data = path.read_bytes()
    head, _, body = data.partition(b"end_header\n")
    lines = head.decode("ascii").splitlines()
    if lines[:2] != ["ply", "format binary_little_endian 1.0"]:
        raise SystemExit(f"{path}: must be a binary little-endian PLY")
    count = next(int(line.split()[2]) for line in lines if line.startswith("element vertex"))
    columns = [line.split()[1:] for line in lines if line.startswith("property")]
    row = struct.Struct("<" + "".join(CODES[kind] for kind, _ in columns))
    names = [name for _, name in columns]
    rows = row.iter_unpack(body[: count * row.size])
    return [dict(zip(names, values)) for values in rows]


def write(path, rows, columns):
    """Writes rows with these (type, name) columns; a column that a row lacks is 0."""
    row = struct.Struct("<" + "".join(CODES[kind] for kind, _ in columns))
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(rows)}"]
    head += [f"property {kind} {name}" for kind, name in columns] + ["end_header", ""]
    body = b"".join(row.pack(*(point.get(name, 0) for _, name in columns)) for point in rows)
    path.write_bytes("\n".join(head).encode("ascii") + body)
