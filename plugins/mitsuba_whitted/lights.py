"""The lights that the textbook knows, as tables: directional, point and spot."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted import precise
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.scene_graph import SceneGraph, number
from mitsuba_whitted.tables import column, double_column, fetch, opaque
from mitsuba_whitted.textures import constant
from mitsuba_whitted.transforms import matrix_of

UNROLL = 16
"""Up to so many lights of a kind stand in the kernel one by one; beyond, it loops, to compile in bounded time."""

GOLDEN = 0x9E3779B1
"""2^32 in the golden section, made odd: its multiples are spread well (Knuth, *TAOCP* 3, section 6.4)."""


class Sample(NamedTuple):
    """One light as seen from a point p."""

    l: Any  # noqa: E741  # the textbook's letter
    """Unit vector from p towards the light; zero if the light is at p."""
    colour: Any
    """Light arriving at p."""
    distance: Any
    """From p to the light; infinite for a directional light."""
    reaches: Any
    """Whether any of its light comes here: p is in the cone, and not at the light itself."""
    end: Any
    """As far as a shadow ray may look without taking a surface at the light for one before it."""
    name: Any
    """A number that no sum of other lights' is likely to be."""


class Lights:
    """Lights of one kind."""

    def __init__(self, kind: str, ids: list[str], rows: list[list[float]], radiant: list[list[float]]) -> None:
        self.kind = kind
        self.ids = ids
        self.count = len(rows)
        self.where = [np.array(row[:3]) for row in rows]
        """Position of each, or the unit vector towards it if it is directional."""
        self._width = len(rows[0]) // 3
        self._unrolled = self.count <= UNROLL or not dr.is_jit_v(mi.Float)
        vectors = np.reshape(rows, (-1, 3))
        # The light's own coordinates are exact; those of a surface at it are right to a few u of them.
        margins = 4 * precise.UNIT_ROUNDOFF * np.abs(vectors[:: self._width]).sum(axis=1)
        if self._unrolled:  # data of the kernel, for a load of one number is cheaper than a row's of a table
            self._vectors = [opaque(mi.Vector3d(*vector)) for vector in vectors.tolist()]
            self._spectra = [opaque(mi.Spectrum(*colour)) for colour in radiant]
            self._margins = [opaque(mi.Float(margin)) for margin in margins.tolist()]
        else:
            self._rows = double_column(vectors)
            self._colours = column(radiant)
            self._margin_of = column(margins[:, None])
            self._opaque_count = opaque(mi.UInt32(self.count))

    def described(self) -> str:
        """Kind and, while they are part of the kernel one by one, the number of these lights."""
        return f"{self.count} {self.kind}" if self.count <= UNROLL else f"many {self.kind}"

    def sum(self, term: Callable[[Sample], tuple[Any, Any, Any]], p: Any, inverse_square: bool) -> tuple[Any, Any, Any]:
        """Add up the parts of `term`, a Spectrum and two counts, over all lights as seen from the point `p`."""

        def add(i: Any, *sums: Any) -> tuple[Any, ...]:
            return i + 1, *(a + b for a, b in zip(sums, term(self._sample(i, p, inverse_square)), strict=True))

        state: tuple[Any, ...] = (mi.UInt32(0), mi.Spectrum(0), mi.UInt32(0), mi.UInt32(0))
        if self._unrolled:
            for i in range(self.count):
                state = add(i, *state[1:])
        else:
            state = dr.while_loop(state, lambda i, *_: i < self._opaque_count, add, label=f"{self.kind} lights")
        return state[1], state[2], state[3]

    def _sample(self, i: Any, p: Any, inverse_square: bool) -> Sample:
        def vector(j: int) -> Any:
            row = i * self._width + j
            return self._vectors[row] if self._unrolled else fetch(mi.Vector3d, self._rows, row)

        colour = self._spectra[i] if self._unrolled else fetch(mi.Spectrum, self._colours, i)
        name = mi.UInt32(i + _KIND_NUMBERS[self.kind]) * mi.UInt32(GOLDEN)
        if self.kind == "directional":
            return Sample(mi.Vector3f(vector(0)), colour, mi.Float(dr.inf), mi.Bool(True), mi.Float(dr.inf), name)

        position = vector(0)
        exactly = position - mi.Vector3d(p)
        to_light = mi.Vector3f(exactly)
        distance = dr.norm(to_light)
        away = distance > 0
        l = dr.select(away, to_light * dr.rcp(distance), 0)  # noqa: E741
        reaches: Any = away
        if self.kind == "spot":
            x, y, z = (-dr.dot(vector(j), exactly) for j in (1, 2, 3))
            theta = dr.atan2(dr.sqrt(x * x + y * y), z)  # in double: the ramp may be as narrow as one likes
            cutoff, beam, slope = vector(4)
            f = mi.Float(dr.select(theta <= beam, 1, dr.maximum(cutoff - theta, 0) * slope))
            colour = colour * f
            reaches = reaches & (f > 0)
        if inverse_square:
            colour = dr.select(away, colour * dr.rcp(distance * distance), 0)
        margin = self._margins[i] if self._unrolled else fetch(mi.Float, self._margin_of, i)
        end = distance * precise.SHADOW_END - margin
        return Sample(l, colour, distance, reaches, end, name)


_KIND_NUMBERS = {"directional": 1, "point": 1 << 10, "spot": 1 << 20}


def lights_of(graph: SceneGraph, centre: NDArray[np.float64]) -> list[Lights]:
    """Sort the delta lights of a scene by kind, each kind in the order of the scene; places relative to `centre`."""
    ids: dict[str, list[str]] = {}
    rows: dict[str, list[list[float]]] = {}
    radiant: dict[str, list[list[float]]] = {}
    for emitter in graph.emitters:
        kind = emitter.class_name()
        if kind in _READERS:
            name, read = _READERS[kind]
            row, colour = read(graph, emitter)
            if not np.all(np.isfinite(row)):
                raise SceneError(f"emitter `{emitter.id()}`: its position or angles {row} are not finite")
            if name != "directional":
                row[:3] = list(np.array(row[:3]) - centre)
            ids.setdefault(name, []).append(emitter.id())
            rows.setdefault(name, []).append(row)
            radiant.setdefault(name, []).append(colour)
    return [Lights(name, ids[name], rows[name], radiant[name]) for name in rows]


def lights_nothing(graph: SceneGraph) -> list[str]:
    """Name the emitters that are seen, at most, but light no surface."""
    return [
        f"{emitter.class_name()} `{emitter.id()}`" for emitter in graph.emitters if emitter.class_name() not in _READERS
    ]


def _directional(graph: SceneGraph, emitter: mi.Emitter) -> tuple[list[float], list[float]]:
    direction = _matrix(graph, emitter)[:3, 2]
    return [*(-direction / np.linalg.norm(direction))], colour_of(graph, emitter, "irradiance")


def _point(graph: SceneGraph, emitter: mi.Emitter) -> tuple[list[float], list[float]]:
    position = np.array(graph.value(emitter, "position"), float).ravel()
    return [*position], colour_of(graph, emitter, "intensity")


def _spot(graph: SceneGraph, emitter: mi.Emitter) -> tuple[list[float], list[float]]:
    projected = graph.child(emitter, "texture")
    if projected is not None and constant(projected) is None:  # Mitsuba itself ignores a constant one
        raise SceneError(f"emitter `{emitter.id()}`: a spot light that projects a texture is not handled")
    matrix = _matrix(graph, emitter)
    cutoff, beam = (np.deg2rad(number(graph.value(emitter, name))) for name in ("cutoff_angle", "beam_width"))
    if not 0 < cutoff <= np.pi or not 0 <= beam <= cutoff:
        raise SceneError(
            f"emitter `{emitter.id()}`: cutoff_angle {np.rad2deg(cutoff):g} and beam_width {np.rad2deg(beam):g} are "
            "out of range; allowed are 0 < cutoff_angle <= 180 and 0 <= beam_width <= cutoff_angle"
        )
    slope = 1 / (cutoff - beam) if cutoff > beam else 0.0
    to_local = np.linalg.inv(matrix[:3, :3])
    return [*matrix[:3, 3], *to_local.ravel(), cutoff, beam, slope], colour_of(graph, emitter, "intensity")


_READERS: dict[str, tuple[str, Callable[[SceneGraph, mi.Emitter], tuple[list[float], list[float]]]]] = {
    "DirectionalEmitter": ("directional", _directional),
    "PointLight": ("point", _point),
    "SpotLight": ("spot", _spot),
}


def colour_of(graph: SceneGraph, emitter: mi.Emitter, name: str) -> list[float]:
    """Read a colour of an emitter, and refuse one that is not finite, negative or not the same everywhere."""
    texture = graph.child(emitter, name)
    colour = None if texture is None else constant(texture)
    if colour is None:
        raise SceneError(f"emitter `{emitter.id()}`: {name} must be a constant colour")
    if not all(0 <= value < np.inf for value in colour):
        raise SceneError(f"emitter `{emitter.id()}`: {name} {colour} must be finite and not negative")
    return colour


def _matrix(graph: SceneGraph, emitter: mi.Emitter) -> Any:
    return matrix_of(graph.value(emitter, "to_world"), f"emitter `{emitter.id()}`")
