"""Scenes to measure on: seven kinds, each drawn anew from a seed, as Mitsuba XML with the meshes beside it.

All are written for `whitted` with max_depth 10, which is 8 mirror bounces with light, and one sample a pixel. The
side of the square picture is ``$size`` in the file, the pixels of the full film.
"""

from __future__ import annotations

import math
import random
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

Vector = tuple[float, float, float]

PLACING_TRIES = 10_000
"""Tries to put a ball where no other is, before it is left out: only a full floor comes to this."""


class Kind(NamedTuple):
    """What a scene of a kind shows."""

    title: str
    lights: int
    camera: tuple[Vector, Vector]
    """Where it stands and what it looks at; y is up."""
    shapes: Callable[[random.Random, Path], Iterator[str]]
    """XML of the shapes; meshes are written into the folder."""


def write(kind: str, folder: Path, seed: int = 0, lights: int | None = None) -> Path:
    """Write a scene and its meshes.

    Parameters
    ----------
    kind
        A letter of `KINDS`.
    folder
        Where to; it must exist.
    seed
        The same number gives the same bytes.
    lights
        How many, at least 1; None for as many as the kind has. Fewer are the first of those.

    Returns
    -------
    Path
        Of the XML file, ``KIND_SEED.xml``, or ``KIND_SEED_LIGHTS.xml`` where `lights` is given.
    """
    what = KINDS[kind]
    name = f"{kind}_{seed}" if lights is None else f"{kind}_{seed}_{lights}"
    rng = random.Random(seed)
    shapes = "\n".join(what.shapes(rng, folder / f"{kind}_{seed}"))
    file = folder / f"{name}.xml"
    origin, target = (",".join(f"{x:g}" for x in point) for point in what.camera)
    file.write_text(
        f"""<scene version="3.0.0">
<!-- {what.title}; seed {seed} -->
<default name="size" value="512"/>
<integrator type="whitted" id="whitted"><integer name="max_depth" value="10"/>
  <rgb name="ambient" value="0.2, 0.2, 0.22"/></integrator>
<sensor type="perspective" id="camera"><float name="fov" value="45"/>
  <transform name="to_world"><lookat origin="{origin}" target="{target}" up="0,1,0"/></transform>
  <sampler type="independent"><integer name="sample_count" value="1"/></sampler>
  <film type="hdrfilm"><integer name="width" value="$size"/><integer name="height" value="$size"/>
    <string name="pixel_format" value="rgb"/><string name="component_format" value="float32"/>
    <rfilter type="box"/></film></sensor>
<emitter type="constant" id="sky"><rgb name="radiance" value="0.25, 0.35, 0.5"/></emitter>
{_lights(random.Random(seed), what.lights if lights is None else lights)}
{shapes}
</scene>
""",
        encoding="utf-8",
    )
    return file


def _lights(rng: random.Random, count: int) -> str:
    """Write a point light, the sun, and then more of either: all together shine as bright as the first two."""
    parts = []
    for i in range(count):
        angle = rng.uniform(0.9 * math.pi, 2.1 * math.pi)  # the camera is at 1.5 pi
        x, y, z = 6 * math.cos(angle), rng.uniform(6, 9), 6 * math.sin(angle)
        if i % 2:
            strength = 0.8 / count
            parts.append(
                f'<emitter type="directional" id="sun_{i}">'
                f'<vector name="direction" value="{-x:.6g},{-y:.6g},{-z:.6g}"/>'
                f'<rgb name="irradiance" value="{strength:.6g},{0.95 * strength:.6g},{0.8 * strength:.6g}"/></emitter>'
            )
        else:
            strength = 120 / count
            parts.append(
                f'<emitter type="point" id="lamp_{i}"><point name="position" value="{x:.6g},{y:.6g},{z:.6g}"/>'
                f'<rgb name="intensity" value="{strength:.6g},{strength:.6g},{strength:.6g}"/></emitter>'
            )
    return "\n".join(parts)


def _material(rng: random.Random, mirror: float) -> str:
    """Choose a colour with a highlight; a mirror passes `mirror` of the light."""
    share = 0.35 if mirror else 0.85
    colour = ",".join(f"{rng.uniform(0.15, share):.4f}" for _ in range(3))
    return (
        f'<bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="{colour}"/>'
        f'<float name="specular_reflectance" value="{0.6 if mirror else 0.3}"/>'
        f'<float name="mirror_reflectance" value="{mirror:g}"/>'
        f'<float name="exponent" value="{rng.choice((20, 60, 150))}"/></bsdf>'
    )


def _floor(mirror: float = 0.0) -> str:
    return (
        '<shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/>'
        '<scale value="12"/></transform><bsdf type="blinnphong">'
        '<rgb name="diffuse_reflectance" value="0.55, 0.5, 0.45"/>'
        f'<float name="mirror_reflectance" value="{mirror:g}"/></bsdf></shape>'
    )


def _ball(number: int, centre: Vector, radius: float, material: str) -> str:
    x, y, z = centre
    return (
        f'<shape type="sphere" id="ball_{number}"><point name="center" value="{x:.6g},{y:.6g},{z:.6g}"/>'
        f'<float name="radius" value="{radius:.6g}"/>{material}</shape>'
    )


def _standing(
    rng: random.Random, count: int, around: float, radii: tuple[float, float]
) -> Iterator[tuple[Vector, float]]:
    """Stand balls on the floor, within `around` of its middle, that keep off one another."""
    placed: list[tuple[float, float, float]] = []
    for _ in range(PLACING_TRIES):
        r = rng.uniform(*radii)
        distance, angle = around * math.sqrt(rng.random()), rng.uniform(0, 2 * math.pi)
        x, z = distance * math.cos(angle), distance * math.sin(angle)
        # Two balls on one floor touch where the distance of their feet is 2 sqrt(r1 r2).
        if all(math.hypot(x - u, z - w) > 2.05 * math.sqrt(r * s) for u, w, s in placed):
            placed.append((x, z, r))
            yield (x, r, z), r
        if len(placed) == count:
            return


def _six_balls(rng: random.Random, _: Path) -> Iterator[str]:
    yield _floor(0.15)
    for i, (centre, radius) in enumerate(_standing(rng, 6, 2.6, (0.5, 1.1))):
        yield _ball(i, centre, radius, _material(rng, 0.5 if i % 2 else 0.0))


def _two_hundred_balls(rng: random.Random, _: Path) -> Iterator[str]:
    yield _floor()
    for i, (centre, radius) in enumerate(_standing(rng, 200, 5.5, (0.12, 0.5))):
        yield _ball(i, centre, radius, _material(rng, 0.5 if i % 2 else 0.0))


def _one_ball(rng: random.Random, _: Path) -> Iterator[str]:
    yield _ball(0, (0.0, 1.0, 0.0), rng.uniform(1.2, 2.0), _material(rng, 0.0))


def _thousand_polygons(rng: random.Random, _: Path) -> Iterator[str]:
    for i in range(1000):
        place = (rng.uniform(-3.5, 3.5), rng.uniform(0, 4), rng.uniform(-3.5, 3.5))
        axis, turned = _unit(rng), rng.uniform(0, 360)
        to_world = (
            f'<transform name="to_world"><scale value="{rng.uniform(0.08, 0.35):.4g}"/>'
            f'<rotate x="{axis[0]:.9g}" y="{axis[1]:.9g}" z="{axis[2]:.9g}" angle="{turned:.4g}"/>'
            f'<translate x="{place[0]:.4g}" y="{place[1]:.4g}" z="{place[2]:.4g}"/></transform>'
        )
        bsdf = f'<bsdf type="twosided">{_material(rng, 0.4 if i % 4 == 0 else 0.0)}</bsdf>'
        if i % 2:
            yield f'<shape type="rectangle" id="rectangle_{i}">{to_world}{bsdf}</shape>'
        else:
            corners = rng.randint(3, 6)
            star = [(math.cos(math.pi * k / corners), math.sin(math.pi * k / corners)) for k in range(2 * corners)]
            ring = " ".join(f"{(1, 0.5)[k % 2] * x:.6g},{(1, 0.5)[k % 2] * y:.6g},0" for k, (x, y) in enumerate(star))
            yield (
                f'<shape type="polygon" id="polygon_{i}"><string name="vertices" value="{ring}"/>'
                f"{to_world}{bsdf}</shape>"
            )


def _unit(rng: random.Random) -> Vector:
    """Draw a unit vector, evenly over the sphere."""
    z, angle = rng.uniform(-1, 1), rng.uniform(0, 2 * math.pi)
    across = math.sqrt(1 - z * z)
    return across * math.cos(angle), across * math.sin(angle), z


def _knot(around: int, along: int) -> Callable[[random.Random, Path], Iterator[str]]:
    """Make a wavy tube about a torus knot, 2 `around` `along` triangles, on a mirroring floor."""

    def shapes(rng: random.Random, stem: Path) -> Iterator[str]:
        yield _floor(0.3)
        file = stem.with_suffix(".ply")
        _write_tube(file, rng, around, along)
        yield (
            f'<shape type="ply" id="knot"><string name="filename" value="{file.name}"/>{_material(rng, 0.0)}</shape>'
        )

    return shapes


def _write_tube(file: Path, rng: random.Random, around: int, along: int) -> None:
    p, q = rng.choice(((2, 3), (3, 2), (2, 5), (3, 4)))
    waves, depth, phase = rng.randint(8, 20), rng.uniform(0.05, 0.2), rng.uniform(0, 2 * math.pi)

    def centre(t: float) -> Vector:
        out = 1.4 + 0.6 * math.cos(q * t)
        return out * math.cos(p * t), 1.15 + 0.6 * math.sin(q * t), out * math.sin(p * t)

    with file.open("wb") as ply:
        ply.write(
            (
                f"ply\nformat binary_little_endian 1.0\nelement vertex {around * along}\n"
                "property float x\nproperty float y\nproperty float z\n"
                f"element face {2 * around * along}\nproperty list uchar int vertex_index\nend_header\n"
            ).encode()
        )
        for j in range(along):
            t = 2 * math.pi * j / along
            c, ahead, behind = centre(t), centre(t + 1e-4), centre(t - 1e-4)
            forward = _normalised((ahead[0] - behind[0], ahead[1] - behind[1], ahead[2] - behind[2]))
            # The vector from the axis of the torus is never along a knot that winds about it.
            side = _normalised(_cross(forward, (c[0], 0.3 * (c[1] - 1.15), c[2])))
            up = _cross(side, forward)
            for i in range(around):
                s = 2 * math.pi * i / around
                r = 0.3 * (1 + depth * math.sin(waves * t + 3 * s + phase))
                a, b = r * math.cos(s), r * math.sin(s)
                ply.write(struct.pack("<3f", *(c[k] + a * side[k] + b * up[k] for k in range(3))))
        for j in range(along):
            for i in range(around):
                v00, v01 = j * around + i, j * around + (i + 1) % around
                v10, v11 = (j + 1) % along * around + i, (j + 1) % along * around + (i + 1) % around
                ply.write(struct.pack("<B3iB3i", 3, v00, v10, v01, 3, v01, v10, v11))


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _normalised(v: Vector) -> Vector:
    length = math.hypot(*v)
    return v[0] / length, v[1] / length, v[2] / length


_CLOSE: tuple[Vector, Vector] = ((0, 4, -8), (0, 0.6, 0))

KINDS = {
    "a": Kind("six balls on a floor, three of them mirrors", 2, _CLOSE, _six_balls),
    "b": Kind("200 balls on a floor, every other one a mirror", 2, ((0, 7, -10), (0, 0, 0)), _two_hundred_balls),
    "c": Kind("a mesh of 101,760 triangles on a mirroring floor", 2, _CLOSE, _knot(106, 480)),
    "d": Kind("one ball, no mirror", 2, _CLOSE, _one_ball),
    "e": Kind("1000 polygons and rectangles", 2, ((0, 4, -9), (0, 2, 0)), _thousand_polygons),
    "f": Kind("a mesh of 1,000,000 triangles on a mirroring floor", 2, _CLOSE, _knot(250, 2000)),
    "g": Kind("six balls on a floor, under 16 lights", 16, _CLOSE, _six_balls),
}
