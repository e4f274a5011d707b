"""The `polygon` shape: a flat polygon with holes and self-crossings, triangulated once when it is loaded."""

from __future__ import annotations

import textwrap
import threading
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from mitsuba_whitted.errors import SceneError

Array = NDArray[Any]


_IMPORT = threading.Lock()
"""Mitsuba makes the shapes of a file on several threads, and shapely gets entangled when two import it at once."""


def define() -> type[mi.Mesh]:
    """Make the plugin class for the variant that is set.

    Returns
    -------
    type
        The class `Polygon`, to be registered as ``polygon``.
    """

    class Polygon(mi.Mesh):
        r"""
        .. _shape-polygon:

        Polygon (:monosp:`polygon`)
        ---------------------------

        .. pluginparameters::

         * - vertices
           - |string|
           - Rings of the polygon, separated by ``;``. A ring is a list of three or more vertices
             ``x,y,z`` separated by blanks; it closes by itself.

         * - normal
           - |vector|
           - Direction of the normal, perpendicular to the plane, of any length but 0. (Default: the
             side from which the first ring is seen to run counter-clockwise)

         * - to_world
           - |transform|
           - Linear object-to-world transformation, not singular. (Default: none)

         * - flip_normals
           - |boolean|
           - Turn the normal to the other side. (Default: |false|)

         * - vertex_positions, vertex_normals, vertex_texcoords, faces
           - see :ref:`ply <shape-ply>`
           - The triangulation, see below.
           - |exposed|, |differentiable|

        A point is inside if a ray from it crosses the rings an odd number of times, all rings taken together
        (Shirley, Ashikhmin and Marschner, *Fundamentals of Computer Graphics*, 3rd ed., section 4.4.3). So
        a ring within a ring is a hole, a ring within the hole an island, and the middle of a pentagram is a
        hole too. Rings may be concave, cross themselves and each other.

        The transformed vertices must lie in one plane, through the mean of the first ring's vertices, within
        :math:`10^{-5}` of the diagonal of their bounding box and two units in the last place of the largest
        coordinate. Its normal is the parameter :monosp:`normal`, transformed as normals are; without it,
        Newell's vector of the first ring; and where that is shorter than :math:`10^{-6}` of the squared
        perimeter, as for a bow-tie, the normal of the first three vertices of the ring not on one line.

        The shape is a mesh. Its vertex 0 is the mean of the first ring's vertices and belongs to no
        triangle; then come the vertices as listed, then those where rings cross. All vertex normals are the
        polygon's normal. An edit has to move all vertices of the mesh, number 0 too; Mitsuba computes the
        normals anew thereafter, but for vertex 0.

        Texture coordinates are the two object coordinates that follow the normal's largest one in the order
        x, y, z, x, y, scaled so that the polygon's bounding box becomes the unit square.

        .. tabs::
            .. code-tab:: xml
                :name: polygon

                <shape type="polygon">
                    <string name="vertices" value="-2,-2,0 2,-2,0 2,2,0 -2,2,0; -1,-1,0 1,-1,0 0,1,0"/>
                </shape>

            .. code-tab:: python

                'type': 'polygon',
                'vertices': '-2,-2,0 2,-2,0 2,2,0 -2,2,0; -1,-1,0 1,-1,0 0,1,0'
        """  # noqa: D400 (a page of Mitsuba's manual starts with its label)

        def __init__(self, props: mi.Properties) -> None:
            try:
                mesh = _build(props["vertices"], props.get("normal"), props.get("to_world"))
            except SceneError as error:
                raise SceneError(f"polygon `{props.id()}`: {error}") from None

            super().__init__(props.id(), len(mesh.positions), len(mesh.faces), props, True, True)
            parameters = mi.traverse(self)
            parameters["faces"] = np.ravel(mesh.faces)
            parameters["vertex_positions"] = np.ravel(mesh.positions)
            parameters["vertex_normals"] = np.tile(mesh.normal, len(mesh.positions))
            parameters["vertex_texcoords"] = np.ravel(mesh.texcoords)
            parameters.update()

        def to_string(self) -> str:
            parameters = (
                f"id = {self.id()!r}",
                f"vertex_count = {self.vertex_count()}",
                f"face_count = {self.face_count()}",
                f"bbox = {self.bbox()}",
                f"bsdf = {self.bsdf()}",
            )
            return "Polygon[\n" + textwrap.indent(",\n".join(parameters), "  ") + "\n]"

    return Polygon


@dataclass
class _Triangulation:
    positions: Array  # (m, 3) float32, world
    normal: Array  # (3,) float32, unit
    texcoords: Array  # (m, 2) float32
    faces: Array  # (t, 3) uint32, counter-clockwise as seen from where the normal points to


def _build(text: Any, normal: Any, to_world: Any) -> _Triangulation:
    rings = _parse(text)
    origin, inverse_transpose = np.zeros(3), np.eye(3)
    if to_world is not None:
        rings, origin, inverse_transpose = _transform(rings, to_world)
    outline = np.concatenate(rings)

    centre = rings[0].mean(axis=0)
    n = _newell(rings[0]) if normal is None else inverse_transpose @ np.array(normal)
    if not (np.isfinite(n).all() and n.any()):
        raise SceneError(f"normal is {_show(np.array(normal))}, allowed is any finite vector but 0,0,0")
    n = n / np.linalg.norm(n)
    _check_planar(outline, centre, n)

    i, j, k = _axes(n)  # project along k
    flat, faces = _triangulate([ring[:, [i, j]] for ring in rings])
    positions = np.empty((1 + len(flat), 3))
    positions[0] = centre
    positions[1:, [i, j]] = flat
    positions[1:, k] = centre[k] - (flat - centre[[i, j]]) @ n[[i, j]] / n[k]
    positions[1 : 1 + len(outline)] = outline
    if n[k] < 0:
        faces = faces[:, ::-1]

    texcoords = _texcoords((positions - origin) @ inverse_transpose, np.linalg.solve(inverse_transpose, n))
    return _Triangulation(
        positions.astype(np.float32),
        n.astype(np.float32),
        texcoords.astype(np.float32),
        (faces + 1).astype(np.uint32),
    )


def _texcoords(object_positions: Array, object_normal: Array) -> Array:
    """Scale the coordinates across the normal's largest one, so that vertices 1 and on just fit [0, 1]."""
    coordinates = object_positions[:, _axes(object_normal)[:2]]
    lower, upper = coordinates[1:].min(axis=0), coordinates[1:].max(axis=0)
    texcoords: Array = (coordinates - lower) / np.where(upper > lower, upper - lower, 1)
    return texcoords


def _parse(text: Any) -> list[Array]:
    """Read the rings: each (n, 3) float64, n >= 3, of values rounded to float32."""
    if not isinstance(text, str):
        raise SceneError(f"vertices is {text}, allowed is a string `x,y,z x,y,z x,y,z; ...`")
    rings = []
    for number, ring in enumerate(text.split(";"), start=1):
        vertices = [_parse_vertex(word) for word in ring.split()]
        if len(vertices) < 3:
            raise SceneError(f"ring {number} has {len(vertices)} vertices, allowed are 3 or more")
        rings.append(np.array(vertices))
    return rings


def _parse_vertex(word: str) -> Array:
    try:
        vertex = np.array([float(number) for number in word.split(",")])
    except ValueError:
        vertex = np.empty(0)
    if vertex.shape != (3,) or "_" in word:  # Python reads 1_000 as a number
        raise SceneError(f"vertex `{word}` is not of the form x,y,z")
    return _finite(vertex, f"vertex `{word}`")


def _finite(vertex: Array, what: str) -> Array:
    with np.errstate(over="ignore"):
        vertex = vertex.astype(np.float32)
    if not np.isfinite(vertex).all():
        raise SceneError(f"{what} is {_show(vertex)}, allowed are finite numbers of float32")
    return vertex.astype(np.float64)


def _transform(rings: list[Array], to_world: Any) -> tuple[list[Array], Array, Array]:
    """Transform as Mitsuba transforms the vertices of a mesh file, to the bit: in float32, with its own code.

    Returns the rings, the translation and the inverse transpose of the linear part, all float64.
    """
    matrix4f: Any = mi.ScalarMatrix4f
    transform = mi.ScalarAffineTransform4f(matrix4f(to_world.matrix), matrix4f(to_world.inverse_transpose))
    matrix, inverse_transpose = np.array(transform.matrix), np.array(transform.inverse_transpose)
    if not np.isfinite(inverse_transpose).all():
        raise SceneError(f"to_world is singular: {' '.join(f'{x:g}' for x in np.ravel(matrix))}")
    world_rings = [
        np.array([_finite(np.array(transform @ mi.ScalarPoint3f(v)), "transformed vertex") for v in ring])
        for ring in rings
    ]
    return world_rings, matrix[:3, 3].astype(np.float64), inverse_transpose[:3, :3].astype(np.float64)


def _newell(ring: Array) -> Array:
    """Compute a normal of the ring, not of unit length, from all its vertices if they enclose an area.

    The length of Newell's vector is twice that area (Sutherland, Sproull, Schumacker 1974); the two halves of
    a bow-tie cancel.
    """
    spokes = ring - ring[0]
    edges = np.roll(ring, -1, axis=0) - ring
    newell: Array = np.cross(spokes, edges).sum(axis=0)
    if np.linalg.norm(newell) >= 1e-6 * np.linalg.norm(edges, axis=1).sum() ** 2 > 0:
        return newell

    noise = 2 * _ulp(ring)  # what rounding may have moved a vertex by
    for second, spoke in enumerate(spokes):
        normals = np.cross(spoke, spokes[second:])
        sides = [np.linalg.norm(side, axis=1) for side in (spokes[second:], spokes[second:] - spoke)]
        longest = np.max([*sides, np.full_like(sides[0], np.linalg.norm(spoke))], axis=0)
        third = np.flatnonzero(np.linalg.norm(normals, axis=1) > noise * longest)  # a triangle higher than that
        if third.size:
            first_normal: Array = normals[third[0]]
            return first_normal
    raise SceneError("all vertices of its first ring lie on one line, so it has no normal")


def _check_planar(outline: Array, centre: Array, n: Array) -> None:
    diagonal = np.linalg.norm(np.ptp(outline, axis=0))
    allowed = 1e-5 * diagonal + 2 * _ulp(outline)
    distances = np.abs((outline - centre) @ n)
    worst = distances.argmax()
    if distances[worst] > allowed:
        raise SceneError(
            f"vertex {worst + 1} at {_show(outline[worst])} is {distances[worst]:.3g} off the plane of the "
            f"polygon, whose normal is {_show(n)}; allowed is {allowed:.3g}"
        )


def _triangulate(rings: list[Array]) -> tuple[Array, Array]:
    """Triangulate what lies inside an odd number of times.

    The rings cut the plane into faces; each is inside or outside as a whole. The kept ones are cut into
    triangles that use every vertex on their edges, so that neighbours always share whole edges.

    Parameters
    ----------
    rings : list of (n, 2) float64
        Vertices, of values exact in float32.

    Returns
    -------
    positions : (m, 2) float64, exact in float32
        All vertices of all rings as given, then the points where rings cross.
    triangles : (t, 3) int
        Counter-clockwise. One of three equal vertices -1 if there is no inside at all.
    """
    with _IMPORT:
        import shapely  # type: ignore[import-untyped]  # it has no stubs; here, since few scenes need it

    starts = np.concatenate(rings)
    ends = np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    network = shapely.unary_union(shapely.linestrings(np.stack([starts, ends], axis=1)))
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(network)))

    positions = [(float(x), float(y)) for x, y in starts]
    index = {position: number for number, position in enumerate(positions)}
    triangles = []
    for face in faces:
        if not _inside(face.representative_point(), starts, ends):
            continue
        for triangle in shapely.get_parts(shapely.constrained_delaunay_triangles(face)):
            corners = []
            for x, y in shapely.normalize(triangle).exterior.coords[:3]:
                position = float(np.float32(x)), float(np.float32(y))
                if position not in index:
                    index[position] = len(positions)
                    positions.append(position)
                corners.append(index[position])
            if len(set(corners)) == 3:  # else rounding has made an edge a point, for its neighbours too
                triangles.append(corners[::-1])  # GEOS's normal form is clockwise
    return np.array(positions), np.array(triangles or [[-1, -1, -1]])


def _inside(point: Any, starts: Array, ends: Array) -> bool:
    """Count the edges to the right of a point, in exact arithmetic where it matters; odd is inside."""
    inside = False
    for crossed in np.flatnonzero((starts[:, 1] > point.y) != (ends[:, 1] > point.y)):
        (x0, y0), (x1, y1) = starts[crossed], ends[crossed]
        x, y = Fraction(point.x), Fraction(point.y)
        slope = (Fraction(x1) - Fraction(x0)) / (Fraction(y1) - Fraction(y0))
        inside ^= x < Fraction(x0) + (y - Fraction(y0)) * slope
    return inside


def _axes(n: Array) -> list[int]:
    """Put the axis of the largest component of n last, after the two that follow it in cyclic order.

    Then what is counter-clockwise in the first two is so as seen from the positive side of the last.
    """
    k = int(np.abs(n).argmax())
    return [(k + 1) % 3, (k + 2) % 3, k]


def _ulp(points: Array) -> float:
    return float(np.spacing(np.float32(np.abs(points).max())))


def _show(vector: Array) -> str:
    return ",".join(f"{x:g}" for x in vector)
