"""Small scenes from strings, and the one way in which these tests compare colours.

A colour computed by hand is compared with the tracer's by intervals: traced with interval arithmetic, the
enclosure must contain the exact answer, and must be no wider than the accuracy that the tracer claims for
itself (`proof.TARGET`). So no test needs a tolerance of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from decimal import Decimal
from fractions import Fraction
from pathlib import Path

import pytest

from whitted_reference import Scene, Tracer, load
from whitted_reference.arithmetic import FLOAT, INTERVAL
from whitted_reference.intervals import Interval
from whitted_reference.proof import TARGET

Exact = float | Fraction | Decimal

SENSOR = """
<sensor type="perspective">
  <float name="fov" value="90"/>
  <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/>
    <rfilter type="box"/></film>
</sensor>
"""


def encloses(interval: Interval, exact: Exact) -> bool:
    """Tell whether an exact number lies in an interval, by exact comparison."""
    return Fraction(interval.low) <= Fraction(exact) <= Fraction(interval.high)


@pytest.fixture
def scene_file(tmp_path: Path) -> Callable[..., Path]:
    """Write a scene around a body: `scene_file(body, integrator_parameters, **files)`."""

    def write(
        body: str, integrator: str = "", sensor: str = SENSOR, files: dict[str, str | bytes] | None = None
    ) -> Path:
        for name, content in (files or {}).items():
            data = content if isinstance(content, bytes) else content.encode()
            (tmp_path / name).write_bytes(data)
        path = tmp_path / "scene.xml"
        integrator = f'<integrator type="whitted">{integrator}</integrator>'
        path.write_text(f'<scene version="3.0.0">{integrator}{sensor}{body}</scene>')
        return path

    return write


@pytest.fixture
def load_scene(scene_file: Callable[..., Path]) -> Callable[..., Scene]:
    """Write and load: the arguments of `scene_file`."""

    def make(*args: object, **kwargs: object) -> Scene:
        return load(scene_file(*args, **kwargs))

    return make


class Eye:
    """Looks into a scene along single rays, in floats and in intervals at once."""

    def __init__(self, scene: Scene) -> None:
        self.floats = Tracer(scene, FLOAT)
        self.intervals = Tracer(scene, INTERVAL)

    def see(self, e: Sequence[float], d: Sequence[float]) -> list[Interval]:
        """Return the enclosure of the colour from e towards d, having checked it against floats."""
        enclosure = [INTERVAL.of(0) + c for c in _trace(self.intervals, e, d)]
        for interval, value in zip(enclosure, _trace(self.floats, e, d), strict=True):
            assert interval.low <= value <= interval.high
            assert interval.width <= TARGET
        return enclosure

    def sees(self, e: Sequence[float], d: Sequence[float], *expected: Exact) -> bool:
        """Tell whether the exact colour (three numbers, or one for grey) is enclosed; if not, show both."""
        enclosure = self.see(e, d)
        exact = expected * (3 // len(expected))
        right = all(map(encloses, enclosure, exact))
        if not right:
            print("seen", enclosure, "expected", [float(c) for c in exact])
        return right


def _trace(tracer: Tracer, e: Sequence[float], d: Sequence[float]):  # type: ignore[no-untyped-def]
    arithmetic = tracer.arithmetic
    origin, direction = arithmetic.vec(tuple(e)), arithmetic.vec(tuple(d))
    x, y, z = direction
    length = arithmetic.sqrt(x * x + y * y + z * z)
    end = arithmetic.infinity
    return tracer.raycolor(origin, (x / length, y / length, z / length), arithmetic.before(arithmetic.of(0)), end)


@pytest.fixture
def eye(load_scene: Callable[..., Scene]) -> Callable[..., Eye]:
    """Make an `Eye` for a scene: the arguments of `scene_file`."""

    def make(*args: object, **kwargs: object) -> Eye:
        return Eye(load_scene(*args, **kwargs))

    return make


def _ply(vertices: Sequence[Sequence[float]], faces: Sequence[Sequence[int]], properties: Sequence[str]) -> str:
    header = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in properties]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(repr, v)) for v in vertices] + [f"{len(f)} " + " ".join(map(str, f)) for f in faces]
    return "\n".join(header + rows) + "\n"


@pytest.fixture
def ply() -> Callable[..., str]:
    """Return the text of an ascii PLY file: `ply(vertices, faces, property_names)`."""

    def make(
        vertices: Sequence[Sequence[float]],
        faces: Sequence[Sequence[int]],
        properties: Sequence[str] = ("x", "y", "z"),
    ) -> str:
        return _ply(vertices, faces, properties)

    return make


@pytest.fixture
def bumpy() -> tuple[list[list[float]], list[list[int]]]:
    """Return a closed bumpy ball: vertices and outward triangles, 12 x 24 quadrilaterals less the poles."""
    rings, turns = 12, 24
    vertices: list[list[float]] = [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]
    for i in range(1, rings):
        for j in range(turns):
            theta, phi = math.pi * i / rings, 2 * math.pi * j / turns
            r = 1.0 + 0.1 * math.sin(5 * theta) * math.cos(7 * phi)
            vertices.append(
                [
                    r * math.sin(theta) * math.cos(phi),
                    r * math.sin(theta) * math.sin(phi),
                    r * math.cos(theta),
                ]
            )

    def at(i: int, j: int) -> int:
        return 0 if i == 0 else 1 if i == rings else 2 + (i - 1) * turns + j % turns

    faces = []
    for i in range(rings):
        for j in range(turns):
            a, b, c, d = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
            faces += [[a, b, c]] if i < rings - 1 else []
            faces += [[a, c, d]] if i > 0 else []
    return vertices, faces
