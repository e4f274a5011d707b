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
from whitted_reference.margins import margin
from whitted_reference.materials import Material, Terms
from whitted_reference.shapes import Primitive
from whitted_reference.textures import beyond_nearest_edge
from whitted_reference.trace import Tracer
from whitted_reference.vectors import BLACK, WHITE, Colour, Vec


class Key(NamedTuple):
    """The name of a decision.

    Attributes
    ----------
    k : the bounce at which it is taken
    what : `seen` (the ray meets the primitive), `nearer` (it meets it before the others), `blocks` (the
        shadow ray meets it), `facing`, `horizon` or `mirror` (signs of cosines), `texture` (which side of a
        jump of colour)
    light : id of the light, or empty
    primitive : its index in the scene, or -1
    """

    k: int
    what: str
    light: str
    primitive: int


@dataclass(frozen=True)
class Decision:
    """One yes/no decision.

    Attributes
    ----------
    kind : for people: `silhouette`, `triangle edge`, `tie`, `horizon`...
    shape : id of the shape that decides, or empty
    margin : distance in world units by which a ray passes an outline or meets one thing before another,
        or the cosine that is compared with 0, or the distance in uv to a jump of a texture
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
    forced: bool = False  # met only because its decision was turned round
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
        node.forced = Key(node.k, "seen", "", primitive.index) in self.flips
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

    def positive(self, kind: str, x: float, y: float, light: Light | None = None) -> bool:
        """Do as the tracer, and write the smaller cosine down."""
        node = self.node
        key = Key(node.k, kind, light.id if light else "", node.primitive)
        # A silhouette that the ray is made to meet is seen from the front and at a grazing angle.
        answer = super().positive(kind, x, y, light) or (node.forced and light is None)
        answer = self.decide(key, f"{kind} n.l = 0" if light else kind, node.shape or "", answer, min(x, y))
        if kind == "facing":
            node.n_v, node.n_g_v = x, y
            self._take_side(node)
        if light is not None:
            assert node.p is not None
            arrival = light.arrive(*node.p)
            direction = arrival[:3] if arrival else (0.0, 0.0, 0.0)
            node.lights.append(LightNode(light.id, direction, x, y, answer))
        return answer

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
        """Return all primitives that the ray meets in (start, end], after flips, with their t."""
        node = self.node
        met = []
        for primitive in self.primitives:
            ask = primitive.again if primitive is leaving else primitive.hit
            t = ask(*e, *d, start, end)
            if primitive is not leaving:
                t = self._decide_meeting(Key(node.k, what, light, primitive.index), primitive, e, d, t, start, end)
            if t is not None:
                met.append((t, primitive))
        return met

    def _decide_meeting(
        self, key: Key, primitive: Primitive, e: Vec, d: Vec, t: float | None, start: float, end: float
    ) -> float | None:
        """Write down how nearly the ray meets a primitive; return t after flips."""
        near = margin(primitive, e, d)
        if near is None:
            return t
        kind, by, other_t = near.kind, near.distance, near.t
        # A ray that would meet it beyond its own ends misses by that much.
        for gap, name in ((other_t - start, "contact"), (end - other_t, "end of the ray")):
            if abs(gap) < abs(by):
                kind, by = name, math.copysign(gap, 1.0 if t is not None else -1.0)
        if abs(by) > self.reach or (t is None and not start - self.reach < other_t < end + self.reach):
            return t
        yes = self.decide(key, kind, primitive.surface.id, t is not None, by)
        if not yes:
            return None
        return t if t is not None else min(max(other_t, 0.0), end)

    def describe(self, node: RayNode, primitive: Primitive, t: float, e: Vec, d: Vec) -> None:
        """Write down what stands where the ray meets a primitive."""
        p = (e[0] + t * d[0], e[1] + t * d[1], e[2] + t * d[2])
        node.shape, node.primitive, node.t, node.p = primitive.surface.id, primitive.index, t, p
        node.n, node.n_g = primitive.normals(e, d, t, p)
        surface = primitive.surface
        if surface.front.constant is None or (surface.back is not None and surface.back.constant is None):
            node.uv = primitive.uv(e, d, t, p)

    def _take_side(self, node: RayNode) -> None:
        """Turn the normals as the tracer did, for a two-sided surface seen from behind."""
        n, n_g = node.n, node.n_g
        assert n is not None
        assert n_g is not None
        node.front = -(n[0] * node.d[0] + n[1] * node.d[1] + n[2] * node.d[2]) >= 0
        if not node.front and self.primitives[node.primitive].surface.back is not None:
            node.n, node.n_g = (-n[0], -n[1], -n[2]), (-n_g[0], -n_g[1], -n_g[2])
