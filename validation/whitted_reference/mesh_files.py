"""Triangle meshes from PLY (ascii, binary of either byte order) and OBJ files.

Both return the numbers of the file rounded to single precision, before any transform, with the vertex
and face order that Mitsuba gives them: PLY by index, OBJ welded by identical v/vt/vn in order of first
use and fans from the first vertex of a face.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from whitted_reference import float32
from whitted_reference.errors import SceneError

Floats3 = tuple[float, float, float]


@dataclass
class RawMesh:
    """Vertices, faces, and where the file has them normals and uv per vertex."""

    vertices: list[Floats3] = field(default_factory=list)
    faces: list[tuple[int, int, int]] = field(default_factory=list)
    normals: list[Floats3] | None = None
    uvs: list[tuple[float, float]] | None = None


def parse_binary32(text: str) -> float:
    """Round a decimal number to binary32 once, as `strtof` does.

    Going through binary64 rounds twice; that matters only where the first rounding lands exactly between
    two binary32 numbers, and there the decimal itself decides.
    """
    x = float(text)
    y = float32.nearest(x)
    if x != y and math.isfinite(y):
        other = _neighbour32(y, x)
        if x - y == other - x or y - x == x - other:
            exact, middle = Fraction(text), Fraction(x)
            if exact != middle:
                return max(y, other) if exact > middle else min(y, other)
    return y


def _neighbour32(y: float, towards: float) -> float:
    (bits,) = struct.unpack("<i", struct.pack("<f", y))
    if y == 0.0:
        return math.copysign(2.0**-149, towards)
    bits += 1 if (towards > y) == (y > 0.0) else -1
    value: float = struct.unpack("<f", struct.pack("<i", bits))[0]
    return value


# --------------------------------------------------------------------------------------------------- PLY
_PLY_TYPES = {
    name: code
    for code, names in {
        "b": "char int8",
        "B": "uchar uint8",
        "h": "short int16",
        "H": "ushort uint16",
        "i": "int int32",
        "I": "uint uint32",
        "f": "float float32",
        "d": "double float64",
    }.items()
    for name in names.split()
}
_UV_NAMES = (("u", "v"), ("texture_u", "texture_v"), ("s", "t"))


@dataclass
class _Property:
    name: str
    code: str
    count_code: str | None  # of a list


@dataclass
class _Element:
    name: str
    count: int
    properties: list[_Property]


def read_ply(path: Path) -> RawMesh:
    """Read a PLY file of triangles.

    Raises
    ------
    SceneError
        If the file is not a well-formed triangle mesh; the line names the file and what is wrong.
    """
    data = path.read_bytes()
    try:
        return _ply(data)
    except (ValueError, KeyError, struct.error) as error:
        raise SceneError(f"{path.name}: bad PLY file: {error}") from None


def _ply(data: bytes) -> RawMesh:
    mark = data.find(b"end_header")
    if not data.startswith(b"ply") or mark < 0:
        raise ValueError("no PLY header")
    end = data.index(b"\n", mark) + 1
    form, elements = _ply_header(data[:mark].decode("ascii").splitlines())
    tokens: Iterator[str] | None = None
    if form == "ascii":
        tokens = iter(data[end:].decode("ascii").split())
        order = ""
    else:
        order = {"binary_little_endian": "<", "binary_big_endian": ">"}[form]
    mesh = RawMesh()
    offset = end
    for element in elements:
        if tokens is not None:
            rows = [[_ascii_value(tokens, p) for p in element.properties] for _ in range(element.count)]
        else:
            rows, offset = _binary_rows(data, offset, order, element)
        if element.name == "vertex":
            _ply_vertices(mesh, element, rows)
        elif element.name == "face":
            _ply_faces(mesh, element, rows)
    if tokens is None and offset != len(data):
        raise ValueError("bytes left over after the last element")
    if tokens is not None and next(tokens, None) is not None:
        raise ValueError("tokens left over after the last element")
    return _checked(mesh)


def _ply_header(lines: list[str]) -> tuple[str, list[_Element]]:
    form = ""
    elements: list[_Element] = []
    for line in lines[1:]:
        match line.split():
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case ["format", ("ascii" | "binary_little_endian" | "binary_big_endian") as form, "1.0"]:
                pass
            case ["element", name, count]:
                elements.append(_Element(name, int(count), []))
            case ["property", "list", count_type, item_type, name] if elements:
                elements[-1].properties.append(_Property(name, _PLY_TYPES[item_type], _PLY_TYPES[count_type]))
            case ["property", kind, name] if elements and kind in _PLY_TYPES:
                elements[-1].properties.append(_Property(name, _PLY_TYPES[kind], None))
            case _:
                raise ValueError(f"header line `{line}` is not understood")
    if not form:
        raise ValueError("no format line")
    return form, elements


def _ascii_value(stream: Iterator[str], p: _Property) -> object:
    token = next(stream, None)
    if token is None:
        raise ValueError("the file ends too early")
    if p.count_code is not None:
        item = _Property(p.name, p.code, None)
        return [_ascii_value(stream, item) for _ in range(int(token))]
    if p.code == "f":
        return parse_binary32(token)
    return float(token) if p.code == "d" else int(token)


def _binary_rows(data: bytes, offset: int, order: str, element: _Element) -> tuple[list[list[object]], int]:
    rows: list[list[object]] = []
    if all(p.count_code is None for p in element.properties):
        layout = struct.Struct(order + "".join(p.code for p in element.properties))
        end = offset + layout.size * element.count
        rows = [list(row) for row in layout.iter_unpack(data[offset:end])]
        if len(rows) != element.count:
            raise ValueError(f"the file ends inside element `{element.name}`")
        return rows, end
    for _ in range(element.count):
        row: list[object] = []
        for p in element.properties:
            count = 1
            if p.count_code is not None:
                (count,) = struct.unpack_from(order + p.count_code, data, offset)
                offset += struct.calcsize(order + p.count_code)
            items = struct.unpack_from(f"{order}{count}{p.code}", data, offset)
            offset += struct.calcsize(f"{order}{count}{p.code}")
            row.append(list(items) if p.count_code is not None else items[0])
        rows.append(row)
    return rows, offset


def _ply_vertices(mesh: RawMesh, element: _Element, rows: list[list[object]]) -> None:
    places = {p.name: i for i, p in enumerate(element.properties)}

    def columns(*names: str) -> list[tuple[float, ...]] | None:
        if not all(name in places for name in names):
            return None
        chosen = [places[name] for name in names]
        for i in chosen:
            if element.properties[i].code not in "fd":
                raise ValueError(f"vertex property `{element.properties[i].name}` must be float or double")
        return [tuple(float32.nearest(row[i]) for i in chosen) for row in rows]  # type: ignore[arg-type]

    positions = columns("x", "y", "z")
    if positions is None:
        raise ValueError("element `vertex` needs the properties x, y, z")
    mesh.vertices = positions  # type: ignore[assignment]
    mesh.normals = columns("nx", "ny", "nz")  # type: ignore[assignment]
    mesh.uvs = next((c for c in (columns(*names) for names in _UV_NAMES) if c is not None), None)  # type: ignore[assignment]


def _ply_faces(mesh: RawMesh, element: _Element, rows: list[list[object]]) -> None:
    names = [p.name if p.count_code is not None else "" for p in element.properties]
    place = next((names.index(name) for name in ("vertex_index", "vertex_indices") if name in names), None)
    if place is None:
        raise ValueError("element `face` needs the list vertex_index or vertex_indices")
    for row in rows:
        face = row[place]
        if len(face) != 3:  # type: ignore[arg-type]
            raise ValueError(f"a face has {len(face)} vertices, only triangles are allowed")  # type: ignore[arg-type]
        mesh.faces.append(tuple(face))  # type: ignore[arg-type]


# --------------------------------------------------------------------------------------------------- OBJ
def read_obj(path: Path) -> RawMesh:
    """Read a Wavefront OBJ file; lines other than v, vt, vn and f are ignored.

    Raises
    ------
    SceneError
        If the file is malformed, uses negative indices, or gives normals or uv to some corners only.
    """
    try:
        return _obj(path.read_text("ascii", "replace"))
    except ValueError as error:
        raise SceneError(f"{path.name}: bad OBJ file: {error}") from None


def _obj(text: str) -> RawMesh:
    positions: list[Floats3] = []
    texcoords: list[tuple[float, float]] = []
    directions: list[Floats3] = []
    faces: list[list[tuple[int, int, int]]] = []
    for line in text.splitlines():
        match line.split():
            case ["v", x, y, z, *_]:
                positions.append((parse_binary32(x), parse_binary32(y), parse_binary32(z)))
            case ["vt", u, v, *_]:
                texcoords.append((parse_binary32(u), parse_binary32(v)))
            case ["vn", x, y, z, *_]:
                directions.append((parse_binary32(x), parse_binary32(y), parse_binary32(z)))
            case ["f", *corners]:
                if len(corners) < 3:
                    raise ValueError(f"face `{line.strip()}` has fewer than three corners")
                faces.append([_corner(corner) for corner in corners])
            case [("v" | "vt" | "vn"), *_]:
                raise ValueError(f"line `{line.strip()}` is too short")
    corners_used = [corner for face in faces for corner in face]
    for place, have, what in ((1, texcoords, "vt"), (2, directions, "vn")):
        given = sum(corner[place] != 0 for corner in corners_used)
        if given not in (0, len(corners_used)) or (have and not given):
            raise ValueError(f"{what} is given for {given} of {len(corners_used)} corners; all or none is allowed")
    ids: dict[tuple[int, int, int], int] = {}
    mesh = RawMesh()
    for face in faces:
        fan = [ids.setdefault(corner, len(ids)) for corner in face]
        mesh.faces.extend((fan[0], fan[i], fan[i + 1]) for i in range(1, len(fan) - 1))
    try:
        mesh.vertices = [positions[v - 1] for v, _, _ in ids]
        mesh.uvs = [texcoords[t - 1] for _, t, _ in ids] if texcoords else None
        mesh.normals = [directions[n - 1] for _, _, n in ids] if directions else None
    except IndexError:
        raise ValueError("a face refers to a v, vt or vn that the file does not hold") from None
    return _checked(mesh)


def _corner(text: str) -> tuple[int, int, int]:
    parts = text.split("/")
    if len(parts) > 3 or not parts[0].isdecimal() or not all(part.isdecimal() or not part for part in parts):
        raise ValueError(f"face corner `{text}` is not v, v/vt, v//vn or v/vt/vn with positive numbers")
    indices = [int(part) if part else 0 for part in parts] + [0, 0]
    if indices[0] == 0 or "0" in parts:
        raise ValueError(f"face corner `{text}` counts from 1")
    return indices[0], indices[1], indices[2]


def _checked(mesh: RawMesh) -> RawMesh:
    count = len(mesh.vertices)
    if not mesh.faces or not count:
        raise ValueError("no vertices or no faces")
    if any(not 0 <= i < count for face in mesh.faces for i in face):
        raise ValueError(f"a face refers to a vertex outside 0..{count - 1}")
    for name, rows in (("vertex", mesh.vertices), ("normal", mesh.normals), ("uv", mesh.uvs)):
        for i, row in enumerate(rows or ()):
            if not all(map(math.isfinite, row)):
                raise ValueError(f"{name} {i} is not finite")
    return mesh
