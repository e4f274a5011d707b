"""What Mitsuba loaded: its objects, their parameters and children, and whether anything was edited since."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_whitted.errors import SceneError


@dataclass
class Node:
    """One object of the scene graph, as its own ``traverse()`` describes it."""

    values: dict[str, tuple[Any, Any]] = field(default_factory=dict)
    """Name of each parameter: where its value is kept, and the type it has there."""
    children: dict[str, mi.Object] = field(default_factory=dict)


class SceneGraph:
    """Shapes, shape groups and emitters of a scene and everything below them; sensors are left out.

    A kept graph answers at once what ``mi.traverse`` would have to walk for again. It holds the scene's
    objects but not the scene, which holds its integrator, which may hold this graph.
    """

    def __init__(self, scene: mi.Scene) -> None:
        self.shapes: list[mi.Shape] = scene.shapes()
        self.emitters: list[mi.Emitter] = scene.emitters()
        self.environment: mi.Emitter | None = scene.environment()
        self.nodes: dict[mi.Object, Node] = {}

        top = _children(scene)
        self.groups: list[mi.Shape] = [
            child for child in top if isinstance(child, mi.Shape) and child.class_name() == "ShapeGroupPlugin"
        ]
        for root in [*self.shapes, *self.groups, *self.emitters]:
            self._walk(root)

        self.members = {
            group: [child for child in self.nodes[group].children.values() if isinstance(child, mi.Shape)]
            for group in self.groups
        }
        """The shapes of each group, in the order in which Mitsuba numbers them."""
        self.instances = [shape for shape in self.shapes if shape.class_name() == "Instance"]
        # Flat shapes last: where those are left to the kernel, Embree's numbers of the others stay ours.
        self.plain = sorted(
            (shape for shape in self.shapes if shape.class_name() != "Instance"),
            key=lambda shape: shape.class_name() in ("Rectangle", "Disk"),
        )
        self.group_of = self._groups_of_instances()
        placed = [group for group in self.groups if group in self.group_of.values()]
        self.all_shapes = self.plain + [member for group in placed for member in self.members[group]]
        """Every shape that a ray can meet: a group that no instance places is not drawn."""
        self.bsdfs = [shape.bsdf() for shape in self.all_shapes]

        self.kept: dict[Any, Any] = {}
        """What others have made of these objects, and may use again."""
        self._shape_values = self._values_of(lambda owner: isinstance(owner, mi.Shape))
        self._other_values = self._values_of(lambda owner: not isinstance(owner, mi.Shape))

    def describes(self, scene: mi.Scene) -> bool:
        """Whether `scene` still has the objects of this graph; cheap, 0.1 ms for 200 shapes."""
        return (
            self.shapes == scene.shapes()
            and self.emitters == scene.emitters()
            and self.bsdfs == [shape.bsdf() for shape in self.all_shapes]
        )

    def value(self, owner: mi.Object, name: str) -> Any:
        """Read parameter `name` of `owner` as it is now."""
        return read(*self.nodes[owner].values[name], owner)

    def child(self, owner: mi.Object, name: str) -> Any:
        """Child `name` of `owner`, or None."""
        return self.nodes[owner].children.get(name)

    def geometry_stamp(self) -> Stamp:
        """Note the present values of all shapes' own parameters."""
        return Stamp(self._shape_values)

    def appearance_stamp(self) -> Stamp:
        """Note the present values of all materials, textures and emitters."""
        return Stamp(self._other_values)

    def stamp(self, owners: Iterable[mi.Object]) -> Stamp:
        """Note the present values of some objects."""
        chosen = set(owners)
        return Stamp(self._values_of(lambda owner: owner in chosen))

    def _groups_of_instances(self) -> dict[mi.Object, Any]:
        """Find the group of each instance, which Mitsuba does not tell: by whom the group's first shape is met."""
        if len(self.groups) < 2:
            return dict.fromkeys(self.instances, *self.groups)
        if searched_by_optix():
            raise SceneError(
                f"{len(self.groups)} shape groups: {mi.variant()} does not tell which of them an instance places; "
                "use one, or a variant that begins with llvm"
            )
        group_of = {member: group for group in self.groups for member in self.members[group]}
        empty = next((group for group in self.groups if not self.members[group]), None)
        pi: Any = dr.zeros(mi.PreliminaryIntersection3f, len(self.instances))
        pi.t, pi.valid = 1, True
        found: dict[mi.Object, Any] = {}
        if dr.is_jit_v(mi.Float):
            numbers = [registry_number(instance) for instance in self.instances]
            pi.instance = dr.reinterpret_array(mi.ShapePtr, mi.UInt32(numbers))
            rays = dr.zeros(mi.Ray3f, len(self.instances))
            si = pi.compute_surface_interaction(rays, +mi.RayFlags.Minimal, mi.Bool(True))
            by_number = {registry_number(member): group for member, group in group_of.items()}
            firsts = np.array(dr.reinterpret_array(mi.UInt32, si.shape))
            for instance, first in zip(self.instances, firsts, strict=True):
                found[instance] = by_number.get(int(first), empty)
            return found
        for instance in self.instances:
            pi.instance = instance
            si = pi.compute_surface_interaction(dr.zeros(mi.Ray3f), +mi.RayFlags.Minimal, True)
            found[instance] = group_of.get(si.shape, empty)
        return found

    def _walk(self, owner: mi.Object) -> None:
        if owner in self.nodes:
            return
        node = self.nodes[owner] = Node()
        owner.traverse(recorder(node))
        for child in node.children.values():
            self._walk(child)

    def _values_of(self, belongs: Any) -> list[tuple[Any, Any, mi.Object]]:
        return [
            (where, kind, owner)
            for owner, node in self.nodes.items()
            if belongs(owner)
            for where, kind in node.values.values()
        ]


class Stamp:
    """The values of a set of parameters at one time, as identities.

    Dr.Jit gives every new array an index, and gives the index of an array that nobody holds to the next one. So
    the stamp holds the arrays themselves (a copy shares the index): equal indices then mean the same arrays.
    """

    def __init__(self, places: list[tuple[Any, Any, mi.Object]]) -> None:
        values = [read(*place) for place in places]
        plain = [_plain(value) for value in values]
        # A transform's matrix says enough: the inverse that Mitsuba keeps beside it is half of all there is to compare.
        self._live = [
            part
            for value, known in zip(values, plain, strict=True)
            if known is None
            for part in _parts(value.matrix if hasattr(value, "inverse_transpose") else value)
        ]
        """Dr.Jit's own objects, as their owners hold them: an edit shows in them."""
        self._numbers_at = [place for place, known in zip(places, plain, strict=True) if known is not None]
        self._numbers = self._read_numbers()
        self._held = dr.copy(self._live)
        self._indices = dr.detail.collect_indices(self._held)

    def is_current(self) -> bool:
        """Whether no value was replaced since. Without Dr.Jit nobody can tell, and the answer is no."""
        if not dr.is_jit_v(mi.Float):
            return False
        return dr.detail.collect_indices(self._live) == self._indices and self._read_numbers() == self._numbers

    def _read_numbers(self) -> list[Any]:
        return [_plain(read(*place)) for place in self._numbers_at]


def _parts(value: Any) -> Iterator[Any]:
    """Give the flat arrays in a matrix or colour, as it holds them: Dr.Jit looks through a list of them much faster."""
    if dr.depth_v(value) > 1:
        for part in value:
            yield from _parts(part)
    else:
        yield value


def _plain(value: Any) -> Any:
    """Give a value that is no array of Dr.Jit in a form that an edit does not change; None if it is one."""
    if isinstance(value, (bool, int, float)):
        return value
    matrix = getattr(value, "matrix", None)
    return None if matrix is None or dr.is_jit_v(matrix) else np.array(matrix).tolist()


def recorder(node: Node) -> mi.TraversalCallback:
    """Make the callback that fills `node` when an object's ``traverse()`` gets it."""

    class Recorder(mi.TraversalCallback):
        def put(self, name: str, value: Any, flags: int, cpptype: Any = None) -> None:
            if isinstance(value, mi.Object):
                self.put_object(name, value, flags)
            else:
                self.put_value(name, value, flags, cpptype)

        def put_value(self, name: str, value: Any, flags: int, cpptype: Any = None) -> None:
            node.values[name] = (value, cpptype)

        def put_object(self, name: str, value: mi.Object | None, flags: int) -> None:
            if value is not None:
                while name in node.children:  # unnamed members of a group all come as `shape`
                    name += "_"
                node.children[name] = value

    return Recorder()


def _children(owner: mi.Object) -> list[mi.Object]:
    node = Node()
    owner.traverse(recorder(node))
    return list(node.children.values())


def searched_by_optix() -> bool:
    """Whether rays are searched by OptiX, on a GPU, and not by Embree."""
    return bool(dr.backend_v(mi.Float) == dr.JitBackend.CUDA)


def registry_number(shape: Any) -> int:
    """Dr.Jit's number of an object, by which kernels know it."""
    return int(np.array(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape)))[0])


def read(where: Any, kind: Any, owner: mi.Object) -> Any:
    """Read a parameter as it is now from an entry of ``Node.values`` and the object that it belongs to."""
    return where if kind is None else mi.get_property(where, kind, owner)


def number(value: Any) -> float:
    """Take the one number out of a value of Mitsuba, whatever the variant stores it in."""
    return float(value[0]) if dr.is_jit_v(value) else float(value)
