"""How bright a mirrored ray can be at most: what ends a chain of mirrors where it no longer counts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import mitsuba as mi
import numpy as np

from mitsuba_whitted.lights import colour_of
from mitsuba_whitted.scene_graph import SceneGraph, number
from mitsuba_whitted.transforms import matrix_of

if TYPE_CHECKING:
    from mitsuba_whitted.stage import Stage


def most_radiance(graph: SceneGraph, stage: Stage, rays: int) -> float:
    """Bound the radiance along any ray that starts a chain of at most `rays` mirrors.

    A surface shines with at most B = emission + k_a I_a + (k_d + k_s) sum I, since neither n.l nor (n.h)^p
    exceeds 1; the background with its own radiance; and mirrors add B k_m + B k_m^2 + ... Every factor is the
    scene's largest, in the brightest channel. Point and spot lights count with their distance from the nearest
    shape's bounding box, or surface of a sphere.

    Returns
    -------
    float
        In the units of radiance; infinite where a light touches such a box.
    """
    materials, settings = stage.materials, stage.settings
    light = sum(_most_light(graph, emitter, settings.falloff) for emitter in graph.emitters)
    reflected = materials.k_d.largest + materials.k_s.largest
    surface = stage.emission.largest + materials.k_a.largest * max(settings.ambient)
    surface += reflected * light if reflected else 0.0
    k_m = materials.k_m.largest
    mirrors = rays if k_m == 1 else (1 - k_m**rays) / (1 - k_m)
    return float(max(surface, _most_background(graph)) * mirrors)


def _most_light(graph: SceneGraph, emitter: Any, falloff: str) -> float:
    """Bound the light of one emitter that arrives anywhere."""
    kind = emitter.class_name()
    if kind == "DirectionalEmitter":
        return max(colour_of(graph, emitter, "irradiance"))
    if kind not in ("PointLight", "SpotLight"):
        return 0.0
    intensity = max(colour_of(graph, emitter, "intensity"))
    if falloff == "none" or not intensity:
        return intensity
    if kind == "PointLight":
        position = np.array(graph.value(emitter, "position"), float).ravel()
    else:
        position = matrix_of(graph.value(emitter, "to_world"), f"emitter `{emitter.id()}`")[:3, 3]
    distance = min((_distance(graph, shape, position) for shape in graph.shapes), default=np.inf)
    return intensity / distance**2 if distance else np.inf


def _distance(graph: SceneGraph, shape: Any, position: Any) -> float:
    """Least distance that `position` can have from a shape."""
    if shape.class_name() == "Sphere":
        to_world = matrix_of(graph.value(shape, "to_world"), f"shape `{shape.id()}`")
        return float(abs(np.linalg.norm(position - to_world[:3, 3]) - np.linalg.norm(to_world[:3, 0])))
    box = shape.bbox()
    low, high = np.array(box.min, float), np.array(box.max, float)
    return float(np.linalg.norm(np.maximum(0, np.maximum(low - position, position - high))))


def _most_background(graph: SceneGraph) -> float:
    sky = graph.environment
    if sky is None:
        return 0.0
    if sky.class_name() == "ConstantBackgroundEmitter":
        return max(colour_of(graph, sky, "radiance"))
    values = graph.nodes[sky].values
    if "data" not in values:
        return float(np.inf)
    scale = number(graph.value(sky, "scale")) if "scale" in values else 1.0
    return scale * float(np.max(np.array(mi.TensorXf(graph.value(sky, "data")))))
