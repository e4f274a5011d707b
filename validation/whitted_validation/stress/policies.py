"""Ways for a ray to leave the surface that it starts from without meeting it again.

ours
    the plugin as it is.
ours, Embree
    the plugin as it is where a scene holds many shapes: it tries few spheres and planes one by one, and asks
    Embree for all others, from a start as far off as rounding demands there. Here it asks Embree for all.
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
    is_ours : whether this is the plugin's own arithmetic, of which all statements are demanded
    """

    name: str
    epsilon: float | None = None
    patches: Callable[[], Patches] = list
    is_ours: bool = False

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Replace functions of the plugin for as long as the policy is tried."""
        with ExitStack() as stack:
            for owner, name, value in self.patches():
                stack.enter_context(mock.patch.object(owner, name, value))
            yield


def _by_embree() -> Patches:
    from mitsuba_whitted import surfaces

    return [(surfaces, "few_of", lambda _rows, _instanced: [])]


def _spawn_ray() -> Patches:
    import drjit as dr
    import mitsuba as mi
    import numpy as np

    from mitsuba_whitted import precise, surfaces, trace
    from mitsuba_whitted.accel import Accel
    from mitsuba_whitted.ray import NOTHING, Ray
    from mitsuba_whitted.surfaces import Hit, Surfaces

    load_dict = mi.load_dict

    def without_flag(description: Any, *args: Any, **kwargs: Any) -> Any:
        if isinstance(description, dict) and description.get("type") == "scene":
            description = {k: v for k, v in description.items() if k != "embree_use_robust_intersections"}
        return load_dict(description, *args, **kwargs)

    def first(self: Any, ray: Any, found: Any, active: Any, _inside: bool) -> Any:
        shifted, lead = ray.from_shifted()
        pi = self._scene.ray_intersect_preliminary(shifted, active=active)
        self.asked = shifted, pi  # for `hit`, which comes next
        nearer = active & pi.is_valid()
        return found.or_nearer(nearer, pi.t + lead, *self._met(pi, nearer))

    def hit(self: Any, found: Any, _ray: Any, _with_uv: bool) -> Any:
        ray, pi = self._searches[0].asked
        si = pi.compute_surface_interaction(ray, mi.RayFlags.All, found.valid)
        n, n_g = mi.Normal3d(si.sh_frame.n), mi.Normal3d(si.n)
        return Hit(found.shape, mi.Point3d(si.p), n, n_g, mi.Point2d(si.uv), mi.Vector3f(0))

    def spawned(p: Any, n_g: Any, d: Any) -> Any:
        length = (1 + dr.max(dr.abs(p))) * RAY_EPSILON
        return p + dr.select(dr.dot(n_g, d) < 0, -length, length) * n_g

    def ray_from(o: Any, d: Any, end: Any) -> Any:
        return Ray(mi.Point3d(o), mi.Vector3d(d), mi.Float(0), mi.Float(end), mi.Vector3f(0), mi.UInt32(NOTHING))

    def leaving(_stage: Any, _plan: Any, surface: Any, d: Any, end: Any) -> Any:
        return ray_from(spawned(mi.Point3f(surface.hit.p), surface.n_g, mi.Vector3f(d)), d, end)

    def shadow_ray(_stage: Any, _plan: Any, surface: Any, light: Any) -> Any:
        p = mi.Point3f(surface.hit.p)
        o = spawned(p, surface.n_g, light.l)
        there = p + light.distance * light.l - o
        length = dr.norm(there)
        is_near = light.distance < dr.inf
        return ray_from(
            o,
            dr.select(is_near, there / length, light.l),
            dr.select(is_near, length * (1 - SHADOW_EPSILON), dr.inf),
        )

    def blocked(self: Any, ray: Any, active: Any, _inside: bool) -> Any:
        return self._scene.ray_test(ray.from_shifted()[0], active=active)

    def specular_power(n: Any, h: Any, exponent: Any) -> Any:
        n_h = dr.dot(n, h)
        return dr.select(n_h > 0, dr.power(dr.maximum(n_h, 0), exponent), 0)

    return [
        *_by_embree(),
        (surfaces, "centre_of", lambda _graph: np.zeros(3)),
        (mi, "load_dict", without_flag),
        (Accel, "first", first),
        (Accel, "blocked", blocked),
        (Surfaces, "hit", hit),
        (trace, "_leaving", leaving),
        (trace, "_shadow_ray", shadow_ray),
        (precise, "specular_power", specular_power),
    ]


OURS = Policy("ours", is_ours=True)
BY_EMBREE = Policy("ours, Embree", patches=_by_embree, is_ours=True)
SPAWN_RAY = Policy("spawn_ray", patches=_spawn_ray)
EPSILONS = tuple(Policy(f"eps 1e-{digits}", epsilon=10.0**-digits) for digits in range(6, 0, -1))
POLICIES = (*EPSILONS, SPAWN_RAY, BY_EMBREE, OURS)
