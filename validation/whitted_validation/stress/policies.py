"""Ways for a ray to leave the surface that it starts from without meeting it again.

ours
    the plugin as it is: hits computed anew, starts as far off as rounding demands there (``precise``).
eps 1e-6 ... eps 1e-1
    the textbook's constant, through the plugin's own parameter `epsilon`: whatever is nearer does not count.
spawn_ray
    Mitsuba 3.9.1's habits: the interaction as Mitsuba computes it; secondary rays from
    p + sign(n.d) (1 + max|p|) 1500 u n; shadow rays tested by ``ray_test`` and ended at (1 - 15000 u) of the
    way to the light; Embree without its robust flag, as is Mitsuba's default; powers by ``dr.power``.
    (include/mitsuba/render/interaction.h, include/mitsuba/core/math.h at tag v3.9.1)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any
from unittest import mock

RAY_EPSILON = 1500 * 2.0**-24
SHADOW_EPSILON = 15000 * 2.0**-24

Patches = list[tuple[Any, str, Any]]  # where, name, what stands there instead


@dataclass(frozen=True)
class Policy:
    """One way.

    Attributes
    ----------
    epsilon : the plugin's parameter, in world units; None leaves it unset
    patches : makes the functions that replace the plugin's own; called once a variant is set
    """

    name: str
    epsilon: float | None = None
    patches: Callable[[], Patches] = list

    @property
    def is_ours(self) -> bool:
        """Tell whether the plugin stays as it is."""
        return self.epsilon is None and self.patches is list

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Replace functions of the plugin for as long as the policy is tried."""
        with ExitStack() as stack:
            for owner, name, value in self.patches():
                stack.enter_context(mock.patch.object(owner, name, value))
            yield


def _spawn_ray() -> Patches:
    import drjit as dr
    import mitsuba as mi

    from mitsuba_whitted import precise, trace
    from mitsuba_whitted.surfaces import Hit, Surfaces

    load_dict = mi.load_dict

    def without_flag(description: Any, *args: Any, **kwargs: Any) -> Any:
        if isinstance(description, dict) and description.get("type") == "scene":
            description = {k: v for k, v in description.items() if k != "embree_use_robust_intersections"}
        return load_dict(description, *args, **kwargs)

    def hit(self: Any, pi: Any, ray: Any, _o: Any, _with_uv: bool) -> Any:
        valid = pi.is_valid()
        si = pi.compute_surface_interaction(ray, mi.RayFlags.All, valid)
        # `reach` carries to `ray_offset` what that policy wants to know: the point.
        reach = mi.Vector3f(dr.abs(si.p))
        return Hit(self.accel.met(pi, valid).shape, si.p, mi.Normal3f(si.sh_frame.n), si.n, si.uv, reach)

    def ray_offset(n_g: Any, d: Any, reach: Any, _least: Any) -> tuple[Any, Any]:
        length = (1 + dr.max(reach)) * RAY_EPSILON
        return dr.select(dr.dot(n_g, d) < 0, -length, length) * n_g, length

    def shadow_ray(_stage: Any, _plan: Any, found: Any, n_g: Any, light: Any) -> Any:
        shift, _ = ray_offset(n_g, light.l, found.reach, None)
        there = light.distance * light.l - shift
        length = dr.norm(there)
        is_near = light.distance < dr.inf
        d = dr.select(is_near, there / length, light.l)
        end = dr.select(is_near, length * (1 - SHADOW_EPSILON), dr.inf)
        o = mi.Point3f(found.p + shift)
        return mi.Ray3f(o, mi.Vector3f(d), mi.Float(end), 0, [])  # type: ignore[call-overload]  # stub without rgb

    def blocked(self: Any, ray: Any, active: Any) -> Any:
        return self.accel.any_hit(ray, active)

    def specular_power(n: Any, h: Any, exponent: Any) -> Any:
        n_h = dr.dot(n, h)
        return dr.select(n_h > 0, dr.power(dr.maximum(n_h, 0), exponent), 0)

    return [
        (mi, "load_dict", without_flag),
        (Surfaces, "hit", hit),
        (precise, "ray_offset", ray_offset),
        (precise, "specular_power", specular_power),
        (trace, "_shadow_ray", shadow_ray),
        (Surfaces, "blocked", blocked),
    ]


OURS = Policy("ours")
SPAWN_RAY = Policy("spawn_ray", patches=_spawn_ray)
EPSILONS = tuple(Policy(f"eps 1e-{digits}", epsilon=10.0**-digits) for digits in range(6, 0, -1))
POLICIES = (*EPSILONS, SPAWN_RAY, OURS)
