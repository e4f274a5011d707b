"""How fast is the tracer here? Ask `python -m whitted_reference.speed`.

Machines differ, so besides pixels and rays per second it prints their share of a plain loop: how many
rounds of ten lines of float arithmetic (`plain_loop`) the same machine does in the time of one pixel.
"""

from __future__ import annotations

import math
import struct
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from whitted_reference.scene_xml import load
from whitted_reference.trace import Tracer

REPEATS = 5

_SENSOR = """<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world">
  <lookat origin="0,3,9" target="0,0.7,0" up="0,1,0"/></transform><film type="hdrfilm">
  <integer name="width" value="{0}"/><integer name="height" value="{0}"/><rfilter type="box"/></film></sensor>"""
_LIGHTS = """<emitter type="point"><point name="position" value="4,6,5"/><float name="intensity" value="60"/></emitter>
  <emitter type="directional"><vector name="direction" value="1,-2,-0.5"/></emitter>"""
_FLOOR = """<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="20"/>
  </transform><bsdf type="blinnphong"/></shape>"""


def plain_loop(rounds: int) -> float:
    """Do ten lines of float arithmetic, over and over."""
    x, y, z = 0.1, 0.2, 0.3
    for _ in range(rounds):
        a = x * y - z * 0.5
        b = y * z - x * 0.5
        c = z * x - y * 0.5
        s = a * a + b * b + c * c + 1.0
        if s > 4.0:
            s = 4.0
        x = a / s + 0.1
        y = b / s + 0.2
        z = c / s + 0.3
    return x + y + z


def six_balls() -> str:
    """Six balls and a plane under two lights."""
    balls = "".join(
        f"""<shape type="sphere"><point name="center" value="{x},{r},{z}"/><float name="radius" value="{r}"/>
        <bsdf type="blinnphong"><float name="specular_reflectance" value="0.4"/></bsdf></shape>"""
        for x, z, r in [(-2.2, 0, 1), (0, 0, 1), (2.2, 0, 1), (-1, 2, 0.5), (1, 2, 0.5), (0, 3, 0.3)]
    )
    return balls + _FLOOR + _LIGHTS


def ball_mesh(path: Path, turns: int = 100, rings: int = 51) -> int:
    """Write a bumpy ball of 2 turns (rings - 1) triangles as a binary PLY file; return how many."""
    rows = []
    for i in range(rings + 1):
        theta = math.pi * i / rings
        for j in range(turns):
            phi = 2.0 * math.pi * j / turns
            r = 1.5 + 0.1 * math.sin(8.0 * theta) * math.cos(8.0 * phi)
            flat = r * math.sin(theta)
            rows.append((flat * math.cos(phi), 1.6 + r * math.cos(theta), -flat * math.sin(phi)))
    faces = []
    for i in range(rings):
        for j in range(turns):
            a, b = i * turns + j, i * turns + (j + 1) % turns
            c, d = a + turns, b + turns
            faces += [(a, c, d)] if i < rings - 1 else []
            faces += [(a, d, b)] if i > 0 else []
    head = f"""ply\nformat binary_little_endian 1.0\nelement vertex {len(rows)}\nproperty float x\nproperty float y
property float z\nelement face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"""
    body = b"".join(struct.pack("<3f", *row) for row in rows)
    path.write_bytes(head.encode() + body + b"".join(struct.pack("<B3i", 3, *face) for face in faces))
    return len(faces)


class _Counting(Tracer):
    """Counts rays."""

    rays = 0

    def first_hit(self, *arguments):  # type: ignore[no-untyped-def]
        """Count, and do as the tracer."""
        self.rays += 1
        return super().first_hit(*arguments)

    def blocker(self, *arguments):  # type: ignore[no-untyped-def]
        """Count, and do as the tracer."""
        self.rays += 1
        return super().blocker(*arguments)


def _draw(tracer: Tracer, size: int) -> None:
    for y in range(size):
        for x in range(size):
            tracer.pixel(x, y)


def _seconds(action, *arguments) -> float:  # type: ignore[no-untyped-def]
    """Return the median time of some repeats, after one to warm up."""
    times = []
    for _ in range(REPEATS + 1):
        start = time.perf_counter()
        action(*arguments)
        times.append(time.perf_counter() - start)
    return median(times[1:])


def main() -> None:
    """Measure and print."""
    rounds = 200_000
    one_round = _seconds(plain_loop, rounds) / rounds
    print(f"Python {sys.version.split()[0]}: {1.0 / one_round:,.0f} rounds of the plain loop per second")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scene.xml"
        faces = ball_mesh(Path(folder) / "ball.ply")
        mesh = '<shape type="ply"><string name="filename" value="ball.ply"/></shape>' + _FLOOR + _LIGHTS
        for name, body, size in [("six balls and a plane", six_balls(), 96), (f"{faces:,} triangles", mesh, 64)]:
            path.write_text(f'<scene version="3.0.0"><integrator type="whitted"/>{_SENSOR.format(size)}{body}</scene>')
            scene = load(path)
            start = time.perf_counter()
            tracer = Tracer(scene)
            built = time.perf_counter() - start
            counting = _Counting(scene)
            _draw(counting, size)
            seconds = _seconds(_draw, tracer, size)
            pixels = size * size
            print(
                f"{name}, two lights: {pixels / seconds:,.0f} pixels/s, {counting.rays / seconds:,.0f} rays/s; "
                f"one pixel takes {seconds / pixels / one_round:.0f} rounds; prepared in {built:.2f} s"
            )


if __name__ == "__main__":
    main()
