"""What a scene needs, found before tracing: the kernel is made of this and of nothing else."""

from __future__ import annotations

from dataclasses import dataclass, fields

import mitsuba as mi

from mitsuba_whitted.stage import Settings, Stage


@dataclass(frozen=True)
class Plan:
    """The structure of a scene. Two scenes of one plan share one kernel, whatever their values."""

    shapes: tuple[str, ...]
    """Kinds of shapes that a hit must tell apart."""
    smooth_normals: bool
    instances: bool
    textured: bool
    """Whether any coefficient varies over a surface, so that texture coordinates are needed."""
    two_sided: bool
    emission: bool
    background: bool
    ambient: bool
    diffuse: bool
    specular: bool
    lights: tuple[str, ...]
    """Kinds of lights, each with its number while they stand in the kernel one by one."""
    shadows: bool
    inverse_square: bool
    mirrors: bool
    epsilon: bool
    """Whether rays start the textbook's constant away, instead of where rounding demands."""

    def __str__(self) -> str:
        present, absent = [], []
        for field in fields(self):
            value, name = getattr(self, field.name), field.name.replace("_", " ")
            if isinstance(value, tuple):
                (present if value else absent).append(f"{name}: {', '.join(value)}" if value else name)
            else:
                (present if value else absent).append(name)
        return f"in the kernel: {'; '.join(present) or 'nothing'}\nleft out: {'; '.join(absent) or 'nothing'}"


def plan_of(stage: Stage) -> Plan:
    """Look at the tables of a scene and say what they need."""
    settings, surfaces, materials = stage.settings, stage.surfaces, stage.materials
    diffuse = settings.enable_diffuse and materials.k_d.present
    specular = settings.enable_specular and materials.k_s.present
    lit = diffuse or specular
    lights = tuple(lights.described() for lights in stage.lights) if lit else ()
    coefficients = [materials.k_d, materials.k_s, materials.k_m, materials.k_a, materials.exponent]
    return Plan(
        shapes=tuple(kind.name.lower() for kind in sorted(surfaces.kinds)),
        smooth_normals=surfaces.meshes.smooth,
        instances=surfaces.instances is not None,
        textured=any(k.textures for k in [*coefficients, stage.emission]),
        two_sided=materials.two_sided,
        emission=stage.emission.present,
        background=stage.environment is not None,
        ambient=settings.enable_ambient and any(settings.ambient) and materials.k_a.present,
        diffuse=bool(lights) and diffuse,
        specular=bool(lights) and specular,
        lights=lights,
        shadows=bool(lights) and settings.enable_shadows,
        inverse_square=settings.falloff == "inverse_square" and any("directional" not in kind for kind in lights),
        mirrors=settings.enable_mirrors and materials.k_m.present,
        epsilon=settings.epsilon is not None,
    )


def plan(scene: mi.Scene, settings: Settings | None = None) -> Plan:
    """Say what `scene` needs.

    Parameters
    ----------
    scene : mi.Scene
        Any scene that `whitted` can draw.
    settings : Settings, optional
        Those of the scene's own integrator if it is a `whitted`, else the defaults.
    """
    if settings is None:
        settings = getattr(scene.integrator(), "settings", Settings())
    return plan_of(Stage(scene, settings))
