"""How far a tracer that rounds as `roundoffs` says may be from the exact colour of a pixel, where it decides alike.

The reference's rays are followed once more, and with each ray goes what rounding may have made of it: origin
and direction as linear forms in error symbols, each between -1 and 1, one for every rounding that counts
(first-order affine arithmetic: Comba and Stolfi 1993). Symbols keep their signs from bounce to bounce, so
that what one mirror spreads another may focus again. The largest value of a form is the sum of the sizes of
its coefficients. Where the first order does not suffice (grazing rays, highlights) the exact change of one
variable takes its place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from whitted_reference.instances import Placed
from whitted_reference.lights import Light, Point, Spot
from whitted_reference.materials import Material, Terms
from whitted_reference.ray_tree import Key, LightNode, RayNode, Recorder, Tree
from whitted_reference.shapes import Primitive, Surface
from whitted_validation.forms import Matrix, length, radius
from whitted_validation.patch import Patch, matrices, patch_of
from whitted_validation.roundoffs import (
    ARC_TANGENT,
    CAMERA_DIRECTION,
    CAMERA_ORIGIN,
    CONE_PLACE,
    COSINE,
    IRRADIANCE,
    LOGARITHM,
    OFFSET,
    PLACED,
    POWER,
    REFLECTED,
    TERM,
    TO_LIGHT,
    UNIT_VECTOR,
    U,
    V,
)
from whitted_validation.textures import Slopes

_EYE = np.eye(3)


@dataclass
class Ray:
    """What is known of one ray: `e` and `d` are forms (3, symbols); `offset` in world units."""

    e: Matrix
    d: Matrix
    offset: float


@dataclass
class Arrival:
    """One light at one hit: errors of l, of both cosines, and of the distance."""

    l: Matrix  # noqa: E741
    n_l: float
    distance: float


@dataclass
class Step:
    """Errors of one ray and of what happens at its end.

    Attributes
    ----------
    ray : the ray that arrives
    p : error form of the hit, or None where nothing is hit
    facing, mirror : largest errors of the cosines that are compared with 0
    share : largest relative error of the product of all k_m, its own included
    offset : how far from its surface a ray that leaves the hit may start
    uv : largest errors of the surface coordinates
    """

    ray: Ray
    p: Matrix | None = None
    facing: float = 0.0
    mirror: float = 0.0
    share: float = 0.0
    offset: float = 0.0
    uv: tuple[float, float] = (0.0, 0.0)
    lights: dict[str, Arrival] = field(default_factory=dict)


class Bound(NamedTuple):
    """Largest error of each channel, and the steps of the path that led to it."""

    colour: NDArray[np.float64]
    steps: list[Step]


class Follower(Recorder):
    """A tracer that keeps the tree of rays but asks no more primitives than it must; it has no decisions."""

    def first_hit(self, e, d, start, end, leaving):  # type: ignore[no-untyped-def]  # as in Tracer
        """Do as the plain tracer, and describe what is met."""
        primitive, t = super(Recorder, self).first_hit(e, d, start, end, leaving)
        if primitive is not None:
            assert t is not None
            self.describe(self.node, primitive, t, e, d)
        return primitive, t

    def blocker(self, p, l, distance, leaving, light):  # type: ignore[no-untyped-def]  # noqa: E741
        """Do as the plain tracer, and keep who blocks."""
        primitive = super(Recorder, self).blocker(p, l, distance, leaving, light)
        node = self.node.lights[-1]
        node.blocked_by = primitive.surface.id if primitive else None
        return primitive

    def textured(self, side: Material, uv: tuple[float, float]) -> Terms:
        """Do as the plain tracer, and keep the coefficients."""
        terms = super(Recorder, self).textured(side, uv)
        self.node.terms = terms
        return terms

    def decide(self, key: Key, kind: str, shape: str, answer: bool, by: float) -> bool:
        """Leave decisions as they are, and unwritten."""
        return answer


class Rounding:
    """The rounding model for one scene and sensor.

    Parameters
    ----------
    tracer : whose trees are to be judged
    """

    def __init__(self, tracer: Recorder, slopes: Slopes) -> None:
        self._primitives = tracer.primitives
        self._lights = {light.id: light for light in tracer.lights}
        self._ambient = np.array(tracer.ambient, float)
        self._slopes = slopes
        eye = np.array(tracer.camera.eye, float)
        self._eye = eye
        self._perspective = tracer.camera.perspective
        self._reach = _reach_of_shapes(tracer.primitives)

    # --------------------------------------------------------------------------------------------- path
    def bound(self, tree: Tree) -> Bound:
        """Bound the error of a traced sample."""
        node: RayNode | None = tree.root
        assert node is not None
        ray = self._camera_ray(node)
        steps: list[Step] = []
        total = np.zeros(3)
        share, share_error = np.ones(3), np.zeros(3)
        sums = 0
        while node is not None:
            if node.primitive < 0:  # the background is a constant
                total += share_error * node.colour
                steps.append(Step(ray))
                break
            step, own_error, terms, ray = self._step(node, ray)
            steps.append(step)
            below = np.array(node.mirror.colour, float) if node.mirror else np.zeros(3)
            k_m, k_m_error = np.zeros(3), np.zeros(3)
            if terms is not None and terms.mirror is not None:
                k_m = np.array(terms.mirror, float)
                k_m_error = U * k_m + self._texture(node, "mirror", step.uv)
            own = np.abs(np.array(node.colour, float) - k_m * below)
            total += share * own_error + share_error * (own + own_error)
            share_error = share_error * (k_m + k_m_error) + share * (k_m_error + U * k_m)
            share = share * k_m
            if share.any():
                step.share = float(share_error.max() / share.max())
            sums += 3 + len(node.lights)
            if ray is None or not np.isfinite(total).all():
                break
            node = node.mirror
        # Every sum on the way rounds once, and none is greater than the whole.
        total += (sums + 1) * U * np.abs(np.array(tree.colour, float))
        return Bound(total, steps)

    def _surface(self, node: RayNode) -> Any:
        return self._primitives[node.primitive].surface

    def _texture(self, node: RayNode, term: str, off: tuple[float, float]) -> float:
        if node.uv is None:
            return 0.0
        return self._slopes.error(self._surface(node).id, node.front, term, node.uv, off)

    def _camera_ray(self, node: RayNode) -> Ray:
        direction = CAMERA_DIRECTION * _EYE
        e = np.array(node.e, float)
        if self._perspective:  # all rays pass exactly through the eye
            return Ray(float(np.linalg.norm(e - self._eye)) * direction, direction, 0.0)
        origin = CAMERA_ORIGIN * np.diag(np.abs(self._eye) + np.abs(e - self._eye))
        return Ray(np.hstack([origin, 0 * _EYE]), np.hstack([0 * _EYE, V * _EYE]), 0.0)

    def _step(self, node: RayNode, ray: Ray) -> tuple[Step, NDArray[np.float64], Terms | None, Any]:
        """Follow one ray to its hit and shade it: errors there, error of the own colour, and the next ray."""
        primitive = self._primitives[node.primitive]
        d = np.array(node.d, float)
        n, n_g = np.array(node.n, float), np.array(node.n_g, float)
        patch = patch_of(primitive, node)
        if isinstance(primitive, Placed):
            ray = _through_matrix(primitive, node, ray)
        hit = self._hit(node, ray, patch, n_g)
        offset = OFFSET * patch.plane_reach(self._reach.get(self._surface(node).id))
        step = Step(ray, hit, offset=offset)
        if not np.isfinite(hit).all():
            return step, np.full(3, math.inf), None, None
        normal = np.hstack([patch.turn_of_normal(hit), patch.normal_roundings * _EYE])
        hit = np.hstack([hit, np.zeros((3, 3))])
        arriving = np.hstack([ray.d, np.zeros((3, hit.shape[1] - ray.d.shape[1]))])
        slope = float(radius(n @ arriving + d @ normal)) + 3 * V
        flat_slope = float(radius(n_g @ arriving)) + 4 * V + (0.0 if patch.flat else length(normal))
        step.facing = max(slope, flat_slope)
        side = side_of(self._surface(node), node)
        uv = (0.0, 0.0)
        terms = side.constant
        if terms is None:
            assert node.uv is not None
            uv = step.uv = patch.uv_error(hit)
            terms = node.terms or side.at(*node.uv)
        if not any(node.colour) and node.mirror is None and not node.lights:  # black
            return step, np.zeros(3), terms, None
        error = self._shade(node, step, terms, hit, normal, arriving, uv)
        # The reflected ray: r = d - 2 (d.n) n.
        cosine = float(d @ n)
        change = n @ arriving + d @ normal
        r = arriving - 2 * (np.outer(n, change) + cosine * normal)
        r = np.hstack([r, REFLECTED * _EYE])
        e = np.hstack([hit, np.zeros((3, 3))])
        r_n_g = n_g @ r
        step.mirror = max(slope, float(radius(r_n_g)) + 4 * V + (0.0 if patch.flat else length(normal)))
        return step, error, terms, Ray(e, r, offset)

    def _hit(self, node: RayNode, ray: Ray, patch: Patch, n_g: Matrix) -> Matrix:
        """Return the error form of the hit point."""
        d = np.array(node.d, float)
        moved = ray.e + node.t * ray.d
        away = n_g @ moved  # of the line from the surface, along its normal
        cosine = float(d @ n_g)
        c = abs(cosine) - float(radius(n_g @ ray.d)) * (patch.curvature == 0.0)
        own = patch.distance_roundings(node.t)
        # What a turned decision makes it meet, the ray misses by `forced`, at the place taken by up to twice that.
        distance = float(radius(away)) + own + 2.0 * node.forced
        along = d - cosine * n_g
        if patch.curvature == 0.0:
            if c <= 0.0:
                return np.full((3, 1), math.inf)
            amplified = abs(cosine) / c
            moved = moved - np.outer(d, away) * (amplified / cosine)
            extra = along * (own / c)
        else:
            # c s - curvature s^2 / 2 = distance: how far s the meeting may move along the ray.
            x = 2.0 * patch.curvature * distance / (c * c) if c > 0.0 else math.inf
            if x <= 1.0:
                amplified = 2.0 * (1.0 - math.sqrt(1.0 - x)) / x if x > 1e-8 else 1.0
                moved = moved - np.outer(d, away) * (amplified / cosine)
                extra = along * (own * amplified / c)
            else:
                most = (c + math.sqrt(c * c + 2.0 * patch.curvature * distance)) / patch.curvature
                moved = moved - np.outer(n_g, away)
                extra = along * most
        return np.hstack([moved, extra[:, None], np.diag(patch.point_roundings)])

    # -------------------------------------------------------------------------------------------- shading
    def _shade(
        self,
        node: RayNode,
        step: Step,
        terms: Terms,
        hit: Matrix,
        normal: Matrix,
        arriving: Matrix,
        uv: tuple[float, float],
    ) -> NDArray[np.float64]:
        """Bound the error of emission, ambient light and all lights at one hit."""
        surface = self._surface(node)
        error = 3 * U * self._ambient * (1.0 if terms.ambient is None else np.array(terms.ambient, float))
        if terms.ambient is not None:
            error = error + self._ambient * self._texture(node, "ambient", uv)
        if surface.emission is not None and node.front:
            error = error + U * np.array(surface.emission, float)
        n, d = np.array(node.n, float), np.array(node.d, float)
        n_g = np.array(node.n_g, float)
        for light in node.lights:
            source = self._lights[light.id]
            l = np.array(light.l, float)  # noqa: E741
            to_light, relative, distance = self._arrival(source, node, light, hit, l)
            tilt = float(radius(n @ to_light + l @ normal)) + COSINE * float(np.abs(n) @ np.abs(l))
            flat_tilt = float(radius(n_g @ to_light)) + COSINE * float(np.abs(n_g) @ np.abs(l))
            flat_tilt += 0.0 if n_g is n else length(normal)
            step.lights[light.id] = Arrival(to_light, max(tilt, flat_tilt), distance)
            if light.n_h is None:
                continue
            irradiance = np.array(light.irradiance, float)
            k_d = np.array(terms.diffuse, float)
            part = k_d * tilt + self._texture(node, "diffuse", uv) * (abs(light.n_l) + tilt)
            if terms.specular is not None:
                part = part + self._highlight(node, light, terms, n, d, l, normal, to_light, arriving, uv)
            error = error + irradiance * part * (1 + relative) + (relative + TERM) * np.abs(np.array(light.colour))
        return np.asarray(error, float)

    def _arrival(
        self,
        source: Light,
        node: RayNode,
        light: LightNode,
        hit: Matrix,
        l: Matrix,  # noqa: E741
    ) -> tuple[Matrix, float, float]:
        """Return the error form of l, the relative error of the irradiance, and that of the distance."""
        if not isinstance(source, Point):
            return np.hstack([np.zeros(hit.shape)]), U, 0.0
        found = Point.arrive(source, *node.p)  # type: ignore[misc]  # whatever its cone says of the place
        if found is None or not found[3] > 0.0:
            return np.zeros(hit.shape), 0.0, length(hit)
        distance = float(found[3])
        towards = l @ hit
        form = (np.outer(l, towards) - hit) / distance
        reach = float(radius(towards))
        relative = IRRADIANCE
        if source.falloff:
            relative += 2.0 * reach / max(distance - reach, 1e-300)
        share = max(light.irradiance) / max(max(found[4]), 1e-300)
        if isinstance(source, Spot) and source.cutoff > source.beam and share > 0.0:
            theta = source.angle(*l)
            off = self.cone_error(source, hit, l, distance)
            if theta + off > source.beam:
                relative += off / ((source.cutoff - source.beam) * share) + 2 * U  # f is rounded, and its product
        return form, relative, reach + 4 * U * distance

    def cone_error(self, source: Spot, hit: Matrix, l: Matrix, distance: float) -> float:  # noqa: E741
        """Bound the error of the angle in a spot light's cone, for a point with that error form."""
        local = np.array(source.to_local, float)
        stretch = float(np.linalg.norm(local, 2))
        least = float(np.linalg.norm(local @ l))
        off = (np.outer(l, l @ hit) - hit) / distance
        theta = float(source.angle(*l))
        return stretch * (length(off) + CONE_PLACE) / least + ARC_TANGENT * theta + V * float(source.cutoff)

    def _highlight(
        self,
        node: RayNode,
        light: LightNode,
        terms: Terms,
        n: Matrix,
        d: Matrix,
        l: Matrix,  # noqa: E741
        normal: Matrix,
        to_light: Matrix,
        arriving: Matrix,
        uv: tuple[float, float],
    ) -> NDArray[np.float64]:
        """Bound the error of k_s (n.h)^p by the angle between n and h, turned either way."""
        half = l - d
        size = float(np.linalg.norm(half))
        change = to_light - arriving
        off = (length(change) + TO_LIGHT + U) / size if size > 0.0 else math.inf
        if off < 0.5:
            h = half / size
            turned = (change - np.outer(h, h @ change)) / size - normal
            angle = (length(turned) + (TO_LIGHT + U) / size) / (1.0 - off) + 2 * UNIT_VECTOR
        else:
            h, angle = n, math.pi
        sine, cosine = float(np.linalg.norm(np.cross(n, h))), float(n @ h)
        alpha = math.atan2(sine, cosine)
        exponent = float(terms.exponent)
        k_s = np.array(terms.specular, float)
        value = _lobe(alpha, exponent)
        most, least = _lobe(max(alpha - angle, 0.0), exponent), _lobe(alpha + angle, exponent)
        swing = max(most - value, value - least)
        logarithm = -math.log(value) if value > 0.0 else 0.0
        swing += value * (POWER + LOGARITHM * logarithm)
        off_p = self._texture(node, "exponent", uv)
        if off_p > 0.0:
            swing += value * min(1.0, off_p / max(exponent, 1e-300) * (logarithm + 1.0))
        return k_s * swing + self._texture(node, "specular", uv) * (value + swing)


def _lobe(angle: float, exponent: float) -> float:
    cosine = math.cos(angle) if angle < math.pi / 2 else 0.0
    return cosine**exponent if cosine > 0.0 else 0.0


def _through_matrix(primitive: Placed, node: RayNode, ray: Ray) -> Ray:
    """Add what it costs to bring a ray into an instance's own space, seen from outside."""
    shift, inverse = matrices(primitive)
    matrix = np.linalg.inv(inverse)
    # |M^-1| |e| and the rounded translation of the inverse, brought back by |M|.
    inside = np.abs(inverse) @ (np.abs(np.array(node.e, float)) + np.abs(shift))
    e = PLACED * np.abs(matrix) * inside
    d = PLACED * np.abs(matrix) * (np.abs(inverse) @ np.abs(np.array(node.d, float)))
    symbols = ray.e.shape[1]
    return Ray(
        np.hstack([ray.e, e, np.zeros((3, 3))]),
        np.hstack([ray.d, np.zeros((3, 3)), d])[:, : symbols + 6],
        ray.offset,
    )


def _reach_of_shapes(primitives: Sequence[Primitive]) -> dict[str, Matrix]:
    """Return the greatest coordinates of each shape in its own space, where there are instances."""
    reach: dict[str, Matrix] = {}
    if any(isinstance(primitive, Placed) for primitive in primitives):
        for primitive in primitives:
            box = np.abs((primitive.primitive if isinstance(primitive, Placed) else primitive).box).reshape(2, 3)
            shape = primitive.surface.id
            reach[shape] = np.maximum(reach.get(shape, 0.0), box.max(axis=0))
    return reach


def side_of(surface: Surface, node: RayNode) -> Material:
    """Return the material that a ray meets."""
    return surface.front if node.front or surface.back is None else surface.back


def chain(root: RayNode) -> Iterator[RayNode]:
    """Yield the rays of a tree in order."""
    node: RayNode | None = root
    while node is not None:
        yield node
        node = node.mirror
