"""Pictures from files of any renderer, and files that are no picture."""

from __future__ import annotations

import pickle
import struct
import zlib
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from whitted_validation.cli import run
from whitted_validation.comparison import compare
from whitted_validation.picture_reading import from_array, read_picture
from whitted_validation.refusal import Refusal

U = 2.0**-24  # float32's unit roundoff
RGB = np.random.default_rng(4).random((6, 8, 3)).astype(np.float32)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, scalar_rgb: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder."""
    monkeypatch.chdir(tmp_path)


def exr(file: str, channels: dict[str, np.ndarray]) -> None:
    planes = np.stack(list(channels.values()), axis=2)
    mi.Bitmap(planes, mi.Bitmap.PixelFormat.MultiChannel, list(channels)).write(file)


def equal(picture: Any, values: np.ndarray) -> bool:
    return np.array_equal(picture.values, values)


def exr_of(channels: dict[str, str], window: tuple[int, int, int, int], value: float) -> bytes:
    """Write a row of pixels that all are `value`, uncompressed; kinds are h (half) and f (float)."""

    def attribute(name: str, kind: str, data: bytes) -> bytes:
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<I", len(data)) + data

    listed = b"".join(c.encode() + b"\0" + struct.pack("<IIII", 1 + (k == "f"), 0, 1, 1) for c, k in channels.items())
    head = b"\x76\x2f\x31\x01\x02\0\0\0" + attribute("channels", "chlist", listed + b"\0")
    head += attribute("compression", "compression", b"\0") + attribute("lineOrder", "lineOrder", b"\0")
    for name in ("dataWindow", "displayWindow"):
        head += attribute(name, "box2i", struct.pack("<iiii", *window))
    head += attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", bytes(8)) + attribute("screenWindowWidth", "float", bytes(4)) + b"\0"
    row = b"".join(struct.pack("<e" if kind == "h" else "<f", value) for kind in channels.values())
    return head + struct.pack("<QiI", len(head) + 8, window[1], len(row)) + row


def test_an_exr_is_read_as_written() -> None:
    mi.Bitmap(RGB).write("a.exr")
    assert equal(read_picture("a.exr"), RGB)


def test_half_floats_are_read_as_they_are() -> None:
    half = RGB.astype(np.float16)
    exr("a.exr", {c: half[..., i] for i, c in enumerate("RGB")})
    assert equal(read_picture("a.exr"), half.astype(np.float32))


@pytest.mark.parametrize(
    "names", ["RGB", "BGR", ["red", "green", "blue"], ["View.Combined.R", "View.Combined.G", "View.Combined.B"]]
)
def test_channels_are_found_by_name_in_any_order(names: list[str]) -> None:
    letters = [name.rpartition(".")[2][0].lower() for name in names]
    planes = {name: RGB[..., "rgb".index(letter)] for name, letter in zip(names, letters, strict=True)}
    exr("a.exr", planes | {"View.Depth.Z": RGB[..., 0], "View.Normal.X": RGB[..., 0], "View.Normal.Y": RGB[..., 0]})
    found = read_picture("a.exr")
    assert equal(found, RGB)
    assert "left out: `View.Depth.Z`" in found.remarks[0]


def test_the_layer_without_a_name_comes_first_and_another_can_be_asked_for() -> None:
    planes = {c: RGB[..., i] for i, c in enumerate("RGB")}
    exr("a.exr", planes | {f"albedo.{c}": 2 * plane for c, plane in planes.items()})
    assert np.array_equal(read_picture("a.exr").values, RGB)
    assert np.array_equal(read_picture("a.exr", "albedo").values, 2 * RGB)
    with pytest.raises(Refusal, match="no layer `beauty` with colours; there is ``, `albedo`"):
        read_picture("a.exr", "beauty")


def test_of_several_layers_one_must_be_chosen() -> None:
    exr("a.exr", {f"{layer}.{c}": RGB[..., 0] for layer in ("one", "two") for c in "RGB"})
    with pytest.raises(Refusal, match="one must be chosen: `one`, `two`"):
        read_picture("a.exr")


def test_alpha_is_left_out_and_said() -> None:
    exr("a.exr", {c: RGB[..., i] for i, c in enumerate("RGB")} | {"A": RGB[..., 0]})
    found = read_picture("a.exr")
    assert equal(found, RGB)
    assert found.remarks == ("a.exr: alpha, not 1 in 48 pixels, is left out",)


def test_luminance_is_compared_with_luminance_only() -> None:
    exr("a.exr", {"Y": RGB[..., 0]})
    assert equal(read_picture("a.exr"), RGB[..., :1])
    with pytest.raises(Refusal, match=r"a\.exr is luminance only, B RGB"):
        compare("a.exr", RGB)


def test_a_lone_channel_is_luminance_whatever_its_name() -> None:
    exr("a.exr", {"beauty.L": RGB[..., 0]})
    found = read_picture("a.exr")
    assert equal(found, RGB[..., :1])
    assert found.remarks == ("a.exr: its only channel beauty.L is taken for luminance",)


def test_an_exr_without_colours_says_what_is_there() -> None:
    exr("a.exr", {"N.X": RGB[..., 0], "N.Y": RGB[..., 1], "N.Z": RGB[..., 2]})
    with pytest.raises(Refusal, match=r"there is `N\.X`, `N\.Y`, `N\.Z`"):
        read_picture("a.exr")


@pytest.mark.parametrize(("kinds", "read"), [("ffff", True), ("hfff", False), ("fhhh", True), ("hhhh", True)])
def test_channels_of_several_kinds_are_read_without_loss_or_refused(kinds: str, read: bool) -> None:
    Path("a.exr").write_bytes(exr_of(dict(zip("ABGR", kinds, strict=True)), (0, 0, 0, 0), 0.1))
    if read:
        assert read_picture("a.exr").values.tolist() == [
            [[float(np.float32(0.1) if k == "f" else np.float16(0.1)) for k in kinds[1:]]]
        ]
        return
    with pytest.raises(Refusal, match="channel B is float, but A, the first by name, is half"):
        read_picture("a.exr")


def test_several_parts_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    from whitted_validation.exr_header import read_exr_header

    data = bytearray(exr_of({"Y": "f"}, (0, 0, 0, 0), 1.0))
    data[5] = 0x10
    Path("a.exr").write_bytes(data)
    with Path("a.exr").open("rb") as stream:
        assert read_exr_header(stream).parts


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_png_is_decoded_from_srgb(kind: Any) -> None:
    most = np.iinfo(kind).max
    coded = np.linspace(0, most, 48 * 3).astype(kind).reshape(6, 8, 3)
    mi.Bitmap(coded).write("a.png")
    picture = read_picture("a.png")
    assert picture.stepped
    for value, step in zip(picture.values.reshape(-1), coded.reshape(-1).tolist(), strict=True):
        c = step / most
        linear = c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4  # IEC 61966-2-1
        # Rounded to float32 at the end; before that in float64, whose few roundings, 2.4-fold through the power,
        # are below 2^-48, so that the sum stays below u (1 + 2^-20).
        assert abs(float(value) - linear) <= U * (1 + 2.0**-20) * linear


def test_a_png_is_within_half_a_step_of_its_exr() -> None:
    from whitted_validation import picture_files

    for name in ("a.exr", "a.png"):
        picture_files.write(Path(name), RGB)
    # A step is 1/255 in sRGB, whose slope towards linear is largest at white: 2.4/1.055. The curve bends up, so
    # half a step costs less than that; the encoder rounds in float64, the decoder to float32, values below 1.
    assert compare("a.exr", "a.png").largest <= 2.4 / 1.055 / 255 / 2 + 2 * U


def test_colours_of_a_png_are_multiplied_by_alpha_as_in_an_exr() -> None:
    coded = np.full((1, 2, 4), 255, np.uint8)
    coded[0, 1, 3] = 51
    mi.Bitmap(coded).write("a.png")
    assert read_picture("a.png").values.tolist() == [[[1.0] * 3, [float(np.float32(0.2))] * 3]]


@pytest.mark.parametrize("array", [RGB[..., :1], np.asfortranarray(RGB), RGB.astype(">f8"), RGB.astype(np.float16)])
def test_an_npy_of_any_float_kind_and_order_is_read(array: np.ndarray) -> None:
    np.save("a.npy", array)
    assert equal(read_picture("a.npy"), array)


def test_arrays_and_tensors_are_compared_as_well_as_files() -> None:
    assert equal(from_array(mi.TensorXf(RGB), "A"), RGB)


class Trap:
    """Makes a file when it is unpickled."""

    def __reduce__(self) -> tuple[Any, tuple[str, str]]:
        """Open a file for writing."""
        return open, ("sprung", "w")


def npy(header: str) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + bytes(64)


def shaped(shape: str) -> bytes:
    return npy(f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n")


def png_head(width: int, height: int) -> bytes:
    header = b"IHDR" + struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + header + struct.pack(">I", zlib.crc32(header))


BROKEN: dict[str, tuple[bytes, str]] = {
    "text.exr": (b"a text\n", "is neither EXR"),
    "empty.png": (b"", "is empty"),
    "pickle.npy": (pickle.dumps(Trap()), "is neither EXR"),
    "zip.npy": (b"PK\x03\x04" + bytes(64), "is neither EXR"),
    "cut.npy": (shaped("(6, 8, 3)"), "is damaged"),
    "huge.npy": (shaped("(1000000, 1000000, 3)"), "is damaged"),
    "negative.npy": (shaped("(-1, 8, 3)"), "is damaged"),
    "none.npy": (shaped("(0, 8, 3)"), "claims 8 x 0 pixels"),
    "flat.npy": (shaped("(4,)"), "of shape (4,)"),
    "two.npy": (shaped("(2, 2, 2)"), "of shape (2, 2, 2)"),
    "code.npy": (npy("{'descr': open('sprung', 'w')}\n"), "is damaged"),
    "open.npy": (npy("(" * 5000), "is damaged"),
    "version.npy": (b"\x93NUMPY\x09\x00" + bytes(64), "is damaged"),
    "bytes.npy": (npy("{'descr': '|u1', 'fortran_order': False, 'shape': (2, 2, 3), }\n"), "holds uint8"),
    "bomb.png": (png_head(900_000, 900_000), "claims 900000 x 900000 pixels"),
    "cut.png": (png_head(8, 6), "cannot be read"),
    "cut.exr": (b"\x76\x2f\x31\x01\x02\0\0\0chan", "the file ends within its header"),
    "bomb.exr": (exr_of({"Y": "f"}, (0, 0, 2**31 - 2, 2**31 - 2), 1.0), "claims 2147483647 x 2147483647 pixels"),
    "inside_out.exr": (exr_of({"Y": "f"}, (5, 5, 0, 0), 1.0), "claims -4 x -4 pixels"),
    "deep.exr": (b"\x76\x2f\x31\x01" + struct.pack("<I", 2 | 0x800) + bytes(64), "deep pixels"),
    "long_name.exr": (b"\x76\x2f\x31\x01\x02\0\0\0" + b"n" * 400, "longer than 255 bytes"),
    "no_channels.exr": (b"\x76\x2f\x31\x01\x02\0\0\0\0", "no channels or no size"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_picture_is_refused_in_a_line(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    content, words = BROKEN[name]
    Path(name).write_bytes(content)
    np.save("b", RGB)
    assert run(["compare", name, "b.npy"]) == 2
    said = capsys.readouterr()
    assert said.err.startswith(f"whitted: {name}: ")
    assert words in said.err
    assert said.err.count("\n") == 1
    assert not said.out
    assert not Path("sprung").exists()


@pytest.mark.parametrize("name", ["a.exr", "a.png", "a.npy"])
def test_a_file_cut_anywhere_is_refused(name: str) -> None:
    np.save("a.npy", RGB)
    mi.Bitmap(RGB).write("a.exr")
    mi.Bitmap((255 * RGB).astype(np.uint8)).write("a.png")
    data = Path(name).read_bytes()
    for length in range(0, len(data) - 12, 7):  # the last 12 bytes of a PNG say only that it ends
        Path("cut").write_bytes(data[:length])
        with pytest.raises(Refusal):
            read_picture("cut")


@pytest.mark.parametrize("shape", [(0, 4, 3), (4,), (2, 2, 2), (2, 2, 5), ()])
def test_an_array_of_another_shape_is_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(Refusal, match="a picture is"):
        from_array(np.zeros(shape), "A")


def test_objects_in_an_npy_are_not_unpickled() -> None:
    np.save("a.npy", np.array([[Trap()]], dtype=object), allow_pickle=True)
    with pytest.raises(Refusal, match="holds no plain numbers"):
        read_picture("a.npy")
    assert not Path("sprung").exists()
