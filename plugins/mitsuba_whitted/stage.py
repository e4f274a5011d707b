"""A scene made ready for the kernel: tables of shapes, materials and lights, kept in step with every edit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted.brightness import most_radiance
from mitsuba_whitted.casters import casters
from mitsuba_whitted.errors import SceneError
from mitsuba_whitted.lights import colour_of, lights_nothing, lights_of
from mitsuba_whitted.materials import Coefficient, Materials, Scaled
from mitsuba_whitted.scene_graph import SceneGraph
from mitsuba_whitted.surfaces import Surfaces
from mitsuba_whitted.tables import opaque

UNLIMITED_LAST_RAY = 1024
"""With max_depth = -1 no ray of a higher number is traced: the definition's own limit."""

UNLIMITED_LEAST_THROUGHPUT = 2.0**-24
"""With max_depth = -1 no mirror is followed that passes less of every channel: the definition's own limit."""

MIRRORS_SHARE = 1 / 8
"""With max_depth = -1 and a target error, rays that are not followed may add this share of it to a pixel."""

LARGEST = float(np.finfo(np.float32).max)
"""Radiance has no other limit than that it is finite."""

_NO_LIMIT = 2**32 - 1


@dataclass(frozen=True)
class Settings:
    """The parameters of the integrator; `integrator.py` says what they mean.

    Raises
    ------
    SceneError
        If one is not what it may be, also where a script replaces it.
    """

    max_depth: int = 10
    ambient: tuple[float, ...] = (0.0, 0.0, 0.0)
    falloff: str = "inverse_square"
    epsilon: float | None = None
    target_error: float = 0.0
    enable_ambient: bool = True
    enable_diffuse: bool = True
    enable_specular: bool = True
    enable_shadows: bool = True
    enable_mirrors: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.max_depth, int) or isinstance(self.max_depth, bool):
            raise SceneError(f"max_depth is {self.max_depth}; allowed is an integer")
        if not -1 <= self.max_depth < 2**31:  # as many as an <integer> may be
            raise SceneError(f"max_depth {self.max_depth} is out of range; allowed are -1 to {2**31 - 1}")
        if not isinstance(self.ambient, tuple) or not all(0 <= value < math.inf for value in self.ambient):
            raise SceneError(f"ambient {self.ambient} must be one colour, finite and not negative")
        if self.falloff not in ("inverse_square", "none"):
            raise SceneError(f"falloff `{self.falloff}` is unknown; allowed are inverse_square and none")
        if self.epsilon is not None and not 0 < self.epsilon < math.inf:
            raise SceneError(f"epsilon {self.epsilon:g} is out of range; it must be above 0 and finite")
        if not 0 <= self.target_error < math.inf:
            raise SceneError(f"target_error {self.target_error:g} is out of range; it must be finite and not negative")


class Stage:
    """One scene as the kernel sees it.

    Mitsuba tells a Python integrator of no edit to a shape, a material or a light. So the stage asks: before
    every picture it compares the identities of all values with those that it was built from, which costs
    less than a millisecond for a thousand values, and builds anew what was edited.
    """

    def __init__(self, scene: mi.Scene, settings: Settings) -> None:
        self._graph = SceneGraph(scene)
        self._take(settings)
        self._build_surfaces()
        self._build_appearance()
        self._find_textured()
        self._find_casters()
        self._limit_throughput()

    def follows(self, scene: mi.Scene) -> bool:
        """Whether this is still the scene that the stage was built from, edits to its values aside."""
        return self._graph.describes(scene)

    def refresh(self, settings: Settings) -> None:
        """Take over every edit since the last picture."""
        before = self.settings, self.surfaces, self.materials
        if settings != self.settings:
            self._take(settings)
        if not self._geometry_stamp.is_current():
            self._build_surfaces()
        if not self._appearance_stamp.is_current() or (self.surfaces.centre != before[1].centre).any():
            self._build_appearance()
        if before != (self.settings, self.surfaces, self.materials):
            self._find_textured()
            self._find_casters()
            self._limit_throughput()

    def background(self, d: Any, active: Any) -> Any:
        """Radiance of the environment along the direction `d`."""
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = -d
        return self.environment.eval(si, active)

    def squares(self, hit: Any, material: Any, active: Any) -> Iterator[Any]:
        """Give numbers that tell apart the squares of checkerboards and the texels of bitmaps that a surface wears."""
        if not dr.is_jit_v(mi.Float):
            return  # scalar variants refine nothing, and stumble over the coordinates of what was not hit
        yield from self.materials.squares(material, hit.uv, active)
        yield from self.emission.squares(hit.shape, hit.uv, active)

    def name_of(self, shape: int, instance: int) -> str:
        """Id of the shape in row `shape`, after that of the instance which placed it, counted from 1, if any did."""
        name = self._graph.all_shapes[shape].id()
        return f"{self._graph.instances[instance - 1].id()}/{name}" if instance else name

    def _take(self, settings: Settings) -> None:
        self.settings = settings
        unlimited = settings.max_depth < 0
        self.max_depth = opaque(mi.UInt32(_NO_LIMIT if unlimited else settings.max_depth))
        self.last_ray = opaque(mi.UInt32(UNLIMITED_LAST_RAY if unlimited else _NO_LIMIT))
        self.ambient = opaque(mi.Spectrum(*settings.ambient))
        self.epsilon = opaque(mi.Float(settings.epsilon or 0.0))

    def _limit_throughput(self) -> None:
        """Say how much a chain of mirrors must pass to go on; see section 1 of the model for the limit of its own."""
        least = UNLIMITED_LEAST_THROUGHPUT if self.settings.max_depth < 0 else 0.0
        if least and self.settings.target_error:
            most = most_radiance(self._graph, self, UNLIMITED_LAST_RAY)
            least = max(least, MIRRORS_SHARE * self.settings.target_error / most if most else 1.0)
        self.least_throughput = opaque(mi.Float(least))

    def _build_surfaces(self) -> None:
        self._geometry_stamp = self._graph.geometry_stamp()
        self.surfaces = Surfaces(self._graph)

    def _build_appearance(self) -> None:
        graph = self._graph
        self._appearance_stamp = graph.appearance_stamp()
        self.materials = Materials(graph)
        self.lights = lights_of(graph, self.surfaces.centre)
        self.environment: Any = graph.environment
        _check_background(graph)
        radiance = [_radiance(graph, shape) for shape in graph.all_shapes]
        self.emission = Coefficient(graph, mi.Spectrum, radiance, "radiance", LARGEST)
        self.lights_nothing = lights_nothing(graph)

    def _find_textured(self) -> None:
        wear = zip(self.surfaces.rows, self.materials.textured, self.emission.varies, strict=True)
        self.surfaces.textured = {row.kind for row, reflects, shines in wear if reflects or shines}

    def _find_casters(self) -> None:
        surfaces, few = self.surfaces, self.surfaces.few
        if self.settings.epsilon is not None:  # then a surface may well throw a shadow on itself
            few.casters = set(few.numbers)
            return
        places = [place for lights in self.lights if lights.kind != "directional" for place in lights.where]
        directions = [way for lights in self.lights if lights.kind == "directional" for way in lights.where]
        two_sided = self.materials.two_sided
        few.casters = casters(self._graph, surfaces.rows, few.numbers, surfaces.centre, places, directions, two_sided)


def _check_background(graph: SceneGraph) -> None:
    """Refuse a background that holds a negative or no number."""
    sky = graph.environment
    if sky is None:
        return
    if sky.class_name() == "ConstantBackgroundEmitter":
        colour_of(graph, sky, "radiance")
    picture = np.array(graph.value(sky, "data")) if "data" in graph.nodes[sky].values else np.zeros(1)
    if not np.isfinite(picture).all():
        raise SceneError(f"emitter `{sky.id()}`: a pixel of its picture is not finite; every one must be")


def _radiance(graph: SceneGraph, shape: mi.Shape) -> tuple[str, Scaled | None]:
    """Look up what a shape emits to its front, and its name in messages."""
    lamp = shape.emitter()
    if lamp is None or lamp.class_name() != "AreaLight":
        return "", None
    return f"emitter of shape `{shape.id()}`", (graph.child(lamp, "radiance"), 1.0)
