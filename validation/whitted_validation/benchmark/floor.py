"""The floor under the time of a picture: what balls on a floor cannot do without, written out by hand for them alone.

To the limit's rays it adds what a picture is made of: exact hits in double, normals, Blinn-Phong light, mirrors and the
film. It knows that there are balls, one floor that is in nobody's way, a lamp and a sun; it has no plan and no shape of
another kind, no backs, masks of materials, textures, bounds or counts. So it is no renderer, but the least that one in
this language and on these ray queries may take.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi

from whitted_validation.benchmark.limit import MAX_DEPTH, camera_rays

OFFSET = 2.0**-16
"""World units, in a scene some ten wide: a constant, which is the cheapest of offsets."""


class Floor:
    """The kernel for one scene of kind a or b of `scenes`; a Dr.Jit variant must be set.

    Raises
    ------
    ValueError
        If the scene is of another kind.
    """

    def __init__(self, file: Path, size: int) -> None:
        self._size = size
        self._scene: Any = mi.load_file(str(file), optimize=False, size=str(size))
        root = ET.parse(file).getroot()
        floor, *balls = root.iter("shape")
        lights = list(root.iter("emitter"))[1:]  # after the sky
        kinds = [shape.get("type") for shape in balls], [light.get("type") for light in lights]
        if floor.get("id") != "floor" or set(kinds[0]) != {"sphere"} or kinds[1] != ["point", "directional"]:
            raise ValueError("this is no scene of balls on a floor under a lamp and a sun")
        spheres = [shape for shape in self._scene.shapes() if shape.id() != "floor"]
        self._balls: Any = mi.load_dict(
            {"type": "scene", **{f"ball_{i:03}": sphere for i, sphere in enumerate(spheres)}}, optimize=False
        )
        self._centre_r = mi.Float64(
            [x for ball in balls for x in (*_numbers(ball, "center"), *_numbers(ball, "radius"))]
        )
        materials = [shape.find("bsdf") for shape in (*balls, floor)]
        self._k_d_k_m = mi.Float(_rows(materials, "diffuse_reflectance", "mirror_reflectance"))
        self._k_s_p = mi.Float(_rows(materials, "specular_reflectance", "exponent"))
        self._floor = mi.UInt32(len(balls))
        self._side = mi.Float(_numbers(floor.find("transform"), None)[-1])
        lamp, sun = lights
        self._lamp = mi.Vector3d(_numbers(lamp, "position"))
        self._intensity = mi.Color3f(_numbers(lamp, "intensity"))
        self._to_sun = mi.Vector3f(dr.normalize(mi.Vector3d(_numbers(sun, "direction")) * -1))
        self._irradiance = mi.Color3f(_numbers(sun, "irradiance"))
        self._sky = mi.Color3f(_numbers(next(root.iter("emitter")), "radiance"))
        self._ambient = mi.Color3f(_numbers(root.find("integrator"), "ambient"))
        dr.make_opaque([value for value in vars(self).values() if dr.is_array_v(value)])

    def draw(self) -> Any:
        """Start the kernel, and return the picture."""
        pixel, ray = camera_rays(self._scene, self._size)
        d = dr.normalize(mi.Vector3d(ray.d))
        state = mi.UInt32(1), mi.Point3d(ray.o), d, mi.Color3f(1), mi.Color3f(0), mi.UInt32(2**32 - 1), mi.Bool(True)
        final: Any = dr.while_loop(state, lambda *state: state[-1], self._bounce, label="mirror bounces")
        picture = dr.empty(mi.Float, 3 * self._size**2)
        for i, value in enumerate(final[4]):
            dr.scatter(picture, value, 3 * pixel + i, mode=dr.ReduceMode.Permute)
        return mi.TensorXf(picture, (self._size, self._size, 3))

    def _bounce(self, k: Any, o: Any, d: Any, throughput: Any, colour: Any, own: Any, active: Any) -> tuple[Any, ...]:
        origin: Any = mi.Point3f(o)
        way: Any = mi.Vector3f(d)
        to_floor = -origin.y * dr.rcp(way.y)
        foot = dr.fma(to_floor, way, origin)
        on_floor = (to_floor > 0) & (own != self._floor) & (dr.maximum(dr.abs(foot.x), dr.abs(foot.z)) <= self._side)
        end = dr.select(on_floor, to_floor, dr.inf)
        pi = self._first(origin, way, end, active)
        on_ball = active & pi.is_valid()
        found = active & (on_ball | on_floor)
        shape = dr.select(on_ball, pi.shape_index, self._floor)

        centre_r: Any = dr.gather(mi.Vector4d, self._centre_r, pi.shape_index, on_ball)
        to_centre = o - mi.Point3d(centre_r.xyz)
        b = -dr.dot(to_centre, d)
        across = dr.fma(b, d, to_centre)
        half_chord = dr.sqrt(dr.maximum(centre_r.w * centre_r.w - dr.squared_norm(across), 0))
        outward = dr.fma(-half_chord, d, across)
        p = dr.select(on_ball, mi.Point3d(centre_r.xyz) + outward, dr.fma(-o.y * dr.rcp(d.y), d, o))
        exact_n = dr.select(on_ball, outward * dr.rcp(centre_r.w), mi.Vector3d(0, 1, 0))
        n = mi.Vector3f(exact_n)

        k_d_k_m: Any = dr.gather(mi.Vector4f, self._k_d_k_m, shape, found)
        k_s_p: Any = dr.gather(mi.Vector4f, self._k_s_p, shape, found)
        k_d, k_s = mi.Color3f(k_d_k_m.xyz), mi.Color3f(k_s_p.xyz)
        lit = found & (k < MAX_DEPTH)
        start = dr.fma(OFFSET, n, mi.Point3f(p))
        to_lamp = mi.Vector3f(self._lamp - p)
        squared = dr.squared_norm(to_lamp)
        radiance = k_d * self._ambient
        for l, light, far in (  # noqa: E741  # the textbook's letter
            (to_lamp * dr.rsqrt(squared), self._intensity * dr.rcp(squared), dr.sqrt(squared)),
            (self._to_sun, self._irradiance, mi.Float(dr.inf)),
        ):
            n_l = dr.dot(n, l)
            facing = lit & (n_l > 0)

            def shine(l: Any = l, light: Any = light, far: Any = far, n_l: Any = n_l, facing: Any = facing) -> Any:  # noqa: E741
                h = dr.normalize(l - way)
                f = dr.fma(k_s, dr.power(dr.maximum(dr.dot(n, h), 1e-20), k_s_p.w), k_d * n_l)
                blocked = self._first(start, l, far, facing).is_valid()
                return (dr.select(facing & (blocked ^ True), f * light, 0),)

            added: tuple[Any] = dr.if_stmt((), facing, shine, _dark, label="light")
            radiance = radiance + added[0]
        seen = dr.select(found, dr.select(lit, radiance, 0), self._sky)
        colour = dr.select(active, dr.fma(throughput, seen, colour), colour)
        mirrored = mi.Vector3d(dr.fma(-2 * dr.dot(d, exact_n), exact_n, d))
        goes_on = lit & (k_d_k_m.w > 0)
        return k + 1, dr.fma(OFFSET, exact_n, p), mirrored, throughput * k_d_k_m.w, colour, shape, goes_on

    def _first(self, o: Any, d: Any, end: Any, active: Any) -> Any:
        """Ask which ball is first; for shadows too, since Mitsuba's ``ray_test`` misses small far ones."""
        ray = mi.Ray3f(o, d)
        ray.maxt = end
        return self._balls.ray_intersect_preliminary(ray, coherent=False, active=active)


def _dark() -> tuple[Any]:
    return (mi.Color3f(0),)


def _numbers(of: Any, name: str | None) -> list[float]:
    """Read the numbers of a parameter, or of the last element."""
    element = [each for each in of if name is None or each.get("name") == name][-1]
    return [float(text) for text in element.get("value").split(",")]


def _rows(materials: list[Any], colour: str, number: str) -> list[float]:
    """Read a colour and a number of each material, 0 where it is not given, one after another."""

    def read(material: Any, name: str) -> list[float]:
        return _numbers(material, name) if any(each.get("name") == name for each in material) else [0.0]

    return [x for material in materials for x in (*(read(material, colour) * 3)[:3], *read(material, number))]
