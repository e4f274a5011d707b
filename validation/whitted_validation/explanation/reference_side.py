"""What the reference tracer did for one sample, in the same records as the plugin's own (`mitsuba_whitted.explain`)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any, TypeVar

from mitsuba_whitted.seen import LightSeen, Numbers, PixelSeen, RaySeen, SampleSeen
from whitted_reference.lights import Light, Point
from whitted_reference.materials import Terms
from whitted_reference.ray_tree import LightNode, RayNode, Recorder, Tree
from whitted_reference.scene import Scene
from whitted_reference.vectors import BLACK, Colour, Vec, dot, scaled, sub

_COLOURS = ("throughput", "emitted", "ambient", "k_d", "k_s", "k_m", "irradiance", "diffuse", "specular", "colour")

Seen = TypeVar("Seen", PixelSeen, SampleSeen, RaySeen, LightSeen)


def seen_by_reference(scene: Scene, recorder: Recorder, tree: Tree, eye: Vec | None) -> SampleSeen:
    """Read a traced sample; every number is a double.

    Parameters
    ----------
    eye : where distances of the camera ray are counted from, None for where it starts
    """
    rays: list[RaySeen] = []
    throughput: Colour = (1.0, 1.0, 1.0)
    for node in _chain(tree.root):
        ray = RaySeen(node.k, node.e, node.d, throughput)
        _read(scene, recorder, node, ray)
        if node.k == 0 and eye is not None:
            ray.o, ray.t = eye, ray.t + math.dist(node.e, eye)
        rays.append(ray)
        throughput = _times(throughput, ray.k_m or BLACK)
    return SampleSeen(rays, tree.colour)


def in_grey(seen: Seen) -> Seen:
    """Keep one of three equal channels of every colour, as the plugin does in a mono variant."""
    values: dict[str, Any] = {}
    for part in fields(seen):
        value = getattr(seen, part.name)
        values[part.name] = value[:1] if part.name in _COLOURS else value
        if isinstance(value, list):
            values[part.name] = [in_grey(each) for each in value]
    return replace(seen, **values)


def _chain(node: RayNode | None) -> Iterator[RayNode]:
    while node is not None:
        yield node
        node = node.mirror


def _read(scene: Scene, recorder: Recorder, node: RayNode, ray: RaySeen) -> None:
    max_depth = scene.settings.max_depth if scene.settings.max_depth >= 0 else float("inf")
    lamps_count = node.k + 1 <= max_depth
    if node.shape is None:
        ray.emitted = ray.colour = scene.background if lamps_count else BLACK
        return
    p, n, n_g = node.p, node.n, node.n_g
    assert p is not None
    assert n is not None
    assert n_g is not None
    surface = recorder.primitives[node.primitive].surface
    ray.shape, ray.t, ray.p, ray.n, ray.n_g = node.shape, node.t, p, n, n_g
    ray.facing = -dot(n, node.d) > 0 and -dot(n_g, node.d) > 0
    side = surface.front if node.front or surface.back is None else surface.back
    ray.emitted = ray.ambient = ray.colour = BLACK
    if ray.facing and lamps_count and side is surface.front and surface.emission is not None:
        ray.emitted = ray.colour = surface.emission
    ray.lit = ray.facing and node.k + 2 <= max_depth
    if not ray.lit:
        return
    terms = side.constant or side.at(*(node.uv or (0.0, 0.0)))
    ray.ambient = _times(terms.ambient or BLACK, scene.settings.ambient)
    ray.k_d, ray.k_s, ray.k_m = terms.diffuse, terms.specular or BLACK, terms.mirror or BLACK
    ray.exponent = float(terms.exponent)
    nodes = {light.id: light for light in node.lights}
    ray.lights = [_light(recorder, light, nodes.get(light.id), terms, p, n, n_g, node.d) for light in recorder.lights]
    ray.colour = ray.emitted
    for part in (ray.ambient, *(light.colour for light in ray.lights)):
        ray.colour = _sum(ray.colour, part)
    ray.r = sub(node.d, scaled(n, 2 * dot(node.d, n)))
    ray.goes_on = node.mirror is not None


def _light(
    recorder: Recorder, light: Light, node: LightNode | None, terms: Terms, p: Vec, n: Vec, n_g: Vec, d: Vec
) -> LightSeen:
    arrival = light.arrive(*p)
    if arrival is None:  # outside its cone: the direction is that of a point light
        assert isinstance(light, Point)
        lx, ly, lz, distance, _ = Point.arrive(light, *p) or (0.0, 0.0, 0.0, 0.0, BLACK)
        irradiance = BLACK
    else:
        lx, ly, lz, distance, irradiance = arrival
    l = (lx, ly, lz)  # noqa: E741
    n_l = dot(n, l)
    half = sub(l, d)
    size = dot(half, half) ** 0.5
    h: Vec = scaled(half, 1 / size) if size else BLACK
    above = node is not None and node.above
    visible = above and node is not None and node.blocked_by is None
    highlight = recorder.highlight(n, d, l, terms.exponent) if size else 0.0
    return LightSeen(
        id=light.id,
        l=l,
        distance=distance,
        irradiance=irradiance,
        h=h,
        n_l=n_l,
        n_g_l=dot(n_g, l),
        n_h=dot(n, h),
        above=above,
        visible=visible,
        blocked_by=node.blocked_by if node else None,
        diffuse=scaled(_times(terms.diffuse, irradiance), n_l),
        specular=scaled(_times(terms.specular or BLACK, irradiance), highlight),
        colour=node.colour if node and visible else BLACK,
    )


def _sum(a: Numbers, b: Numbers) -> Numbers:
    return tuple(x + y for x, y in zip(a, b, strict=True))


def _times(a: Numbers, b: Numbers) -> Colour:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]
