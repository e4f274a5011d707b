"""What a scene needs, found before tracing: the kernel is made of this and of nothing else."""

from __future__ import annotations

import re
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

from mitsuba_whitted.camera import Camera
from mitsuba_whitted.shapes import Kind
from mitsuba_whitted.stage import Stage
from mitsuba_whitted.tables import FEW_ROWS


def _part(words: str, without: str) -> Any:
    """Describe a part of the kernel, and why a scene may do without it."""
    return field(metadata={"words": words, "without": without})


@dataclass(frozen=True)
class Plan:
    """The structure of a scene: scenes of one plan share one kernel, whatever their values. Printing it explains it."""

    shapes: tuple[str, ...] = _part("exact hits on {}", "there is no shape")
    few: tuple[str, ...] = _part("one by one, without a search: {}", "too many shapes, or of other kinds")
    searched: bool = _part("Embree's search", "there is nothing that the kernel does not try one by one")
    inside: bool = _part("rays that begin inside a ball", "camera and lights are outside of all balls")
    smooth_normals: bool = _part("interpolated vertex normals", "no mesh has vertex normals")
    instances: bool = _part("instances", "there is none")
    tables: bool = _part("tables of shapes", "so few shapes are constants of the kernel")
    materials: bool = _part("coefficients of several materials", "all surfaces wear the same")
    textured: bool = _part("texture coordinates and textures", "every coefficient is constant on its surface")
    two_sided: bool = _part("the back of surfaces", "no BSDF is two-sided")
    emission: bool = _part("glowing surfaces", "no area emitter")
    background: bool = _part("background", "no environment emitter")
    ambient: bool = _part("ambient term", "no ambient light, or no surface reflects it")
    diffuse: bool = _part("diffuse term", "no light, or no surface with k_d")
    specular: bool = _part("highlight and its power", "no light, or no surface with k_s")
    lights: tuple[str, ...] = _part("light from {}", "no light, or nothing that it could light")
    shadows: bool = _part("shadow rays", "no light, nothing that could block it, or switched off")
    casting: tuple[str, ...] = _part("of those tried one by one, shadows of {}", "none of them could block a light")
    inverse_square: bool = _part("falloff with the squared distance", "no point or spot light, or switched off")
    mirrors: bool = _part("the loop over mirror bounces", "no surface with k_m, nothing to be seen, or switched off")
    epsilon: bool = _part("the textbook's epsilon", "rays start where rounding demands")

    def __str__(self) -> str:
        needed: list[str] = []
        left_out: list[str] = []
        for part in fields(self):
            value = getattr(self, part.name)
            words = part.metadata["words"].format(", ".join(value) if isinstance(value, tuple) else "")
            if value:
                needed.append(f"  {words}")
            else:
                name = re.sub(r"( on| from| of|:) \{\}$", "", part.metadata["words"])
                left_out.append(f"  {name}: {part.metadata['without']}")
        return "\n".join(["in the kernel:", *(needed or ["  nothing"]), "left out:", *(left_out or ["  nothing"])])


def plan_of(stage: Stage, camera: Camera | None = None) -> Plan:
    """Look at the tables of a scene and say what they need, seen by this camera, or from anywhere."""
    settings, surfaces, materials = stage.settings, stage.surfaces, stage.materials
    diffuse = settings.enable_diffuse and materials.k_d.present
    specular = settings.enable_specular and materials.k_s.present
    lights = tuple(lights.described() for lights in stage.lights) if diffuse or specular else ()
    ambient = settings.enable_ambient and any(settings.ambient) and materials.k_a.present
    emission, background = stage.emission.present, stage.environment is not None
    casters = surfaces.few.casters
    shadows = bool(lights) and settings.enable_shadows and (surfaces.searched or bool(casters))
    coefficients = [materials.k_d, materials.k_s, materials.k_m, materials.k_a, materials.exponent]
    return Plan(
        shapes=tuple(kind.name.lower() for kind in sorted(surfaces.kinds)),
        few=surfaces.few.described(set(surfaces.few.numbers)),
        searched=surfaces.searched,
        inside=_inside(stage, camera),
        smooth_normals=surfaces.meshes.smooth,
        instances=surfaces.instances is not None,
        tables=len(surfaces.rows) > FEW_ROWS,
        materials=bool(surfaces.rows) and not materials.one,
        textured=any(k.textures for k in [*coefficients, stage.emission]),
        two_sided=materials.two_sided,
        emission=emission,
        background=background,
        ambient=ambient,
        diffuse=bool(lights) and diffuse,
        specular=bool(lights) and specular,
        lights=lights,
        shadows=shadows,
        casting=surfaces.few.described(casters) if shadows else (),
        inverse_square=settings.falloff == "inverse_square" and any("directional" not in kind for kind in lights),
        mirrors=settings.enable_mirrors and materials.k_m.present and bool(lights or ambient or emission or background),
        epsilon=settings.epsilon is not None,
    )


def _inside(stage: Stage, camera: Camera | None) -> bool:
    """Whether a ray may begin inside one of the balls that are tried one by one, or a light stand there.

    Whoever looks from outside sees only points that are outside of all balls, or on them, and only their outward
    sides: mirrors and shadow rays begin there. The textbook's epsilon moves a ray's begin, into a ball perhaps.
    """
    surfaces = stage.surfaces
    balls = [row for row in (surfaces.rows[number] for number in surfaces.few.numbers) if row.kind == Kind.SPHERE]
    if not balls:
        return False
    if camera is None or stage.settings.epsilon is not None or not camera.is_outside(balls):
        return True
    places = [place for lights in stage.lights if lights.kind != "directional" for place in lights.where]
    return any(np.linalg.norm(place - ball.a) <= ball.r for place in places for ball in balls)
