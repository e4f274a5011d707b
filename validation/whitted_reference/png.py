"""8-bit PNG pictures: a reader for textures, a writer for results (ISO/IEC 15948, on zlib)."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path

from whitted_reference.errors import SceneError

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_CHANNELS = {0: 1, 2: 3, 4: 2, 6: 4}  # colour type: grey, RGB, grey + alpha, RGB + alpha


@dataclass(frozen=True)
class Png:
    """Rows from the top; `channels` 1 (grey) or 3 (RGB), any alpha left out."""

    width: int
    height: int
    channels: int
    texels: bytes


def read_png(path: Path) -> Png:
    """Read an 8-bit grey or RGB picture, with or without alpha (which is dropped).

    Raises
    ------
    SceneError
        If the file is not a PNG, is damaged, or is of a kind that is not read: 16-bit, less than 8 bits,
        palette, interlaced.
    """
    try:
        return _decode(path.read_bytes())
    except (ValueError, struct.error, zlib.error, KeyError) as error:
        raise SceneError(f"{path.name}: bad PNG file: {error}") from None


def _decode(data: bytes) -> Png:
    if not data.startswith(_SIGNATURE):
        raise ValueError("no PNG signature")
    offset, header, body = len(_SIGNATURE), b"", b""
    while True:
        length, kind = struct.unpack_from(">I4s", data, offset)
        chunk = data[offset + 8 : offset + 8 + length]
        (check,) = struct.unpack_from(">I", data, offset + 8 + length)
        if zlib.crc32(kind + chunk) != check:
            raise ValueError(f"checksum of chunk {kind.decode('ascii', 'replace')} is wrong")
        offset += 12 + length
        if kind == b"IHDR":
            header = chunk
        elif kind == b"IDAT":
            body += chunk
        elif kind == b"IEND":
            break
    width, height, depth, colour, compression, filtering, interlace = struct.unpack(">IIBBBBB", header)
    if depth != 8 or colour not in _CHANNELS or compression or filtering or interlace:
        raise ValueError(
            f"bit depth {depth}, colour type {colour}, interlace {interlace}: only 8-bit grey or RGB without "
            "interlace is read"
        )
    stored = _CHANNELS[colour]
    due = (width * stored + 1) * height
    raw = zlib.decompressobj().decompress(body, due + 1)  # no more than can be used
    rows = _unfilter(raw, width * stored, height, stored)
    if stored in (2, 4):
        keep = stored - 1
        pixels = [row[i : i + keep] for row in rows for i in range(0, len(row), stored)]
        return Png(width, height, keep, b"".join(pixels))
    return Png(width, height, stored, b"".join(rows))


def _unfilter(raw: bytes, stride: int, height: int, step: int) -> list[bytes]:
    if len(raw) != (stride + 1) * height:
        raise ValueError(f"{len(raw)} bytes of pixels where {(stride + 1) * height} are due")
    above = bytearray(stride)
    rows = []
    for y in range(height):
        kind, row = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        if kind > 4:
            raise ValueError(f"row filter {kind}")
        for i in range(stride) if kind else ():
            left = row[i - step] if i >= step else 0
            up = above[i]
            corner = above[i - step] if i >= step else 0
            guess = (0, left, up, (left + up) // 2, _paeth(left, up, corner))[kind]
            row[i] = (row[i] + guess) & 255
        rows.append(bytes(row))
        above = row
    return rows


def _paeth(left: int, up: int, corner: int) -> int:
    guess = left + up - corner
    a, b, c = abs(guess - left), abs(guess - up), abs(guess - corner)
    if a <= b and a <= c:
        return left
    return up if b <= c else corner


def encode_png(width: int, height: int, texels: bytes) -> bytes:
    """Encode 8-bit RGB rows from the top."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    stride = 3 * width
    lines = b"".join(b"\0" + texels[y * stride : (y + 1) * stride] for y in range(height))
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(lines, 9)) + chunk(b"IEND", b"")
    return _SIGNATURE + chunks
