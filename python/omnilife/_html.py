"""Views of objects for notebooks: HTML of facts, tables and small images."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from ._arrays import U8

#: Rows of a table that are shown.
MOST_ROWS = 20
#: Columns of an image that stands for a larger one.
THUMBNAIL_WIDTH = 256


def facts(title: str, rows: Mapping[str, object], below: str = "") -> str:
    """Returns names with values; those that are None are left out. `below` is HTML."""
    cells = (
        f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(_text(value))}</td></tr>"
        for name, value in rows.items()
        if value is not None
    )
    return f"<b>{escape(title)}</b><table>{''.join(cells)}</table>{below}"


def table(columns: Mapping[str, Sequence[Any]]) -> str:
    """Returns columns of equal length as a table of `MOST_ROWS` rows at most, with the count of all."""
    rows = list(zip(*columns.values()))
    head = "".join(f"<th>{escape(name)}</th>" for name in columns)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(_text(value))}</td>" for value in row) + "</tr>"
        for row in rows[:MOST_ROWS]
    )
    count = f"{len(rows)} rows" if len(rows) <= MOST_ROWS else f"{MOST_ROWS} of {len(rows)} rows"
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table><p>{count}</p>"


def image(pixels: U8) -> str:
    """Returns an image (height, width, 3) as a PNG within the page."""
    height, width, _ = pixels.shape

    def chunk(kind: bytes, content: bytes) -> bytes:
        checked = zlib.crc32(kind + content)
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checked)

    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    data = base64.b64encode(b"\x89PNG\r\n\x1a\n" + chunks).decode()
    return f'<img width="{width}" height="{height}" src="data:image/png;base64,{data}"/>'


def image_file(path: Path) -> str:
    """Returns the image in a PNG file within the page, small, or why it cannot be read."""
    try:
        data = base64.b64encode(path.read_bytes()).decode()
    except OSError as error:
        return f"<p>{escape(f'{path}: cannot be read: {error.strerror}')}</p>"
    return f'<img width="{THUMBNAIL_WIDTH}" src="data:image/png;base64,{data}"/>'


def _text(value: object) -> str:
    if value is None:
        return ""
    return f"{value:.6g}" if isinstance(value, float) else str(value)
