"""The materials of a scene as tables: the textbook's coefficients of every BSDF that has them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple, TypeAlias

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.bitmaps import to_uv_of
from mitsuba_whitted.blinn_phong import MAX_EXPONENT, PARAMETERS
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.tables import column, fetch, index_column
from mitsuba_whitted.textures import constant, textures_of

TEXTURES = ("BitmapTexture", "Checkerboard")
"""Beginnings of the class names of textures that depend on (u, v) alone; constant ones are allowed besides."""

Scaled: TypeAlias = "tuple[mi.Texture, float]"
"""A texture, and the number that its values are multiplied by."""


class Material(NamedTuple):
    """Coefficients of one BSDF; None stands for 0."""

    owner: str
    """Name of the BSDF in messages."""
    k_d: Scaled | None = None
    k_s: Scaled | None = None
    k_m: Scaled | None = None
    k_a: Scaled | None = None
    exponent: Scaled | None = None


def material_of(graph: SceneGraph, bsdf: mi.BSDF, shape: mi.Shape) -> tuple[Material, Material | None]:
    """Read the textbook's coefficients of a BSDF.

    Returns
    -------
    The material seen from the front, and that from behind, which is None unless the BSDF is two-sided.

    Raises
    ------
    SceneError
        If the BSDF is none of blinnphong, diffuse, conductor without material, twosided.
    """
    name = bsdf.class_name() if type(bsdf) is mi.BSDF else type(bsdf).__name__  # a plugin in C++, or in Python
    owner = f"bsdf `{bsdf.id()}` of shape `{shape.id()}`"
    if name == "TwoSidedBRDF":
        front, _ = material_of(graph, graph.child(bsdf, "brdf_0"), shape)
        behind = graph.child(bsdf, "brdf_1")
        return front, front if behind is None else material_of(graph, behind, shape)[0]
    if name == "BlinnPhong":
        return Material(owner, *((getattr(bsdf, parameter), 1.0) for parameter in PARAMETERS)), None
    if name == "SmoothDiffuse":
        rho = graph.child(bsdf, "reflectance"), 1 / math.pi  # a diffuse BSDF is rho / pi
        return Material(owner, k_d=rho, k_a=rho), None
    if name == "SmoothConductor" and _is_plain_mirror(graph, bsdf):
        return Material(owner, k_m=(graph.child(bsdf, "specular_reflectance"), 1.0)), None
    if name == "SmoothConductor":
        name = "a conductor with another material than `none`"
    raise SceneError(
        f"{owner}: {name} is not handled; "
        "allowed are blinnphong, diffuse, conductor with material `none`, and twosided of them"
    )


def _is_plain_mirror(graph: SceneGraph, conductor: mi.BSDF) -> bool:
    """Material `none` is a refractive index of 0 + 1i, whose Fresnel factor is 1 at every angle."""
    eta, k = (constant(graph.child(conductor, name)) for name in ("eta", "k"))
    return eta is not None and k is not None and set(eta) == {0.0} and set(k) == {1.0}


class Coefficient:
    """One coefficient of all materials: a table of numbers, and the textures that scale some of them.

    Parameters
    ----------
    graph : SceneGraph
        Knows the textures inside textures.
    kind : type
        Spectrum, or Float.
    entries
        One a material: its name in messages, and what it has for this coefficient.
    what : str
        Name of the coefficient in messages.
    most : float
        Largest value allowed of a constant; the values of a texture are clamped if this is a Float.
    order
        For each row of the table the number of its entry; None for all as they are.

    Raises
    ------
    SceneError
        If a constant or a texel is out of range or not a number, or a texture depends on more than (u, v).
    """

    def __init__(
        self,
        graph: SceneGraph,
        kind: Any,
        entries: list[tuple[str, Scaled | None]],
        what: str,
        most: float,
        order: NDArray[np.int_] | None = None,
    ) -> None:
        self._kind, self._most = kind, most
        width = 1 if kind is mi.Float else dr.size_v(kind)
        self.textures: list[mi.Texture] = []
        rows, numbers = [], []
        for owner, scaled in entries:
            row, number = [0.0] * width, 0
            if scaled is not None:
                texture, scale = scaled
                colour = constant(texture)
                if colour is None:
                    _check_texture(graph, texture, f"{owner}: {what}", most)
                    if texture not in self.textures:
                        self.textures.append(texture)
                    row, number = [scale] * width, 1 + self.textures.index(texture)
                else:
                    _refuse_out_of_range(owner, colour, what, most)
                    row = [scale * channel for channel in (colour * width)[:width]]
            rows.append(row)
            numbers.append(number)
        self.varies = [number != 0 for number in numbers]
        """Whether the entry has a texture."""
        self.present = any(value != 0 for row in rows for value in row)
        self.largest = max(
            (value * (most if i else 1) for row, i in zip(rows, numbers, strict=True) for value in row), default=0.0
        )
        in_order = slice(None) if order is None else order
        self._rows = column(np.array(rows)[in_order])
        if self.textures:
            self._tables = textures_of(graph, self.textures)
            rows_there = np.array([0, *self._tables.numbers])
            self._numbers = index_column(rows_there[np.array(numbers)[in_order]][:, None])

    def at(self, material: Any, uv: Any, active: Any) -> Any:
        """Value for the row `material` at the surface coordinates `uv`, which only textures look at."""
        value = fetch(self._kind, self._rows, material, active)
        if self.textures:
            number = fetch(mi.UInt32, self._numbers, material, active)
            here = active & (number != 0)
            factor: Any = self._tables.at(number, uv, here)
            if self._kind is mi.Float:
                factor = dr.clip(factor[0], 0, self._most)
            value = dr.select(here, value * factor, value)
        return value

    def squares(self, material: Any, uv: Any, active: Any) -> Iterator[Any]:
        """Tell the squares of checkerboards and the texels of bitmaps apart."""
        if self.textures:
            # Nothing wears number 0. A table of constants has an answer also for lanes that met nothing.
            number = dr.select(active, fetch(mi.UInt32, self._numbers, material, active), 0)
            yield from self._tables.squares(number, uv, active)


def _check_texture(graph: SceneGraph, texture: Any, what: str, most: float) -> None:
    """Refuse a texture of another kind, also inside this one, and numbers in it that are out of range."""
    name = texture.class_name()
    if texture.is_spatially_varying() and not name.startswith(TEXTURES):
        raise SceneError(f"{what} is a texture of class {name}; allowed are checkerboard, bitmap and constant colours")
    node = graph.nodes[texture]
    texels = np.array(graph.value(texture, "data")) if "data" in node.values else np.zeros(1)
    if texels.dtype != np.uint8 and not np.all((texels >= 0) & (texels <= most)):  # a NaN is in no range
        raise SceneError(f"{what} has texels out of range; allowed is from 0 to {most:g}")
    if "to_uv" in node.values:
        to_uv = to_uv_of(graph, texture)
        if not np.all(np.isfinite(to_uv)):
            raise SceneError(f"{what} has a to_uv that is not finite; every number of it must be")
        if "data" in node.values and np.linalg.det(to_uv) == 0:
            raise SceneError(f"{what} has a bitmap whose to_uv is singular; it must be invertible")
    for inner in node.children.values():
        _check_texture(graph, inner, what, most)


def _refuse_out_of_range(owner: str, colour: list[float], what: str, most: float) -> None:
    for value in colour:
        if not 0 <= value <= most:  # a NaN is in no range
            raise SceneError(f"{owner}: {what} is {value:g}, allowed is from 0 to {most:g}")


def has_backs(sides: Iterable[tuple[Material, Material | None]]) -> bool:
    """Whether any BSDF, given as its front and what is behind, is seen from behind."""
    return any(behind is not None for _, behind in sides)


class Materials:
    """All materials of a scene, by the rows of the shapes that wear them."""

    def __init__(self, graph: SceneGraph) -> None:
        sides: dict[mi.BSDF, tuple[Material, Material | None]] = {}
        for shape in graph.all_shapes:
            bsdf = shape.bsdf()
            if bsdf not in sides:
                sides[bsdf] = material_of(graph, bsdf, shape)
        self.two_sided = has_backs(sides.values())
        black = Material("the back of a one-sided surface")
        worn = [sides[shape.bsdf()] for shape in graph.all_shapes]
        # A row for each side of each shape, so that one look-up leads from the shape to its coefficients.
        rows = [side or black for pair in worn for side in (pair if self.two_sided else pair[:1])]
        distinct = {id(row): row for row in rows}
        materials, numbers = list(distinct.values()), {key: number for number, key in enumerate(distinct)}
        self.one = len(materials) == 1
        """Whether every surface wears the same, whose coefficients then are constants of the kernel."""
        order = np.array([0] if self.one else [numbers[id(row)] for row in rows], int)

        def coefficient(kind: Any, letter: str, what: str, most: float) -> Coefficient:
            return Coefficient(graph, kind, [(m.owner, getattr(m, letter)) for m in materials], what, most, order)

        self.k_d = coefficient(mi.Spectrum, "k_d", "diffuse reflectance", 1)
        self.k_s = coefficient(mi.Spectrum, "k_s", "specular reflectance", 1)
        self.k_m = coefficient(mi.Spectrum, "k_m", "mirror reflectance", 1)
        # Mostly k_a is not given and so is k_d, the same object: one table then, and one load.
        same = all(material.k_a == material.k_d for material in materials)
        self.k_a = self.k_d if same else coefficient(mi.Spectrum, "k_a", "ambient reflectance", 1)
        self.exponent = coefficient(mi.Float, "exponent", "exponent", MAX_EXPONENT)
        coefficients = (self.k_d, self.k_s, self.k_m, self.k_a, self.exponent)
        varies = {id(m): any(k.varies[number] for k in coefficients) for number, m in enumerate(materials)}
        self.textured = [any(varies[id(side)] for side in pair if side) for pair in worn]
        """Whether each shape wears a texture."""

    def squares(self, material: Any, uv: Any, active: Any) -> Iterator[Any]:
        """Tell the squares of all checkerboards and bitmaps in row `material` apart."""
        shared = (self.k_a,) if self.k_a is not self.k_d else ()
        for coefficient in (self.k_d, self.k_s, self.k_m, self.exponent, *shared):
            yield from coefficient.squares(material, uv, active)

    def row_of(self, shape: Any, from_behind: Any) -> Any:
        """Row of the material that shape row `shape` shows on this side."""
        if self.one:
            return mi.UInt32(0)
        return 2 * shape + dr.select(from_behind, mi.UInt32(1), mi.UInt32(0)) if self.two_sided else shape
