"""Textures as the kernel looks them up: Mitsuba's colours, at places that are computed in double."""

from __future__ import annotations

from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.textures import Textures

U = 2.0**-24
SIZES = {"tiny": (2, 2), "wide": (3, 7), "tall": (16, 5)}


def _pixels(height: int, width: int, channels: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, channels)).astype(np.uint8)


def _bitmap(pixels: np.ndarray, to_uv: Any = None, **parameters: Any) -> dict[str, Any]:
    """Describe a texture; bytes are sRGB unless it is told that they are raw."""
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels), "to_uv": to_uv or _turned(), **parameters}


def _turned() -> Any:
    return mi.ScalarTransform3f().translate([0.31, -1.7]) @ mi.ScalarTransform3f().rotate(25).scale([1.9, -2.3])


def _loaded(texture: dict[str, Any]) -> tuple[mi.Scene, Any, SceneGraph]:
    """Load a texture as a lamp's radiance."""
    lamp = {"type": "rectangle", "emitter": {"type": "area", "radiance": texture}}
    scene = mi.load_dict({"type": "scene", "lamp": lamp})
    graph = SceneGraph(scene)
    return scene, graph.child(scene.emitters()[0], "radiance"), graph


def _places(count: int = 4000) -> np.ndarray:
    """Give (u, v), in single precision: both sides begin with the same."""
    return np.random.default_rng(2).uniform(-1, 2, (2, count)).astype(np.float32).astype(float)


def _ours(graph: SceneGraph, texture: Any, uv: np.ndarray) -> np.ndarray:
    tables = Textures(graph, [texture])
    return _looked_up(tables, tables.numbers[0], uv)


def _looked_up(tables: Textures, number: int, uv: np.ndarray) -> np.ndarray:
    uv_there = mi.Point2d(*(mi.Float64(values) for values in np.array(uv)))
    return np.array(tables.at(mi.UInt32(number), uv_there, mi.Bool(True)), float)


def _theirs(texture: Any, uv: np.ndarray) -> np.ndarray:
    si = dr.zeros(mi.SurfaceInteraction3f, uv.shape[1])
    si.uv = mi.Point2f(*uv)
    return np.array(texture.eval(si), float)


def _in_texels(uv: np.ndarray, to_uv: Any, width: int, height: int) -> tuple[np.ndarray, np.ndarray]:
    """Give the places in texels, and how far off rounding in single may leave them.

    That is 3 roundings of the sum of sizes in to_uv, 1 of the product with the size, 1 more for half a texel.
    """
    matrix = np.array(to_uv.matrix, np.float32).astype(float)
    whole = np.array([*uv, np.ones(uv.shape[1])])
    sizes = np.array([[width], [height]])
    return (matrix @ whole)[:2] * sizes, 5 * U * ((np.abs(matrix) @ np.abs(whole))[:2] * sizes + 1)


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("filter_type", ["bilinear", "nearest"])
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("kind", ["sRGB", "raw bytes", "grey", "half", "single"])
def test_a_bitmap_has_mitsubas_colours(llvm_ad_rgb: str, kind: str, size: str, filter_type: str, wrap: str) -> None:
    pixels = _pixels(*SIZES[size], 1 if kind == "grey" else 3)
    formats: dict[str, tuple[Any, dict[str, Any]]] = {
        "sRGB": (pixels, {}),
        "raw bytes": (pixels, {"raw": True}),
        "grey": (pixels, {}),
        "half": ((pixels / 255).astype(np.float16), {"raw": True, "format": "float16"}),
        "single": ((pixels / 255).astype(np.float32), {"raw": True}),
    }
    stored, parameters = formats[kind]
    to_uv = _turned()
    _scene, texture, graph = _loaded(_bitmap(stored, to_uv, filter_type=filter_type, wrap_mode=wrap, **parameters))
    uv = _places()
    height, width = SIZES[size]
    place, off = _in_texels(uv, to_uv, width, height)
    if filter_type == "nearest":  # where rounding cannot step over an edge
        clear = (np.abs(place - np.rint(place)) > off).all(axis=0)
        assert clear.mean() > 0.99
        uv, off = uv[:, clear], np.zeros((2, clear.sum()))
    # Colours are at most 1 and so is a step. Theirs: bytes to linear 11 roundings, both axes 6; ours: 7.
    limit = off.sum(axis=0) + (11 + 6 + 7) * U
    assert (np.abs(_ours(graph, texture, uv) - _theirs(texture, uv)) <= limit).all()


@pytest.mark.parametrize("filter_type", ["bilinear", "nearest"])
@pytest.mark.parametrize(("wrap", "period"), [("repeat", 1), ("mirror", 2)])
def test_a_thousand_periods_on_a_picture_is_the_same_to_the_last_bit(
    llvm_ad_rgb: str, wrap: str, period: int, filter_type: str
) -> None:
    # Places are multiples of 2^-20 and sums of them exact in double, though in single they would not be.
    to_uv = mi.ScalarTransform3f()
    _scene, texture, graph = _loaded(_bitmap(_pixels(8, 16, 3), to_uv, filter_type=filter_type, wrap_mode=wrap))
    uv = np.rint(_places() * 2**20) / 2**20
    assert np.array_equal(_ours(graph, texture, uv), _ours(graph, texture, uv + 1000 * period))


ALIKE = {
    "one colour": np.full((4, 4, 3), 7),
    "columns": np.broadcast_to(np.arange(5)[None, :, None] * 40, (4, 5, 3)),
    "rows": np.broadcast_to(np.arange(5)[:, None, None] * 40, (5, 4, 3)),
    "the same from right and left": np.broadcast_to(np.array([9, 90, 90, 9])[None, :, None], (3, 4, 3)),
    "the same turned by half": np.arange(9).reshape(3, 3, 1) * np.array([[[20, 28, 28]]]) % 256,
    "black and white": np.indices((4, 4)).sum(axis=0)[:, :, None] % 2 * np.full(3, 255),
    "one texel": np.pad(np.full((1, 1, 3), 255), ((70, 6), (50, 3), (0, 0))),
}


@pytest.mark.parametrize("wrap", ["repeat", "mirror", "clamp"])
@pytest.mark.parametrize("filter_type", ["bilinear", "nearest"])
@pytest.mark.parametrize("picture", ALIKE)
def test_what_a_picture_hides_of_its_modes_shows_once_it_is_edited(
    llvm_ad_rgb: str, picture: str, filter_type: str, wrap: str
) -> None:
    pixels = np.ascontiguousarray(ALIKE[picture]).astype(np.uint8)
    scene, texture, graph = _loaded(_bitmap(pixels, filter_type=filter_type, wrap_mode=wrap))
    height, width = pixels.shape[:2]
    uv = _places()
    place, off = _in_texels(uv, _turned(), width, height)
    uv = uv[:, (np.abs(place - np.rint(place)) > off).all(axis=0)]
    off = 0 if filter_type == "nearest" else off.sum(axis=0).max()
    limit = off + (11 + 6 + 7) * U  # see above
    assert np.abs(_ours(graph, texture, uv) - _theirs(texture, uv)).max() <= limit
    parameters = mi.traverse(scene)
    [key] = [key for key in parameters.keys() if key.endswith("radiance.data")]  # noqa: SIM118  # no dictionary
    parameters[key] = type(parameters[key])(_pixels(height, width, 3, seed=8))
    parameters.update()
    assert np.abs(_ours(graph, texture, uv) - _theirs(texture, uv)).max() <= limit


def test_checkerboards_hold_pictures_and_checkerboards(llvm_ad_rgb: str) -> None:
    nested = {"type": "checkerboard", "color0": 0.25, "color1": _bitmap(_pixels(4, 4, 3), filter_type="nearest")}
    nested["to_uv"] = mi.ScalarTransform3f().scale(0.9)
    outer = {"type": "checkerboard", "color0": nested, "color1": {"type": "rgb", "value": [0.1, 0.2, 0.3]}}
    _scene, texture, graph = _loaded(outer)
    uv = _places()
    for to_uv, size in ((mi.ScalarTransform3f(), 2), (nested["to_uv"], 2), (_turned(), 4)):
        place, off = _in_texels(uv, to_uv, size, size)
        uv = uv[:, (np.abs(place - np.rint(place)) > off).all(axis=0)]
    assert uv.shape[1] > 3900
    ours = _ours(graph, texture, uv)
    assert len(np.unique(ours, axis=1).T) == 2 + 16
    assert np.abs(ours - _theirs(texture, uv)).max() <= (11 + 1) * U  # no interpolation


def test_textures_of_one_table_keep_their_own_modes(llvm_ad_rgb: str) -> None:
    modes = [(wrap, kind) for wrap in ("repeat", "mirror", "clamp") for kind in ("nearest", "bilinear")]
    bodies = {
        f"lamp{i}": {
            "type": "rectangle",
            "emitter": {
                "type": "area",
                "radiance": _bitmap(_pixels(3 + i, 9 - i, 3, seed=i), wrap_mode=wrap, filter_type=kind),
            },
        }
        for i, (wrap, kind) in enumerate(modes)
    }
    scene = mi.load_dict({"type": "scene", **bodies})
    graph = SceneGraph(scene)
    textures = [graph.child(emitter, "radiance") for emitter in scene.emitters()]
    together = Textures(graph, textures)
    uv = _places()
    for number, texture in zip(together.numbers, textures, strict=True):
        alone = _ours(graph, texture, uv)
        assert np.array_equal(_looked_up(together, number, uv), alone)


def test_a_ray_that_met_nothing_has_no_colour_of_a_texture(scalar_rgb: str) -> None:
    _scene, texture, graph = _loaded(_bitmap(_pixels(4, 4, 3)))
    tables = Textures(graph, [texture])
    nothing = tables.at(tables.numbers[0], mi.Point2d(np.nan, np.inf), False)
    assert list(nothing) == [0, 0, 0]


def test_coordinates_that_are_no_numbers_are_somewhere_in_the_picture(llvm_ad_rgb: str) -> None:
    for wrap in ("repeat", "mirror", "clamp"):
        _scene, texture, graph = _loaded(_bitmap(_pixels(4, 4, 3), mi.ScalarTransform3f(), wrap_mode=wrap))
        strange = np.array([np.nan, np.inf, -np.inf, 1e300, -1e300, 1e15, -1e15])
        _ours(graph, texture, np.array([strange, strange]))  # or the process ends
        nearest = _loaded(_bitmap(_pixels(4, 4, 3), filter_type="nearest", wrap_mode=wrap))
        ours = _ours(nearest[2], nearest[1], np.array([strange, strange[::-1]]))
        assert np.isfinite(ours).all()
        assert (ours > 0).all()


def test_without_colours_a_picture_is_its_luminance(llvm_ad_mono: str) -> None:
    _scene, texture, graph = _loaded(_bitmap(_pixels(4, 4, 3), filter_type="nearest"))
    uv = _places()
    place, off = _in_texels(uv, _turned(), 4, 4)
    uv = uv[:, (np.abs(place - np.rint(place)) > off).all(axis=0)]
    ours = _ours(graph, texture, uv)
    assert ours.shape[0] == 1
    # Bytes to linear 11, of three a luminance 5 (products, sums); ours is computed in double, of rounded texels.
    assert np.abs(ours - _theirs(texture, uv)).max() <= (11 + 5 + 2) * U
