"""What happened along the rays of one pixel, and what would have happened if.

`Recorder` is the tracer itself, listening at its own decisions: no second tracer. Each yes/no decision
has a name (`Key`) and a margin; the tracer can be run again with chosen decisions turned round, which
gives the colour of exactly that other picture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

from whitted_reference import scene
from whitted_reference.arithmetic import FLOAT
from whitted_reference.lights import Light
from whitted_reference.margins import passing
from whitted_reference.materials import Material, Terms
from whitted_reference.shapes import Primitive
from whitted_reference.textures import beyond_nearest_edge
from whitted_reference.trace import LEAST_SHARE, Tracer
from whitted_reference.vectors import BLACK, WHITE, Colour, Vec, negated


class Key(NamedTuple):
    """The name of a decision.

    Attributes
    ----------
    k : the bounce at which it is taken
    what : `seen` (the ray meets the primitive), `nearer` (it meets it before the others), `blocks` (the
        shadow ray meets it), `side` (it is seen from behind), `facing`, `horizon` or `mirror` (signs of
        cosines), `texture` (which side of a jump of colour), `end` (the mirror passes on too little)
    light : id of the light, or empty
    primitive : its index in the scene, or -1
    wall : 0 for the outline of the primitive, 1 or 2 for the first or second place where the line meets it
    """

    k: int
    what: str
    light: str
    primitive: int
    wall: int = 0


@dataclass(frozen=True)
class Decision:
    """One yes/no decision.

    Attributes
    ----------
    kind : for people: `silhouette`, `triangle edge`, `tie`, `horizon`...
    shape : id of the shape that decides, or empty
    margin : distance in world units by which a ray passes an outline or meets one thing before another,
        or the cosine that is compared with 0, or the distance in uv to a jump of a texture, or the share of
        the mirror above the least one, relative to that
    """

    key: Key
    kind: str
    shape: str
    answer: bool
    margin: float


@dataclass
class LightNode:
    """One light at one hit; everything after `horizon` only where that is passed."""

    id: str
    l: Vec  # noqa: E741
    n_l: float
    n_g_l: float
    above: bool
    blocked_by: str | None = None
    distance: float = math.inf
    irradiance: Colour = BLACK
    n_h: float | None = None
    colour: Colour = BLACK


@dataclass
class RayNode:
    """One ray: what it meets, and what comes back along it."""

    k: int
    e: Vec
    d: Vec
    shape: str | None = None
    primitive: int = -1
    t: float = math.inf
    p: Vec | None = None
    n: Vec | None = None
    n_g: Vec | None = None
    uv: tuple[float, float] | None = None
    front: bool = True
    forced: float = 0.0  # distance by which the ray misses what it is made to meet by a turned decision
    n_v: float = 0.0
    n_g_v: float = 0.0
    terms: Terms | None = None
    lights: list[LightNode] = field(default_factory=list)
    mirror: RayNode | None = None
    colour: Colour = BLACK


@dataclass(frozen=True)
class Tree:
    """A traced sample: its rays, its decisions and its colour."""

    root: RayNode
    decisions: tuple[Decision, ...]
    colour: Colour


class Recorder(Tracer):
    """A tracer in floats that writes down what it decides, and can be told to decide otherwise.

    Parameters
    ----------
    description, sensor : as for `Tracer`
    reach : decisions about meeting a primitive are written down where the margin is at most this, in
        world units
    """

    def __init__(self, description: scene.Scene, sensor: int = 0, reach: float = math.inf) -> None:
        super().__init__(description, FLOAT, sensor)
        self.reach = reach
        self.flips: frozenset[Key] = frozenset()
        self._decisions: dict[Key, Decision] = {}
        self._stack: list[RayNode] = []

    def record(
        self, x: int, y: int, i: int = 0, j: int = 0, grid: int = 1, flips: frozenset[Key] = frozenset()
    ) -> Tree:
        """Trace sample (i, j) of pixel (x, y), with the decisions in `flips` turned round."""
        return self.record_ray(*self.camera.ray(x, y, i, j, grid), flips)

    def record_ray(self, e: Vec, d: Vec, start: float, end: float, flips: frozenset[Key] = frozenset()) -> Tree:
        """Trace a ray of one's own."""
        self.flips, self._decisions, self._stack = flips, {}, []
        top = RayNode(-1, e, d)
        self._stack.append(top)
        colour = self.raycolor(e, d, start, end)
        assert top.mirror is not None
        return Tree(top.mirror, tuple(self._decisions.values()), colour)

    @property
    def node(self) -> RayNode:
        """The ray at work."""
        return self._stack[-1]

    # ------------------------------------------------------------------------- listening at the tracer
    def raycolor(
        self,
        e: Vec,
        d: Vec,
        start: float,
        end: float,
        k: int = 0,
        leaving: Primitive | None = None,
        share: Colour = WHITE,
    ) -> Colour:
        """Do as the tracer, and hang what happens under the ray that led here."""
        node = RayNode(k, e, d)
        self.node.mirror = node
        self._stack.append(node)
        node.colour = super().raycolor(e, d, start, end, k, leaving, share)
        self._stack.pop()
        return node.colour

    def first_hit(
        self, e: Vec, d: Vec, start: float, end: float, leaving: Primitive | None
    ) -> tuple[Primitive, float] | tuple[None, None]:
        """Do as the tracer, but with every meeting a decision of its own."""
        node = self.node
        met = self.meetings("seen", "", e, d, start, end, leaving)
        met.sort(key=lambda found: (found[0], found[1].index))
        if not met:
            return None, None
        chosen = 0
        for other, (t, primitive) in enumerate(met[1:], 1):
            gap = t - met[0][0]
            if gap > self.reach:
                break
            key = Key(node.k, "nearer", "", primitive.index)
            if self.decide(key, "tie", primitive.surface.id, False, gap):
                chosen = other
        t, primitive = met[chosen]
        node.forced = self._missed_by(Key(node.k, "seen", "", primitive.index))
        self.describe(node, primitive, t, e, d)
        return primitive, t

    def blocker(
        self,
        p: Vec,
        l: Vec,  # noqa: E741
        distance: float,
        leaving: Primitive,
        light: Light,
    ) -> Primitive | None:
        """Do as the tracer, but with every blocker a decision of its own."""
        away = leaving if self._exact else None
        met = self.meetings("blocks", light.id, p, l, self.start, distance, away)
        blocking = [primitive for t, primitive in met if t < distance]
        node = self.node.lights[-1]
        node.blocked_by = blocking[0].surface.id if blocking else None
        node.distance = distance
        return blocking[0] if blocking else None

    def behind(self, n_v: float) -> bool:
        """Do as the tracer, and turn the normals."""
        node = self.node
        key = Key(node.k, "side", "", node.primitive)
        if self.decide(key, "n.v = 0", node.shape or "", super().behind(n_v), n_v):
            assert node.n is not None
            assert node.n_g is not None
            node.front, node.n, node.n_g = False, negated(node.n), negated(node.n_g)
        return not node.front

    def positive(self, kind: str, x: float, y: float, light: Light | None = None) -> bool:
        """Do as the tracer, and write the smaller cosine down."""
        node = self.node
        key = Key(node.k, kind, light.id if light else "", node.primitive)
        if kind == "facing":
            node.n_v, node.n_g_v = x, y
            if self.primitives[node.primitive].surface.back is None:
                node.front = x >= 0
            elif key._replace(what="side") in self.flips:  # who sees the other side sees n turned to it
                x, y = abs(x), abs(y) if x == y else y
        answer = super().positive(kind, x, y, light)
        answer = self.decide(key, f"{kind} n.l = 0" if light else kind, node.shape or "", answer, min(x, y))
        if light is not None:
            assert node.p is not None
            arrival = light.arrive(*node.p)
            direction = arrival[:3] if arrival else (0.0, 0.0, 0.0)
            node.lights.append(LightNode(light.id, direction, x, y, answer))
        return answer

    def exhausted(self, share: Colour) -> bool:
        """Do as the tracer, and write down how far above the least share the greatest channel is."""
        node = self.node
        by = max(share) / LEAST_SHARE - 1.0
        key = Key(node.k, "end", "", node.primitive)
        return self.decide(key, "least share of a mirror", node.shape or "", super().exhausted(share), by)

    def textured(self, side: Material, uv: tuple[float, float]) -> Terms:
        """Do as the tracer, or beyond the nearest jump of a texture's colour."""
        node = self.node
        edge = beyond_nearest_edge(side.textures, *uv)
        if edge is not None:
            key = Key(node.k, "texture", "", node.primitive)
            if not self.decide(key, "texture edge", node.shape or "", True, edge[0]):
                uv = edge[1]
        return super().textured(side, uv)

    def reflected(self, terms: Terms, i: Colour, n: Vec, d: Vec, l: Vec, n_l: float) -> Colour:  # noqa: E741
        """Do as the tracer, and keep the result."""
        node = self.node
        node.terms = terms
        light = node.lights[-1]
        light.irradiance = i
        light.n_h = self.highlight(n, d, l, 1.0)
        light.colour = super().reflected(terms, i, n, d, l, n_l)
        return light.colour

    # -------------------------------------------------------------------------------------- decisions
    def decide(self, key: Key, kind: str, shape: str, answer: bool, by: float) -> bool:
        """Write a decision down; return its answer, turned round if that is asked for."""
        self._decisions[key] = Decision(key, kind, shape, answer, by)
        return answer != (key in self.flips)

    def meetings(
        self, what: str, light: str, e: Vec, d: Vec, start: float, end: float, leaving: Primitive | None
    ) -> list[tuple[float, Primitive]]:
        """Return all primitives that the ray meets in (start, end], after flips, with their first t."""
        met = []
        for primitive in self.primitives:
            key = Key(self.node.k, what, light, primitive.index)
            t = self._first_meeting(key, primitive, e, d, start, end, primitive is leaving)
            if t is not None:
                met.append((t, primitive))
        return met

    def _first_meeting(
        self, key: Key, primitive: Primitive, e: Vec, d: Vec, start: float, end: float, leaving: bool
    ) -> float | None:
        """Write down how nearly the ray meets a primitive, by its outline and at each place; return the first t."""
        near = passing(primitive, e, d)
        if near is None or (near.distance < -self.reach and not leaving):
            return (primitive.again if leaving else primitive.hit)(*e, *d, start, end)
        # A ray that leaves the primitive does so at one of the places, and has no outline to pass.
        left = min(near.places, key=lambda place: abs(place.t)) if leaving else None
        close = leaving or abs(near.distance) <= self.reach
        shape, inside = primitive.surface.id, math.copysign(1.0, near.distance) > 0.0
        found, doubtful = [], False
        for wall, place in enumerate(near.places, 1):
            if place is left:
                continue
            yes = math.copysign(1.0, place.distance) > 0.0 and start < place.t <= end
            by, kind = min(
                (place.distance, place.kind), (place.t - start, "contact"), (end - place.t, "end of the ray")
            )
            if abs(by) <= self.reach:
                doubtful = True
                yes = self.decide(key._replace(wall=wall), kind, shape, yes, by)
            if yes:
                found.append(min(max(place.t, 0.0), end))
        if close and not leaving and (found or doubtful):
            inside = self.decide(key, near.kind, shape, inside, near.distance)
        return found[0] if found and (inside or leaving) else None

    def _missed_by(self, key: Key) -> float:
        """Return how far outside the ray passes what turned decisions make it meet."""
        turned = (key._replace(wall=wall) for wall in range(3))
        decisions = [self._decisions[each] for each in turned if each in self.flips and each in self._decisions]
        return max((abs(decision.margin) for decision in decisions if not decision.answer), default=0.0)

    def describe(self, node: RayNode, primitive: Primitive, t: float, e: Vec, d: Vec) -> None:
        """Write down what stands where the ray meets a primitive."""
        p = (e[0] + t * d[0], e[1] + t * d[1], e[2] + t * d[2])
        node.shape, node.primitive, node.t, node.p = primitive.surface.id, primitive.index, t, p
        node.n, node.n_g = primitive.normals(e, d, t, p)
        surface = primitive.surface
        if surface.front.constant is None or (surface.back is not None and surface.back.constant is None):
            node.uv = primitive.uv(e, d, t, p)
