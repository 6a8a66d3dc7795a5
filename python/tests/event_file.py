"""A reader of TensorBoard's event files, written from the formats of TFRecord and Protocol Buffers alone."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Union

#: A field of a message: its number with an integer, or with bytes.
Field = tuple[int, Union[int, bytes]]


@dataclass
class Event:
    """What happened at one iteration."""

    step: int = 0
    version: str = ""
    starts_session: bool = False
    scalars: dict[str, float] = field(default_factory=dict)
    #: Width, height and PNG by tag.
    images: dict[str, tuple[int, int, bytes]] = field(default_factory=dict)


def read_events(file: Path) -> list[Event]:
    """Returns the events of a file; fails where a length or a check sum is wrong."""
    return [_event(data) for data in _frames(file.read_bytes())]


def _frames(data: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(data):
        (length,) = struct.unpack_from("<Q", data, at)
        (of_length,) = struct.unpack_from("<I", data, at + 8)
        assert of_length == _masked_crc(data[at : at + 8]), "the check sum of a length"
        content = data[at + 12 : at + 12 + length]
        (of_content,) = struct.unpack_from("<I", data, at + 12 + length)
        assert of_content == _masked_crc(content), "the check sum of an event"
        yield content
        at += 16 + length


def _event(data: bytes) -> Event:
    event = Event()
    for number, value in _fields(data):
        if number == 2 and isinstance(value, int):
            event.step = value
        elif number == 3 and isinstance(value, bytes):
            event.version = value.decode()
        elif number == 5 and isinstance(value, bytes):
            for _, entry in _fields(value):
                assert isinstance(entry, bytes)
                _add_value(event, dict(_fields(entry)))
        elif number == 7 and isinstance(value, bytes):
            event.starts_session = dict(_fields(value)) == {1: 1}
    return event


def _add_value(event: Event, value: dict[int, Union[int, bytes]]) -> None:
    tag, number, image = value[1], value.get(2), value.get(4)
    assert isinstance(tag, bytes)
    if isinstance(number, bytes):
        (event.scalars[tag.decode()],) = struct.unpack("<f", number)
    elif isinstance(image, bytes):
        height, width, colours, png = (dict(_fields(image))[key] for key in (1, 2, 3, 4))
        assert isinstance(height, int) and isinstance(width, int) and isinstance(png, bytes)
        assert colours == 3, "RGB"
        event.images[tag.decode()] = (width, height, png)


def _fields(data: bytes) -> Iterator[Field]:
    at = 0
    while at < len(data):
        key, at = _varint(data, at)
        kind, number = key & 7, key >> 3
        if kind == 0:
            value, at = _varint(data, at)
            yield number, value
            continue
        if kind == 2:
            length, at = _varint(data, at)
        else:
            length = {1: 8, 5: 4}[kind]
        yield number, data[at : at + length]
        at += length


def _varint(data: bytes, at: int) -> tuple[int, int]:
    value, shift = 0, 0
    while True:
        value |= (data[at] & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if data[at - 1] < 0x80:
            return value, at


def _masked_crc(data: bytes) -> int:
    """The CRC-32C bit by bit, turned and shifted."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (0x82F63B78 if crc & 1 else 0)
    crc ^= 0xFFFFFFFF
    return ((crc >> 15 | crc << 17) + 0xA282EAD8) & 0xFFFFFFFF
