"""What an OpenEXR file says of itself, read before its pixels are (OpenEXR file layout, version 2)."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import BinaryIO

_MULTI_PART, _DEEP = 0x1000, 0x800  # bits of the version field
_KINDS = ("uint", "half", "float")
_LONGEST_NAME = 255
_LONGEST_LIST = 1 << 20  # bytes: ten thousands of channels
_MOST_ATTRIBUTES = 10_000


@dataclass(frozen=True)
class ExrHeader:
    """Of the first part: channel name to kind in the file's order, (width, height); and whether more follow."""

    channels: dict[str, str]
    size: tuple[int, int]
    parts: bool


def read_exr_header(stream: BinaryIO) -> ExrHeader:
    """Read the header from the start of a file.

    Raises
    ------
    ValueError
        If it is damaged, or the file holds deep pixels.
    """
    _magic, version = struct.unpack("<II", _exactly(stream, 8))
    if version & _DEEP:
        raise ValueError("deep pixels, a list of samples each, are no picture yet")
    channels: dict[str, str] | None = None
    size: tuple[int, int] | None = None
    for _ in range(_MOST_ATTRIBUTES):
        name = _text(stream)
        if not name:
            break
        _text(stream)  # its type, which the name implies
        (length,) = struct.unpack("<I", _exactly(stream, 4))
        if name == "channels" and length <= _LONGEST_LIST:
            channels = _channels(_exactly(stream, length))
        elif name == "dataWindow" and length == 16:
            left, top, right, bottom = struct.unpack("<iiii", _exactly(stream, 16))
            size = right - left + 1, bottom - top + 1
        else:
            stream.seek(length, 1)
    if not channels or size is None:
        raise ValueError("the header names no channels or no size")
    return ExrHeader(channels, size, bool(version & _MULTI_PART))


def _channels(data: bytes) -> dict[str, str]:
    channels = {}
    while data[:1] not in (b"\0", b""):
        name, _, rest = data.partition(b"\0")
        if len(rest) < 16:
            raise ValueError("the list of channels ends early")
        (kind,) = struct.unpack_from("<I", rest)
        if kind >= len(_KINDS):
            raise ValueError(f"channel of kind {kind}; 0 to {len(_KINDS) - 1} are known")
        channels[name.decode(errors="replace")] = _KINDS[kind]
        data = rest[16:]
    return channels


def _text(stream: BinaryIO) -> str:
    letters = bytearray()
    while (letter := _exactly(stream, 1)) != b"\0":
        letters += letter
        if len(letters) > _LONGEST_NAME:
            raise ValueError(f"a name in the header is longer than {_LONGEST_NAME} bytes")
    return letters.decode(errors="replace")


def _exactly(stream: BinaryIO, count: int) -> bytes:
    data = stream.read(count)
    if len(data) < count:
        raise ValueError("the file ends within its header")
    return data
