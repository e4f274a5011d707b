"""Shapes, groups and instances, as scene files have them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

from whitted_reference import float32, mesh_files, polygon, scene, transforms
from whitted_reference.errors import NotDefined, SceneError
from whitted_reference.materials_xml import is_textured, read_look
from whitted_reference.properties import Properties, parse_number
from whitted_reference.transforms import Affine, Row3


def _similarity(p: Properties, m: Affine, axes: Sequence[int]) -> None:
    """Refuse shear, and unequal scale among `axes`.

    M is rounded to binary32 at most three times (once as read, twice where centre and radius or the two
    ends are multiplied in), so each column is off by at most 3 u |m|, u = 2^-24, and each scalar product
    of two columns of length s by 6 u s^2 (first order); twice that separates rounding from intent.
    """
    columns = [m.column(j) for j in range(3)]

    def dot(i: int, j: int) -> float:
        return sum(x * y for x, y in zip(columns[i], columns[j], strict=True))

    size = dot(axes[0], axes[0])
    for i in range(3):
        for j in range(i):
            if abs(dot(i, j)) > 12 * float32.ROUNDOFF * math.sqrt(dot(i, i) * dot(j, j)):
                raise NotDefined(f"{p.type} with shear", p.element.attributes.get("id", p.type), p.where)
    for i in axes:
        if abs(dot(i, i) - size) > 12 * float32.ROUNDOFF * size:
            raise NotDefined(f"{p.type} with unequal scale", p.element.attributes.get("id", p.type), p.where)


def _times32(p: Properties, *factors: Affine) -> Affine:
    """Multiply in single precision, as Mitsuba does with centre and radius."""
    result = factors[0]
    for factor in factors[1:]:
        result = transforms.product(result, factor, float32.fma)
    if not result.is_finite() or result.determinant() == 0:
        raise p.refuse("the shape is degenerate or not finite in single precision")
    return result


def _scaling32(v: Row3) -> Affine:
    return transforms.scaling(v).rounded()


def _sphere(p: Properties, look: scene.Look) -> scene.Solid:
    radius = p.single("radius", 1.0)
    if radius == 0.0:
        raise p.refuse("radius is 0; allowed: other numbers")
    m = _times32(p, p.transform(), transforms.translation(p.vec("center", (0.0, 0.0, 0.0))), _scaling32((radius,) * 3))
    _similarity(p, m, (0, 1, 2))
    inward = p.boolean("flip_normals", False) != (m.determinant() < 0)
    return scene.Sphere(look, m.column(3), float32.length(m.column(0)), m, inward)


def _cylinder(p: Properties, look: scene.Look) -> scene.Solid:
    near = float32.nearest
    radius = p.single("radius", 1.0)
    p0, p1 = p.vec("p0", (0.0, 0.0, 0.0)), p.vec("p1", (0.0, 0.0, 1.0))
    axis = (near(p1[0] - p0[0]), near(p1[1] - p0[1]), near(p1[2] - p0[2]))
    length = float32.length(axis)
    if radius == 0.0 or length == 0.0:
        raise p.refuse(f"radius {radius:g}, length {length:g}; allowed: other than 0")
    n = float32.divided(axis, length)
    s, t = float32.frame(n)
    to_frame = transforms.from_columns(s, t, n, (0.0, 0.0, 0.0), (s, t, n))
    m = _times32(p, p.transform(), transforms.translation(p0), to_frame, _scaling32((radius, radius, length)))
    _similarity(p, m, (0, 1))
    return scene.Cylinder(look, m, p.boolean("flip_normals", False))


def _rectangle(p: Properties, look: scene.Look) -> scene.Solid:
    p.boolean("face_normals", False)
    return scene.Rectangle(look, p.transform(), p.boolean("flip_normals", False))


def _disk(p: Properties, look: scene.Look) -> scene.Solid:
    return scene.Disk(look, p.transform(), p.boolean("flip_normals", False))


def _cube(p: Properties, look: scene.Look) -> scene.Solid:
    p.boolean("face_normals", False)
    vertices: list[Row3] = []
    normals: list[Row3] = []
    uvs: list[tuple[float, float]] = []
    faces: list[tuple[int, int, int]] = []
    for n, corners in _CUBE_FACES:
        first = len(vertices)
        vertices += corners
        normals += [n] * 4
        uvs += [(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)]
        faces += [(first, first + 1, first + 2), (first + 3, first, first + 2)]
    return _world_mesh(p, look, mesh_files.RawMesh(vertices, faces, normals, uvs), smooth=False)


# Each face of the cube: its normal and its corners in the order of uv (0,1) (1,1) (1,0) (0,0).
_CUBE_FACES: tuple[tuple[Row3, tuple[Row3, ...]], ...] = (
    ((0, -1, 0), ((1, -1, -1), (1, -1, 1), (-1, -1, 1), (-1, -1, -1))),
    ((0, 1, 0), ((1, 1, -1), (-1, 1, -1), (-1, 1, 1), (1, 1, 1))),
    ((1, 0, 0), ((1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1))),
    ((0, 0, 1), ((1, -1, 1), (1, 1, 1), (-1, 1, 1), (-1, -1, 1))),
    ((-1, 0, 0), ((-1, -1, 1), (-1, 1, 1), (-1, 1, -1), (-1, -1, -1))),
    ((0, 0, -1), ((1, 1, -1), (1, -1, -1), (-1, -1, -1), (-1, 1, -1))),
)


def _mesh_file(p: Properties, look: scene.Look) -> scene.Solid:
    path = p.file()
    try:
        raw = mesh_files.read_ply(path) if p.type == "ply" else mesh_files.read_obj(path)
    except SceneError as error:
        raise p.refuse(str(error)) from None
    if p.boolean("flip_tex_coords", p.type == "obj") and raw.uvs is not None:
        raw.uvs = [(u, float32.nearest(1.0 - v)) for u, v in raw.uvs]
    smooth = not p.boolean("face_normals", False)
    if not smooth:
        raw.normals = None
    return _world_mesh(p, look, raw, smooth)


def _world_mesh(p: Properties, look: scene.Look, raw: mesh_files.RawMesh, smooth: bool) -> scene.Mesh:
    m = p.transform()
    vertices = tuple(_finite(p, m.point32(v)) for v in raw.vertices)
    return scene.Mesh(
        look=look,
        to_world=m,
        vertices=vertices,
        faces=tuple(raw.faces),
        normals=tuple(raw.normals) if raw.normals is not None else None,
        uvs=tuple(raw.uvs) if raw.uvs is not None else None,
        smooth=smooth and raw.normals is None,
        flip=p.boolean("flip_normals", False),
    )


def _finite(p: Properties, v: Row3) -> Row3:
    if not all(map(math.isfinite, v)):
        raise p.refuse(f"vertex {v} is not finite in single precision")
    return v


def _polygon(p: Properties, look: scene.Look) -> scene.Solid:
    material = look.material
    sides = (material.front, material.behind) if isinstance(material, scene.TwoSided) else (material,)
    if any(map(is_textured, sides)):
        raise p.not_defined("polygon with a texture")
    m = p.transform()
    text = p.string("vertices", None)
    rings = tuple(_ring(p, m, part) for part in text.split(";"))
    normal = p.vec("normal", (0.0, 0.0, 0.0)) if p.has("normal") else None
    shape = scene.Polygon(look, m, rings, normal, p.boolean("flip_normals", False))
    if normal is not None and not any(normal):
        raise p.refuse("`normal` is zero; allowed: other vectors")
    try:
        polygon.check(shape)
    except SceneError as error:
        raise p.refuse(str(error)) from None
    return shape


def _ring(p: Properties, m: Affine, text: str) -> tuple[Row3, ...]:
    vertices = []
    for token in text.split():
        parts = token.split(",")
        if len(parts) != 3:
            raise p.refuse(f"`vertices` holds `{token}`; allowed: x,y,z separated by spaces, rings by `;`")
        x, y, z = (float32.nearest(parse_number(part, f"{p.where} `vertices`")) for part in parts)
        vertices.append(_finite(p, m.point32((x, y, z))))
    if len(vertices) < 3:
        raise p.refuse(f"a ring of `vertices` has {len(vertices)} vertices; allowed: from 3")
    return tuple(vertices)


_SHAPES: dict[str, Callable[[Properties, scene.Look], scene.Solid]] = {
    "sphere": _sphere,
    "rectangle": _rectangle,
    "disk": _disk,
    "cylinder": _cylinder,
    "cube": _cube,
    "ply": _mesh_file,
    "obj": _mesh_file,
    "polygon": _polygon,
}


def _solid(p: Properties, number: int) -> scene.Solid:
    if p.type not in _SHAPES:
        raise p.not_defined()
    look = read_look(p, number)
    shape = _SHAPES[p.type](p, look)
    p.done()
    return shape


def _group(p: Properties) -> tuple[scene.Solid, ...]:
    solids = tuple(_solid(child, i) for i, child in enumerate(p.take_objects("shape")))
    for solid in solids:
        if solid.look.emission is not None:
            raise p.refuse(f"`{solid.look.id}` is an area light; allowed in a group: shapes that do not shine")
    p.done()
    return solids


def _instance(p: Properties, number: int) -> scene.Instance:
    groups = p.take_objects("shape")
    if [group.type for group in groups] != ["shapegroup"]:
        raise p.refuse("an instance refers to exactly one shapegroup")
    m = p.transform()
    p.done()
    return scene.Instance(p.element.attributes.get("id", f"instance_{number}"), m, _group(groups[0]))


def read_shapes(nested: Sequence[Properties]) -> Iterator[scene.Shape]:
    """Read all shapes of a scene; a group is drawn only where an instance refers to it."""
    for number, p in enumerate(nested):
        if p.type == "shapegroup":
            _group(p)  # drawn only where an instance refers to it
        elif p.type == "instance":
            yield _instance(p, number)
        else:
            yield _solid(p, number)
