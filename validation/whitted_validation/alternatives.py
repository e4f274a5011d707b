"""What a pixel could look like if the yes/no decisions on its way fell otherwise within float32 rounding.

Nothing here knows a second picture: alternatives follow from the scene and the pixel alone.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from whitted_reference import scene
from whitted_reference.lights import Spot
from whitted_reference.materials import Material, Terms
from whitted_reference.ray_tree import Decision, Key, RayNode, Recorder, Tree
from whitted_reference.shapes import Cylinder, Disk, Primitive, Sphere
from whitted_reference.vectors import Vec, sub
from whitted_validation.beams import Beam
from whitted_validation.rounding import Bound, Ray, Rounding, Step, chain, side_of
from whitted_validation.roundoffs import U
from whitted_validation.textures import Slopes

# At most so many combinations of turned decisions are traced for a pixel, those of fewest decisions first.
MOST = 64
# A line that passes the box of a primitive at more than this, in sizes of the scene, does not meet it.
NEAR = 2.0**-10


@dataclass(frozen=True)
class Alternative:
    """One colour that the pixel may have, how far float32 may be from it, and the decisions turned round."""

    turned: tuple[Decision, ...]
    colour: tuple[float, float, float]
    bound: tuple[float, float, float]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Name what was turned, for people: kind, shape, light and bounce."""
        names = []
        for decision in self.turned:
            key = decision.key
            light = f", light `{key.light}`" if key.light else ""
            names.append(f"{decision.kind} of `{decision.shape}`{light}, bounce {key.k}")
        return tuple(names)

    def plus(self, other: Alternative, samples: int) -> Alternative:
        """Add one of so many samples of the same pixel to what others give."""
        colour = tuple(a + b / samples for a, b in zip(self.colour, other.colour, strict=True))
        # The film's sums round once each.
        bound = tuple(
            a + b / samples + (U * abs(c) if samples > 1 else 0.0)
            for a, b, c in zip(self.bound, other.bound, colour, strict=True)
        )
        return Alternative((*self.turned, *other.turned), _three(colour), _three(bound))


class Doubter(Recorder):
    """A recorder that can also turn decisions of textures and of spot lights."""

    def __init__(self, description: scene.Scene, sensor: int = 0) -> None:
        super().__init__(description, sensor)
        film = self.film
        self.camera_end = float(self.camera.ray(film.crop_width // 2, film.crop_height // 2)[3])
        # Far more than any bound that explains something: what a ray passes at a greater distance is not asked.
        boxes = np.array([p.box for p in self.primitives], float).reshape(-1, 6)
        size = boxes[:, 3:].max(axis=0) - boxes[:, :3].min(axis=0) if len(boxes) else np.zeros(3)
        self.reach = NEAR * float(size.max())
        self._low, self._high = boxes[:, :3] - self.reach, boxes[:, 3:] + self.reach
        self._everything = self.primitives
        self.moves: dict[Key, tuple[float, float]] = {}  # of uv, where a texture's step is turned
        self.cones: dict[Key, float] = {}  # the angle taken, where the end of a cone is turned
        for light in self.lights:
            if isinstance(light, Spot):
                light.share = self._share_of(light, light.share)  # type: ignore[method-assign]

    def meetings(
        self, what: str, light: str, e: Vec, d: Vec, start: float, end: float, leaving: Primitive | None
    ) -> list[tuple[float, Primitive]]:
        """Ask only primitives whose boxes the ray's line passes closely (Kay and Kajiya 1986)."""
        away = np.where(np.array(d, float) == 0.0, 1e-300, d)
        a, b = (self._low - e) / away, (self._high - e) / away
        passed = np.minimum(a, b).max(axis=1) <= np.maximum(a, b).min(axis=1)
        self.primitives = [self._everything[i] for i in np.flatnonzero(passed)]
        try:
            return super().meetings(what, light, e, d, start, end, leaving)
        finally:
            self.primitives = self._everything

    def textured(self, side: Material, uv: tuple[float, float]) -> Terms:
        """Evaluate for the ray at work, across a step if that is turned."""
        node = self.node
        for key in self.flips:
            if key.what.startswith("texture") and (key.k, key.primitive) == (node.k, node.primitive):
                uv = uv[0] + self.moves[key][0], uv[1] + self.moves[key][1]
        node.terms = side.at(*uv)
        return node.terms

    def _share_of(self, light: Spot, share: Any) -> Any:
        def moved(theta: float) -> Any:
            key = Key(self.node.k, "cone", light.id, self.node.primitive)
            return share(self.cones[key] if key in self.flips else theta)

        return moved


class Alternatives:
    """All that the pixels of one scene may look like.

    Parameters
    ----------
    description, sensor : as for `Recorder`
    """

    def __init__(self, description: scene.Scene, sensor: int = 0) -> None:
        self._doubter = Doubter(description, sensor)
        self._slopes = Slopes(description)
        self._rounding = Rounding(self._doubter, self._slopes)

    def of_pixel(self, x: int, y: int, grid: int = 1) -> tuple[list[Alternative], bool]:
        """Return what pixel (x, y) may look like, and whether that is all.

        Samples are turned one after the other; the first alternative is the reference's own colour.
        """
        found, complete = [Alternative((), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))], True
        for j in range(grid):
            for i in range(grid):
                one, whole = self._of_sample(x, y, i, j, grid)
                pairs = [before.plus(other, grid * grid) for other in one for before in found]
                complete = complete and whole and len(pairs) <= MOST
                found = pairs[:MOST]
        return found, complete

    def _of_sample(self, x: int, y: int, i: int, j: int, grid: int) -> tuple[list[Alternative], bool]:
        """Do so for sample (i, j)."""
        known: dict[frozenset[Key], tuple[Decision, ...]] = {frozenset(): ()}
        waiting = deque(known)
        found: list[Alternative] = []
        self._doubter.moves.clear()
        self._doubter.cones.clear()
        while waiting and len(found) < MOST:
            flips = waiting.popleft()
            tree = self._doubter.record(x, y, i, j, grid, flips)
            bound = self._rounding.bound(tree)
            found.append(Alternative(known[flips], _three(tree.colour), _three(bound.colour)))
            for decision in self._doubtful(tree, bound):
                more = flips | {decision.key}
                if decision.key not in flips and more not in known:
                    known[more] = (*known[flips], decision)
                    waiting.append(more)
        return found, not waiting

    # -------------------------------------------------------------------------------------------- doubts
    def _doubtful(self, tree: Tree, bound: Bound) -> Iterator[Decision]:
        """Yield the decisions of a tree that its errors may turn."""
        nodes = list(chain(tree.root))
        for decision in tree.decisions:
            k = decision.key.k
            if k < len(bound.steps) and self._may_turn(decision, nodes[k], bound.steps[k]):
                yield decision
        for node, step in zip(nodes, bound.steps, strict=False):
            if step.p is not None and np.isfinite(step.p).all():
                yield from self._texture_steps(node, step)
                yield from self._cones(node, step)

    def _may_turn(self, decision: Decision, node: RayNode, step: Step) -> bool:
        what, light = decision.key.what, decision.key.light
        if what in ("side", "facing"):
            return abs(decision.margin) <= step.facing
        if what == "mirror":
            return abs(decision.margin) <= step.mirror
        if what == "end":
            return abs(decision.margin) <= step.share
        arrival = step.lights.get(light)
        if what == "horizon":
            return arrival is None or abs(decision.margin) <= arrival.n_l
        primitive = self._doubter.primitives[decision.key.primitive]
        if what == "blocks":
            if arrival is None or step.p is None:
                return True
            l, distance = next((lit.l, lit.distance) for lit in node.lights if lit.id == light)  # noqa: E741
            assert node.p is not None
            beam = Beam(node.p, l, Ray(step.p, arrival.l, step.offset), self._doubter.start, distance, arrival.distance)
            blocked = next(lit.blocked_by for lit in node.lights if lit.id == light) is not None
            return blocked == decision.answer and beam.may_turn(primitive, decision.key.wall)
        first_ray = node.k == 0
        start, end = (0.0, self._doubter.camera_end) if first_ray else (self._doubter.start, math.inf)
        beam = Beam(node.e, node.d, step.ray, start, end, 0.0)
        if what == "seen":  # what lies behind the hit only counts once that is turned
            return beam.first_place(primitive) <= node.t and beam.may_turn(primitive, decision.key.wall)
        first = self._doubter.primitives[node.primitive]
        return decision.margin <= beam.along(primitive) + beam.along(first)

    def _texture_steps(self, node: RayNode, step: Step) -> Iterator[Decision]:
        """Move the coordinates by their errors, and yield what changes more than a slope allows."""
        surface = self._doubter.primitives[node.primitive].surface
        material = side_of(surface, node)
        if material.constant is not None or node.uv is None or node.terms is None:
            return
        here = node.terms
        seen = [here]
        for move in _moves(self._doubter.primitives[node.primitive], node.uv, step.uv):
            there = material.at(node.uv[0] + move[0], node.uv[1] + move[1])
            slopes = {
                name: self._slopes.error(surface.id, node.front, name, node.uv, step.uv) + U * (name == "exponent")
                for name in ("ambient", "diffuse", "specular", "mirror", "exponent")
            }
            if any(_within(there, other, slopes) for other in seen):
                continue
            seen.append(there)
            key = Key(node.k, f"texture {move[0]:+.1e} {move[1]:+.1e}", "", node.primitive)
            self._doubter.moves[key] = move
            yield Decision(key, "texture edge", surface.id, True, max(step.uv))

    def _cones(self, node: RayNode, step: Step) -> Iterator[Decision]:
        """Yield spot lights whose cone ends here, or nearly so."""
        assert node.p is not None
        for light in self._doubter.lights:
            if not isinstance(light, Spot):
                continue
            x, y, z = sub(light.position, node.p)
            distance = math.sqrt(x * x + y * y + z * z)
            if distance == 0.0:
                continue
            theta = light.angle(x / distance, y / distance, z / distance)
            assert step.p is not None
            off = self._rounding.cone_error(light, step.p, np.array([x, y, z]) / distance, distance)
            if abs(theta - light.cutoff) <= off:
                key = Key(node.k, "cone", light.id, node.primitive)
                inside = theta < light.cutoff or theta <= light.beam  # a cone without a ramp ends in a step
                self._doubter.cones[key] = light.cutoff + (off if inside else -off)
                yield Decision(key, "spot cone", node.shape or "", inside, light.cutoff - theta)


def _moves(primitive: Primitive, uv: tuple[float, float], off: tuple[float, float]) -> Iterator[tuple[float, float]]:
    """Yield how coordinates may be off, and over the seam of a turn."""
    inner = getattr(primitive, "primitive", primitive)
    for du in (-off[0], 0.0, off[0]):
        for dv in (-off[1], 0.0, off[1]):
            if isinstance(inner, Sphere | Cylinder):
                yield (du - math.floor(uv[0] + du), dv)
            elif isinstance(inner, Disk):
                yield (du, dv - math.floor(uv[1] + dv))
            else:
                yield (du, dv)


def _within(one: Terms, other: Terms, slopes: dict[str, float]) -> bool:
    """Tell whether two sets of coefficients differ by no more than slopes allow."""
    for name, slope in slopes.items():
        a, b = (np.zeros(3) if x is None else np.atleast_1d(x) for x in (getattr(one, name), getattr(other, name)))
        if (np.abs(a - b) > 2 * slope).any():
            return False
    return True


def _three(colour: Any) -> tuple[float, float, float]:
    red, green, blue = (float(c) for c in colour)
    return red, green, blue
