"""Pictures read from disk or memory, from any renderer: linear RGB or luminance, and what was left out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from whitted_validation.exr_header import ExrHeader, read_exr_header
from whitted_validation.refusal import Refusal
from whitted_validation.scene_check import MAX_PIXELS

MOST_NAMED = 12  # channels or layers in a message, which stays a line


@dataclass(frozen=True)
class Picture:
    """A picture that can be compared.

    Attributes
    ----------
    name : what to call it, safe to print
    values : (height, width, 1 or 3) float32 or float64, linear luminance or RGB; nan and infinity included
    stepped : it was 8- or 16-bit sRGB, so that a value is right to half a step only
    remarks : what was chosen or left out, a line each
    """

    name: str
    values: NDArray[np.floating]
    stepped: bool = False
    remarks: tuple[str, ...] = ()


def printable(text: object) -> str:
    """Return a name without what a terminal would obey or cannot show, such as escape sequences."""
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in str(text))


def read_picture(path: str | Path, layer: str | None = None) -> Picture:
    """Read an EXR, PNG or NPY file; which of them it is, its first bytes say.

    A PNG is decoded from sRGB (IEC 61966-2-1), and its colours are multiplied by its alpha, as those of an EXR
    are already. Alpha itself is left out. Of an NPY nothing is run.

    Parameters
    ----------
    path : the file
    layer : the layer of an EXR to read; None for the one without a name, else the only one with colours

    Raises
    ------
    Refusal
        If there is no such file, it is no such picture, or it is damaged.
    """
    path, name = Path(path), printable(path)
    try:
        if not path.is_file():
            raise Refusal(f"{name}: {'is no file' if path.exists() else 'no such file'}")
        with path.open("rb") as stream:
            start = stream.read(24)
        for magic, read in _READERS.items():
            if start.startswith(magic):
                if layer is not None and read is not _read_exr:
                    raise Refusal(f"{name}: only EXR files have layers; there is no `{printable(layer)}`")
                return read(path, name, start, layer)
    except Refusal:
        raise
    except (OSError, ValueError, RuntimeError, MemoryError, EOFError) as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise Refusal(f"{name}: cannot be read: {printable(' '.join(reason.split()))}") from None
    raise Refusal(f"{name}: {'is empty' if not start else 'is neither EXR nor PNG nor NPY'}")


def from_array(array: Any, name: str) -> Picture:
    """Take an array as a picture.

    Parameters
    ----------
    array : (height, width), (height, width, 1), (height, width, 3) or, with alpha, (height, width, 4) floats,
        linear; a NumPy array or anything that `numpy.asarray` takes, such as Mitsuba's tensors
    name : what to call it

    Raises
    ------
    Refusal
        If it has another shape or kind.
    """
    values = np.asarray(array)
    if values.ndim == 2:
        values = values[:, :, None]
    if values.dtype.kind != "f" or values.ndim != 3 or values.shape[2] not in (1, 3, 4) or not values.size:
        raise Refusal(
            f"{name}: holds {values.dtype} of shape {np.shape(array)}; a picture is (height, width), (height, width, 1)"
            " or (height, width, 3 or 4) floats, linear"
        )
    alpha = _alpha_remark(name, values[:, :, 3]) if values.shape[2] == 4 else ()
    values = values[:, :, :3]
    wide = np.float32 if values.dtype.itemsize <= 4 else np.float64
    return Picture(name, np.ascontiguousarray(values, wide), remarks=alpha)


def _read_npy(path: Path, name: str, _start: bytes, _layer: str | None) -> Picture:
    try:
        array = np.lib.format.open_memmap(path, mode="r")  # never runs what pickled objects would
    except OSError:
        raise
    except Exception:  # the header is a line of Python, and a broken one fails in many ways
        raise Refusal(f"{name}: is damaged, or holds no plain numbers") from None
    if array.ndim >= 2:
        _check_size(name, array.shape[1], array.shape[0])
    return from_array(array, name)


def _read_png(path: Path, name: str, start: bytes, _layer: str | None) -> Picture:
    width, height = (int.from_bytes(start[i : i + 4], "big") for i in (16, 20))  # of IHDR, always the first chunk
    _check_size(name, width, height)
    coded = np.array(_bitmap(path)).reshape(height, width, -1)  # uint8 or uint16
    most = np.iinfo(coded.dtype).max
    steps = np.arange(most + 1) / most
    linear = np.where(steps <= 0.04045, steps / 12.92, ((steps + 0.055) / 1.055) ** 2.4).astype(np.float32)
    colours = 3 if coded.shape[2] >= 3 else 1
    values = linear[coded[:, :, :colours]]
    half_step = float(linear[-1] - linear[-2]) / 2
    remarks: tuple[str, ...] = (
        f"{name}: sRGB steps from 0 to 1, good to {half_step:.2g} at white; brighter is cut off",
    )
    if coded.shape[2] > colours:
        alpha = coded[:, :, colours:].astype(np.float32) / np.float32(most)
        values, remarks = values * alpha, remarks + _alpha_remark(name, alpha)
    return Picture(name, values, stepped=True, remarks=remarks)


def _read_exr(path: Path, name: str, _start: bytes, layer: str | None) -> Picture:
    with path.open("rb") as stream:
        header = read_exr_header(stream)
    _check_size(name, *header.size)
    bitmap = _bitmap(path)
    import mitsuba as mi

    xyz = bitmap.pixel_format() in (mi.Bitmap.PixelFormat.XYZ, mi.Bitmap.PixelFormat.XYZA)
    if xyz and not any("." in channel for channel in header.channels):  # in a layer it is a position or a normal
        bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)
    names = [field.name for field in bitmap.struct_()]
    values = np.array(bitmap).reshape(*header.size[::-1], len(names))
    chosen, alpha, remarks = _choose(name, names, layer)
    _check_kinds(name, header, {names[i] for i in chosen})
    if header.parts:
        remarks += (f"{name}: has several parts; the first is read",)
    if alpha is not None:
        remarks += _alpha_remark(name, values[:, :, alpha])
    return Picture(name, np.ascontiguousarray(values[:, :, chosen], np.float32), remarks=remarks)


def _choose(name: str, names: list[str], layer: str | None) -> tuple[list[int], int | None, tuple[str, ...]]:
    """Pick the channels to compare and their alpha, by position."""
    layers: dict[str, dict[str, int]] = {}
    for position, channel in enumerate(names):
        prefix, _, last = channel.rpartition(".")
        layers.setdefault(prefix, {})[_COLOURS.get(last.lower(), last)] = position
    coloured = [prefix for prefix, parts in layers.items() if {"r", "g", "b"} <= parts.keys()]
    grey = [prefix for prefix, parts in layers.items() if "y" in parts and not {"X", "Z", "x", "z"} & parts.keys()]
    found = coloured or grey
    if layer is not None:
        if layer not in coloured + grey:
            raise Refusal(f"{name}: no layer `{printable(layer)}` with colours; there is {_listed(coloured + grey)}")
        chosen = layer
    elif "" in found:
        chosen = ""
    elif len(found) == 1:
        chosen = found[0]
    elif found:
        raise Refusal(f"{name}: several layers have colours, so that one must be chosen: {_listed(found)}")
    elif len(names) == 1:
        return [0], None, (f"{name}: its only channel {printable(names[0])} is taken for luminance",)
    else:
        raise Refusal(f"{name}: no channels R, G, B and no luminance Y; there is {_listed(names)}")
    parts = layers[chosen]
    positions = [parts[part] for part in ("rgb" if chosen in coloured else "y")]
    alpha = parts.get("a")
    others = [names[i] for i in range(len(names)) if i not in (*positions, alpha)]
    remark = f"{name}: compared are {_listed([names[i] for i in positions])}; left out: {_listed(others)}"
    return positions, alpha, (remark,) if others else ()


_COLOURS = {name: name[0] for name in ("r", "red", "g", "green", "b", "blue", "a", "alpha", "y")}


def _check_kinds(name: str, header: ExrHeader, wanted: set[str]) -> None:
    """Refuse what Mitsuba reads at a loss: it reads all channels as the kind of the first in the file."""
    first, kind = next(iter(header.channels.items()))
    if kind == "uint":
        raise Refusal(f"{name}: channel {printable(first)} holds integers, which spoils the others; leave it out")
    if not wanted <= header.channels.keys():  # computed from others
        wanted = set(header.channels)
    for channel in sorted(wanted):
        if header.channels[channel] not in (kind, "half"):
            raise Refusal(
                f"{name}: channel {printable(channel)} is {header.channels[channel]}, but {printable(first)}, the first"
                f" by name, is {kind}, and all are read like the first; store all as float"
            )


def _alpha_remark(name: str, alpha: NDArray[Any]) -> tuple[str, ...]:
    count = int(np.count_nonzero(alpha != 1))
    return (f"{name}: alpha, not 1 in {count} pixel{'s' * (count != 1)}, is left out",) if count else ()


def _listed(names: list[str]) -> str:
    shown = [f"`{printable(name)}`" for name in names[:MOST_NAMED]]
    more = len(names) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "") or "none"


def _check_size(name: str, width: int, height: int) -> None:
    if width < 1 or height < 1 or width * height > MAX_PIXELS:
        raise Refusal(f"{name}: claims {width} x {height} pixels; 1 to {MAX_PIXELS} are allowed")


def _bitmap(path: Path) -> Any:
    import mitsuba_whitted  # noqa: F401  # chooses libLLVM before Mitsuba looks for it

    import mitsuba as mi  # isort: skip

    if mi.variant() is None:
        mi.set_variant("scalar_rgb")
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise Refusal(f"{printable(path)}: its name is not UTF-8; rename it") from None
    logger = mi.logger()  # type: ignore[operator]  # its stub takes the function for an object
    level = logger.log_level()
    logger.set_log_level(mi.LogLevel.Error)  # libpng warns of what it can do without, and fails on all else
    try:
        return mi.Bitmap(str(path))
    finally:
        logger.set_log_level(level)


_READERS: dict[bytes, Callable[[Path, str, bytes, str | None], Picture]] = {
    b"\x76\x2f\x31\x01": _read_exr,
    b"\x89PNG\r\n\x1a\n": _read_png,
    b"\x93NUMPY": _read_npy,
}
