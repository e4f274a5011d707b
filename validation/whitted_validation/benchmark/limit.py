"""The limit to measure against: a kernel that asks Embree for the rays of a picture, and does nothing else with them.

Its rays are those of `whitted`'s general kernel: camera rays through the pixel centres in 4x4 tiles, for each light
above the horizon one shadow ray, and mirror rays; all are coherent, as Embree calls it. Normals come from Mitsuba's
own records. In place of shading it keeps which shapes a pixel's chain of rays met. It reads the scenes of `scenes`.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any, NamedTuple

import drjit as dr
import mitsuba as mi

TILE = 4
"""Side of a tile in pixels; 16 of them fill a vector of 512 bits."""

PATH_BITS = 0xFFFFFF
"""So much of a chain's number a float32 holds exactly."""

MAX_DEPTH = 10
"""As in every scene of `scenes`."""


class Asked(NamedTuple):
    """What the rays of each pixel found."""

    path: Any
    """Number of the chain: with h the shapes met, counted from 1, or 0 for none, path <- 31 path + h."""
    unshadowed: Any
    """Shadow rays that met nothing."""
    mirror: Any
    shadow: Any


def camera_rays(scene: Any, size: int) -> tuple[Any, Any]:
    """Make the rays through all pixel centres, tile by tile, and the number of each one's pixel in the picture."""
    lane = dr.arange(mi.UInt32, size**2)
    tile, inner = lane // TILE**2, lane % TILE**2
    across = size // TILE
    x = tile % across * TILE + inner % TILE
    y = tile // across * TILE + inner // TILE
    on_film = mi.Point2f((mi.Float(x) + 0.5) / size, (mi.Float(y) + 0.5) / size)
    ray, _ = scene.sensors()[0].sample_ray(mi.Float(0), mi.Float(0), on_film, mi.Point2f(0))
    return y * size + x, ray


class Limit:
    """The kernel for one scene; a Dr.Jit variant must be set."""

    def __init__(self, file: Path, size: int) -> None:
        if size % TILE:
            raise ValueError(f"size {size} is no multiple of {TILE}")
        self._size = size
        self._scene: Any = mi.load_file(str(file), optimize=False, size=str(size))
        root = ET.parse(file).getroot()
        sided = {shape.get("id"): _two_sided_and_mirrors(shape) for shape in root.iter("shape")}
        self._sided = mi.UInt32([number for shape in self._scene.shapes() for number in sided[shape.id()]])
        self._positions = [_triple(e, "position") for e in root.iter("emitter") if e.get("type") == "point"]
        self._directions = [-_triple(e, "direction") for e in root.iter("emitter") if e.get("type") == "directional"]
        dr.make_opaque(self._sided, self._positions, self._directions)

    def draw(self) -> Any:
        """Start the kernel; the picture's three channels are the first three of `Asked`."""
        pixel, asked = self._ask()
        picture = dr.empty(mi.Float, 3 * self._size**2)
        for i, value in enumerate((asked.path & PATH_BITS, asked.unshadowed, asked.mirror)):
            dr.scatter(picture, mi.Float(value), 3 * pixel + i, mode=dr.ReduceMode.Permute)
        return mi.TensorXf(picture, (self._size, self._size, 3))

    def count_rays(self) -> dict[str, int]:
        """Count the rays of each kind."""
        _, asked = self._ask()
        dr.eval(asked.mirror, asked.shadow)
        mirror, shadow = (int(dr.sum(mi.UInt64(number))[0]) for number in (asked.mirror, asked.shadow))
        return {"camera": self._size**2, "mirror": mirror, "shadow": shadow}

    def _ask(self) -> tuple[Any, Asked]:
        """Trace all rays; return the number of the pixel in the picture as well."""
        pixel, ray = camera_rays(self._scene, self._size)
        zero = mi.UInt32(0)
        state = (mi.UInt32(0), mi.Point3f(ray.o), mi.Vector3f(ray.d), zero, zero, zero, zero, mi.Bool(True))
        final: Any = dr.while_loop(state, lambda *state: state[-1], self._bounce, label="mirror bounces")
        return pixel, Asked(*final[3:7])

    def _bounce(
        self, k: Any, o: Any, d: Any, path: Any, unshadowed: Any, mirror: Any, shadow: Any, active: Any
    ) -> tuple[Any, ...]:
        ray = mi.Ray3f(o, d)
        pi = self._scene.ray_intersect_preliminary(ray, coherent=True, active=active)
        found = active & pi.is_valid()
        path = dr.select(active, path * 31 + dr.select(found, pi.shape_index + 1, 0), path)
        si = pi.compute_surface_interaction(ray, mi.RayFlags.Minimal | mi.RayFlags.ShadingFrame, found)
        sided = dr.gather(mi.Vector2u, self._sided, pi.shape_index, found)
        n, n_g = mi.Normal3f(si.sh_frame.n), mi.Normal3f(si.n)
        behind = (sided.x != 0) & (dr.dot(n, d) > 0)
        n, n_g = dr.select(behind, -n, n), dr.select(behind, -n_g, n_g)
        lit = found & (dr.dot(n, d) < 0) & (dr.dot(n_g, d) < 0) & (k + 1 < MAX_DEPTH)

        def ask(l: Any, shadow_ray: Any) -> None:  # noqa: E741
            nonlocal unshadowed, shadow
            facing = lit & (dr.dot(n, l) > 0) & (dr.dot(n_g, l) > 0)
            blocked = self._scene.ray_test(shadow_ray, coherent=True, active=facing)
            unshadowed = unshadowed + dr.select(facing & (blocked ^ True), mi.UInt32(1), 0)
            shadow = shadow + dr.select(facing, mi.UInt32(1), 0)

        for position in self._positions:
            ask(position - si.p, si.spawn_ray_to(mi.Point3f(position)))
        for way in self._directions:
            ask(way, si.spawn_ray(mi.Vector3f(dr.normalize(way))))

        r: Any = mi.Vector3f(d - 2 * dr.dot(d, n) * n)
        goes_on = lit & (sided.y != 0) & (dr.dot(n_g, r) > 0)
        mirrored = si.spawn_ray(r)
        mirror = mirror + dr.select(goes_on, mi.UInt32(1), 0)
        return k + 1, mi.Point3f(mirrored.o), mi.Vector3f(mirrored.d), path, unshadowed, mirror, shadow, goes_on


def _two_sided_and_mirrors(shape: ET.Element) -> tuple[int, int]:
    """Say whether a shape is drawn from both sides, and whether it is a mirror."""
    two_sided = any(bsdf.get("type") == "twosided" for bsdf in shape.iter("bsdf"))
    k_m = [e.get("value", "0") for e in shape.iter("float") if e.get("name") == "mirror_reflectance"]
    return int(two_sided), int(any(float(value) for value in k_m))


def _triple(emitter: ET.Element, name: str) -> Any:
    texts = [e.get("value", "").split(",") for e in emitter if e.get("name") == name]
    return mi.Vector3f(*(float(text) for text in texts[0]))
