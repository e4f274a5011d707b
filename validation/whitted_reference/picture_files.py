"""Pictures as files, without any library: PNG to look at, NPY and OpenEXR to compute with."""

from __future__ import annotations

import os
import struct
import sys
from array import array
from pathlib import Path

from whitted_reference.errors import SceneError
from whitted_reference.image import Picture
from whitted_reference.png import encode_png


def save(picture: Picture, path: str | Path, exposure: float = 0.0) -> None:
    """Write a picture; the ending of the name says how.

    `.png` is 8-bit sRGB, scaled by 2^exposure and clipped; `.npy` holds (height, width, 3) float64 and
    `.exr` float32, both linear and unscaled.

    Raises
    ------
    SceneError
        If the ending is none of these.
    """
    path = Path(path)
    encoders = {".png": lambda p: png_bytes(p, exposure), ".npy": npy_bytes, ".exr": exr_bytes}
    if path.suffix.lower() not in encoders:
        raise SceneError(f"{path.name}: pictures end in `{path.suffix}`; allowed: {', '.join(encoders)}")
    beside = path.with_name(f"{path.name}.{os.getpid()}")
    beside.write_bytes(encoders[path.suffix.lower()](picture))
    os.replace(beside, path)


def png_bytes(picture: Picture, exposure: float = 0.0) -> bytes:
    """Encode as 8-bit sRGB (IEC 61966-2-1)."""
    scale = 2.0**exposure

    def byte(value: float) -> int:
        value = min(max(value * scale, 0.0), 1.0)
        coded = 12.92 * value if value <= 0.0031308 else 1.055 * value ** (1 / 2.4) - 0.055
        return int(255.0 * coded + 0.5)

    return encode_png(picture.width, picture.height, bytes(byte(v) for row in picture.rows for v in row))


def npy_bytes(picture: Picture) -> bytes:
    """Encode as a NumPy array file, version 1.0."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({picture.height}, {picture.width}, 3), }}"
    fill = -(len(head) + 11) % 64  # magic, version, length and the final newline are 11 bytes
    head += " " * fill + "\n"
    body = b"".join(struct.pack(f"<{len(row)}d", *row) for row in picture.rows)
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head.encode() + body


def exr_bytes(picture: Picture) -> bytes:
    """Encode as an uncompressed OpenEXR scan-line file with float32 channels B, G, R."""
    width, height = picture.width, picture.height

    def attribute(name: str, kind: str, value: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(value)) + value

    channels = b"".join(c + b"\0" + struct.pack("<IIII", 2, 0, 1, 1) for c in (b"B", b"G", b"R")) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = b"\x76\x2f\x31\x01" + struct.pack("<I", 2)
    header += attribute("channels", "chlist", channels)
    header += attribute("compression", "compression", b"\0")
    header += attribute("dataWindow", "box2i", window)
    header += attribute("displayWindow", "box2i", window)
    header += attribute("lineOrder", "lineOrder", b"\0")
    header += attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0))
    header += attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0.0, 0.0))
    header += attribute("screenWindowWidth", "float", struct.pack("<f", 1.0))
    header += b"\0"
    line = 12 * width
    start = len(header) + 8 * height
    offsets = b"".join(struct.pack("<Q", start + y * (line + 8)) for y in range(height))

    def plane(values: list[float]) -> bytes:
        numbers = array("f", values)  # beyond single precision becomes infinite
        if sys.byteorder == "big":
            numbers.byteswap()
        return numbers.tobytes()

    lines = b"".join(
        struct.pack("<iI", y, line) + b"".join(plane(row[c::3]) for c in (2, 1, 0))
        for y, row in enumerate(picture.rows)
    )
    return header + offsets + lines
