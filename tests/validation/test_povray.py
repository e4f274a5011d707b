"""POV-Ray as a peer: it draws the same picture, or the scene is refused."""

from __future__ import annotations

import dataclasses
import os
import re
import shutil
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import whitted_reference
from whitted_reference import scene
from whitted_reference.image import resized
from whitted_reference.transforms import Affine
from whitted_validation import scene_files
from whitted_validation.benchmark import error, error_schedule, error_targets, povray, scenes, speed, speed_targets
from whitted_validation.benchmark.error_curves import Point
from whitted_validation.benchmark.error_povray import METHODS
from whitted_validation.benchmark.povray import STEP, Mode, PovRay, antialiased
from whitted_validation.benchmark.povray_scene import LARGEST, source
from whitted_validation.benchmark.speed_configurations import POVRAY, Unavailable
from whitted_validation.benchmark.speed_pairs import Comparison, Interval
from whitted_validation.benchmark.speed_worker import Failed, Sample
from whitted_validation.refusal import Refusal

needs_povray = pytest.mark.skipif(shutil.which(povray.PROGRAM) is None, reason="POV-Ray is not installed")

U = 2.0**-24
"""POV-Ray's colours are in single precision."""

SCENE = """<scene version="3.0.0">
<integrator type="whitted">
  <integer name="max_depth" value="6"/><rgb name="ambient" value="0.2, 0.1, 0.3"/>
  <string name="falloff" value="none"/></integrator>
<sensor type="perspective"><float name="fov" value="50"/>
  <transform name="to_world"><lookat origin="1,4,8" target="0,1,0" up="0,1,0"/></transform>
  <film type="hdrfilm"><integer name="width" value="64"/><integer name="height" value="48"/><rfilter type="box"/></film>
</sensor>
<emitter type="constant"><rgb name="radiance" value="0.1, 0.15, 0.2"/></emitter>
<emitter type="point" id="lamp"><point name="position" value="3,6,4"/><rgb name="intensity" value="0.5,0.4,0.3"/>
</emitter>
<emitter type="directional"><vector name="direction" value="1,-2,-1"/><rgb name="irradiance" value="0.2, 0.3, 0.4"/>
</emitter>
<shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="6"/></transform>
  <bsdf type="blinnphong"><rgb name="mirror_reflectance" value="0.2, 0.3, 0.1"/></bsdf></shape>
<shape type="sphere" id="coloured"><point name="center" value="-2,1,0"/><bsdf type="blinnphong">
  <rgb name="diffuse_reflectance" value="0.4, 0, 0.2"/><rgb name="specular_reflectance" value="0.3, 0.5, 0.1"/>
  <rgb name="mirror_reflectance" value="0.3, 0.2, 0.4"/><rgb name="ambient_reflectance" value="0.1, 0.6, 0.2"/>
  <float name="exponent" value="37"/></bsdf></shape>
<shape type="sphere" id="ball"><point name="center" value="0.5,0.8,1"/><float name="radius" value="0.8"/>
  <bsdf type="blinnphong" id="paint"><rgb name="diffuse_reflectance" value="0.4, 0.1, 0.2"/>
  <float name="specular_reflectance" value="0.3"/><rgb name="ambient_reflectance" value="0.1, 0.6, 0.2"/></bsdf></shape>
<shape type="sphere" id="inside_out"><point name="center" value="2,0.5,2.5"/><float name="radius" value="0.5"/>
  <boolean name="flip_normals" value="true"/><bsdf type="diffuse"/></shape>
<shape type="sphere" id="shading"><point name="center" value="-5,10,5"/><float name="radius" value="0.7"/></shape>
<shape type="rectangle" id="two"><transform name="to_world"><rotate y="1" angle="30"/><translate x="3" y="1" z="-1"/>
  </transform><bsdf type="twosided">
  <bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.1, 0.7, 0.1"/></bsdf>
  <bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.7, 0.1, 0.1"/>
    <rgb name="specular_reflectance" value="0.3, 0.5, 0.1"/></bsdf></bsdf></shape>
<shape type="rectangle" id="back"><transform name="to_world"><rotate y="1" angle="170"/>
  <translate y="1.5" z="-3"/></transform><bsdf type="blinnphong"/></shape>
<shape type="rectangle" id="front"><transform name="to_world"><rotate y="1" angle="-20"/>
  <translate x="-3" y="2.5" z="-3"/></transform><bsdf type="conductor">
  <string name="material" value="none"/><rgb name="specular_reflectance" value="0.9, 0.7, 0.3"/></bsdf></shape>
<shape type="polygon" id="star"><string name="vertices"
  value="0,0,0 2,0,0 1,0.5,0 2,2,0 0,2,0; 0.5,0.8,0 1,0.8,0 1,1.4,0"/>
  <transform name="to_world"><rotate y="1" angle="40"/><translate x="-4" y="0.5" z="1"/></transform>
  <bsdf type="twosided"><bsdf type="blinnphong"/></bsdf></shape>
<!-- more -->
</scene>
"""
"""Every surface that can be said: grey and coloured highlights, ambient light on black, both sides and one."""


FALLOFF = '"falloff" value="none"', '"falloff" value="inverse_square"'


class _Listening(whitted_reference.Tracer):
    """Tells where the normals n and n_g of a smooth mesh disagree on a side: POV-Ray knows n alone."""

    disagreed = False

    def positive(self, kind: str, x: Any, y: Any, light: Any = None) -> bool:
        """Listen, and decide as the tracer."""
        self.disagreed |= (x > 0) != (y > 0)
        return super().positive(kind, x, y, light)


def expected(description: scene.Scene) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Draw a scene with the reference, but without the last ray, which POV-Ray does not follow to the sky.

    What is lit comes from rays of all depths, under a black sky; the sky itself from rays of all depths but the last.
    """
    film, depth = description.sensors[0].film, description.settings.max_depth
    total: Any = 0
    for black, max_depth, sign in ((True, depth, 1), (False, depth - 1, 1), (True, depth - 1, -1)):
        tracer = _Listening(
            dataclasses.replace(
                description,
                settings=dataclasses.replace(description.settings, max_depth=max_depth),
                background=(0.0, 0.0, 0.0) if black else description.background,
            )
        )
        picture = np.empty((film.height, film.width, 3))
        known = np.empty((film.height, film.width), bool)
        for y in range(film.height):
            for x in range(film.width):
                tracer.disagreed = False
                picture[y, x] = tracer.pixel(x, y)
                known[y, x] = not tracer.disagreed
        total = total + sign * picture
    return total, known


def limit(description: scene.Scene, drawn: povray.Drawn, picture: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bound the difference of two pictures.

    A value of the file is off by half a step. Before, it is a sum of positive terms in single precision; a ray adds
    to it by 24 roundings, ten a light with two of them, and four for ambient light and the mirror. A normal of a mesh,
    rounded too, turns a cosine by up to 2 u, and its power, which is known to 1, by the exponent times that.
    """
    exponents = [
        look.exponent[0]
        for shape in description.shapes
        if isinstance(shape, scene.Mesh)
        for look in [shape.look.material]
        if isinstance(look, scene.BlinnPhong) and isinstance(look.exponent, tuple)
    ]
    roundings = 24 * description.settings.max_depth + 2 * max(exponents, default=0.0)
    return STEP / 2 / drawn.exposure + roundings * U * picture


def off(description: scene.Scene, folder: Path) -> list[tuple[int, int]]:
    """Have POV-Ray draw a scene, and list the pixels (x, y) outside the limit."""
    drawn = PovRay(description, folder).draw()
    picture, known = expected(description)
    wrong = (np.abs(drawn.pixels - picture) > limit(description, drawn, picture)).any(axis=2) & known
    assert known.mean() > 0.9  # or little is judged
    return [(int(x), int(y)) for y, x in np.argwhere(wrong)]


def bench(kind: str, size: int, folder: Path) -> scene.Scene:
    return whitted_reference.load(scenes.write(kind, folder), {"size": str(size)})


def written(folder: Path, text: str = SCENE, name: str = "scene") -> Path:
    file = folder / f"{name}.xml"
    file.write_text(text)
    return file


# ---------------------------------------------------------------------------------------------- the picture
@needs_povray
@pytest.mark.parametrize(("kind", "size"), [("a", 40), ("b", 40), pytest.param("c", 16, marks=pytest.mark.slow)])
def test_the_scenes_of_the_benchmark_come_out_the_same(kind: str, size: int, tmp_path: Path) -> None:
    assert off(bench(kind, size, tmp_path), tmp_path) == []


@needs_povray
def test_every_material_and_side_that_can_be_said_comes_out_the_same(tmp_path: Path) -> None:
    assert off(whitted_reference.load(written(tmp_path)), tmp_path) == []


@needs_povray
@pytest.mark.parametrize("name", ["mesh", "mirror", "polygons", "smooth_mesh"])
def test_shipped_scenes_come_out_the_same(name: str, tmp_path: Path) -> None:
    assert off(resized(whitted_reference.load(scene_files.find(name)), 32, 24), tmp_path) == []


def resized_world(description: scene.Scene, factor: float) -> scene.Scene:
    """Multiply all lengths of a scene of balls and rectangles; a power of two changes no digit."""

    def times(v: tuple[float, ...], by: float = factor) -> Any:
        return tuple(by * x for x in v)

    def placed(m: Affine, lengths: float) -> Affine:
        rows: Any = tuple((*times(row[:3], lengths), factor * row[3]) for row in m.matrix)
        normal: Any = tuple(times(row, 1 / lengths) for row in m.normal)
        return Affine(rows, normal)

    shapes: list[scene.Shape] = []
    for shape in description.shapes:
        assert isinstance(shape, scene.Sphere | scene.Rectangle)
        to_world = placed(shape.to_world, factor)
        if isinstance(shape, scene.Sphere):
            ball = dataclasses.replace(shape, centre=times(shape.centre), radius=factor * shape.radius)
            shapes.append(dataclasses.replace(ball, to_world=to_world))
        else:
            shapes.append(dataclasses.replace(shape, to_world=to_world))
    lights = [
        dataclasses.replace(each, position=times(each.position), intensity=times(each.intensity, factor**2))
        if isinstance(each, scene.PointLight)
        else each
        for each in description.lights
    ]
    (sensor,) = description.sensors
    sensor = dataclasses.replace(
        sensor, to_world=placed(sensor.to_world, 1.0), near=factor * sensor.near, far=factor * sensor.far
    )
    return dataclasses.replace(description, shapes=tuple(shapes), lights=tuple(lights), sensors=(sensor,))


@needs_povray
@pytest.mark.parametrize("factor", [2.0**-12, 2.0**12])
def test_a_scene_of_another_size_looks_the_same(factor: float, tmp_path: Path) -> None:
    # POV-Ray's own constants, 1e-3 and 1e-4, would be large beside its contacts and shadows.
    assert off(resized_world(bench("a", 40, tmp_path), factor), tmp_path) == []


@needs_povray
def test_a_picture_brighter_than_the_file_is_drawn_darker(tmp_path: Path) -> None:
    bright = SCENE.replace('value="0.5,0.4,0.3"', 'value="50,40,30"')
    drawn = PovRay(whitted_reference.load(written(tmp_path, bright)), tmp_path).draw()
    assert drawn.pixels.max() > 8
    assert drawn.pixels.max() * drawn.exposure < 1


@needs_povray
def test_antialiasing_comes_closer_to_the_mean_over_a_pixel(tmp_path: Path) -> None:
    description = bench("a", 16, tmp_path)
    truth = np.array(whitted_reference.render(description, grid=8).rows).reshape(16, 16, 3)
    prepared = PovRay(description, tmp_path)
    modes = povray.ONE_SAMPLE, antialiased(1, 0.03, 3), antialiased(2, 0.03, 3), antialiased(2, 0.03, 4)
    drawn = [prepared.draw(options) for options in modes]
    errors = [float(np.sqrt(np.mean((each.pixels - truth) ** 2))) for each in drawn]
    assert errors == sorted(set(errors), reverse=True)
    assert drawn[0].rays + drawn[0].shadow_rays < min(each.rays + each.shadow_rays for each in drawn[1:])


# ------------------------------------------------------------------------------------------------ the counts
@needs_povray
def test_rays_are_counted_as_the_plugin_counts_them(tmp_path: Path, llvm_ad_rgb: str) -> None:
    import mitsuba as mi

    # No ray of this picture comes to the ninth bounce, which would be counted by the plugin alone.
    loaded: Any = mi.load_file(str(scenes.write("b", tmp_path)), optimize=False, size="64")
    ours = loaded.integrator().count_rays(loaded)
    mode = Mode(PovRay(bench("b", 64, tmp_path), tmp_path))
    assert mode.drawn.rays == ours["camera"] + ours["mirror"]
    assert mode.drawn.shadow_rays == ours["shadow"]
    assert all(0 <= seconds < mode.drawn.whole for seconds in mode.sample(2)[:1])


# ----------------------------------------------------------------------------------------------- the program
def test_without_the_program_it_is_unavailable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert povray.version() is None
    with pytest.raises(Unavailable, match="POV-Ray is not installed"):
        PovRay(bench("d", 8, tmp_path), tmp_path)


def program(folder: Path, monkeypatch: pytest.MonkeyPatch, lines: str) -> None:
    """Put a program of our own in the place of POV-Ray."""
    file = folder / povray.PROGRAM
    file.write_text(f"#!/bin/sh\n{lines}\n")
    file.chmod(file.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


@pytest.mark.parametrize(
    ("lines", "words"),
    [
        (r"printf 'Fatal error: \033[31m\n'; exit 1", "ended with code 1: Fatal error"),
        ("kill -9 $$", "ended with code -9"),
        ("while :; do :; done", "no picture in 1 s"),
        ("exit 0", "no PPM of 16 bits"),
        ("echo P6 > picture.ppm", "no PPM of 16 bits"),
        (r"printf 'P6 8 8 65535\n%384s' '' > picture.ppm", "does not say how long its phase `Trace` took"),
        (r"printf 'P6 8 8 65535\n%3s' '' > picture.ppm", "is cut off"),
    ],
)
def test_whatever_the_program_does_is_told_in_a_line(
    lines: str, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program(tmp_path, monkeypatch, lines)
    monkeypatch.setattr(povray, "PATIENCE", 1.0)
    with pytest.raises(Failed, match=words) as failure:
        PovRay(bench("d", 8, tmp_path), tmp_path).draw()
    assert str(failure.value).isprintable()


@needs_povray
@pytest.mark.parametrize("where", ["POVINI", "HOME"])
def test_settings_of_the_person_make_no_difference_and_nothing_is_left(
    where: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, here, folder = (tmp_path / name for name in ("home", "here", "folder"))
    for each in (home / ".povray" / "3.7", here, folder):
        each.mkdir(parents=True)
    prepared = PovRay(bench("d", 8, folder), folder)
    plain = prepared.draw().pixels
    settings = home / ".povray" / "3.7" / "povray.ini"
    settings.write_text("End_Row=2\n")
    monkeypatch.setenv(where, str(settings if where == "POVINI" else home))
    monkeypatch.chdir(here)
    before = sorted(tmp_path.rglob("*"))
    assert np.array_equal(prepared.draw().pixels, plain)
    assert sorted(tmp_path.rglob("*")) == before


# ----------------------------------------------------------------------------------------------- the targets
def interval(x: float) -> Interval:
    return Interval(x, x, x, x, x)


def comparison(cpu: float, wall: float) -> Comparison:
    return Comparison(interval(cpu), interval(wall), Sample(1, 1), Sample(1, 1), (1, 1), 9)


@pytest.mark.parametrize(("wall", "verdict"), [(26.0, "met"), (24.0, "not met")])
def test_the_time_to_trace_is_judged_by_the_clock_on_the_wall(wall: float, verdict: str) -> None:
    row = speed.Row(POVRAY, "", comparison(1000, wall))
    results = speed.Results(scenes={"b": speed.Measured("", 64, rows=[row])})
    found = {each.target: each.verdict for each in speed_targets.outcomes(results) if "POV-Ray" in each.target}
    assert [found[target] for target in sorted(found)] == ["not measured", verdict, "not measured"]  # a, b, c


@pytest.mark.parametrize(("cheaper", "verdict"), [(31.0, "met"), (29.0, "not met")])
def test_its_best_mode_is_judged_at_equal_error(cheaper: float, verdict: str) -> None:
    # One mode takes 100 times as long as ours, another so much: the better one counts, wherever both go.
    def curve(way: str, times: float, errors: tuple[float, ...]) -> list[Point]:
        return [Point(way, 1, e, e, e, rays=1.0, cost=comparison(1, times / e)) for e in errors]

    points = [
        *curve(error.TARGET, 1, (0.5, 0.25, 0.01)),
        *curve(f"{METHODS[0]}, depth 3", 100, (1.0, 0.1)),
        *curve(f"{METHODS[1]}, depth 3", cheaper, (1.0, 0.1)),
    ]
    curves = error.Curves("", 0, error_schedule.FULL.size, 0.0, 0.0, 1, 0, points)
    found = [each for each in error_targets.outcomes(error.Results({"a": curves})) if "POV-Ray" in each.target]
    assert [each.verdict for each in found] == [verdict, "not measured", "not measured"]
    assert found[0].measured == f"{cheaper:.3g} at 0.5, {cheaper:.3g} at 0.25"


# ---------------------------------------------------------------------------------------------- the refusals
def refused(text: str, folder: Path) -> str:
    with pytest.raises(Refusal) as refusal:
        source(whitted_reference.load(written(folder, text)))
    return str(refusal.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('name="max_depth" value="6"', 'name="max_depth" value="-1"', "max_depth -1; allowed: 2 to 257"),
        ('name="max_depth" value="6"', 'name="max_depth" value="1"', "max_depth 1; allowed: 2 to 257"),
        ('name="max_depth" value="6"', 'name="max_depth" value="258"', "max_depth 258; allowed: 2 to 257"),
        ("</integrator>", '<float name="epsilon" value="0.001"/></integrator>', "epsilon"),
        ("</integrator>", '<boolean name="enable_shadows" value="false"/></integrator>', "shadows"),
        ('"perspective"><float name="fov" value="50"/>', '"orthographic">', "orthographic"),
        ("</sensor>", '<float name="principal_point_offset_x" value="0.1"/></sensor>', "principal point"),
        ("</film>", '<integer name="crop_width" value="8"/></film>', "a part of the film"),
        ("</sensor>", '<float name="near_clip" value="6"/></sensor>', "near_clip 6 or far_clip 10000 .* of `floor`"),
        ("</sensor>", '<float name="far_clip" value="9"/></sensor>', "near_clip 0.01 or far_clip 9 .* of `floor`"),
        ('type="point" id="lamp"><point name="position" value="3,6,4"/>', 'type="spot" id="lamp">', "spot `lamp`"),
        ('value="0.5,0.4,0.3"', 'value="3e38,0,0"', "light of .*; allowed: up to 3.4e"),
        ("<!-- more -->", '<shape type="disk" id="pond"/>', "disk `pond`"),
        ("<!-- more -->", '<shape type="cylinder" id="tube"/>', "cylinder `tube`"),
        ("<!-- more -->", '<shape type="sphere" id="sun"><emitter type="area"/></shape>', "lamp .* `sun`"),
        ('<bsdf type="twosided"><bsdf type="blinnphong"/></bsdf>', '<bsdf type="diffuse"/>', "polygon `star`"),
        ('name="exponent" value="37"', 'name="exponent" value="0"', "exponent 0 of `coloured`"),
        (
            '<rgb name="diffuse_reflectance" value="0.4, 0.1, 0.2"/>',
            '<texture name="diffuse_reflectance" type="checkerboard"/>',
            "textures of `ball`",
        ),
    ],
)
def test_what_povray_cannot_say_exactly_is_refused_by_name(old: str, new: str, words: str, tmp_path: Path) -> None:
    assert old in SCENE
    text = SCENE.replace(*FALLOFF) if "3e38" in new else SCENE
    text = text.replace(old, new, 1)
    message = refused(text, tmp_path)
    assert message.startswith("scene: POV-Ray cannot draw ")
    assert re.search(words, message), message


def test_no_name_of_the_scene_gets_into_povrays_language(tmp_path: Path) -> None:
    hostile = "} #declare X = 1; /* &quot; //"
    said = source(whitted_reference.load(written(tmp_path, SCENE.replace('id="ball"', f'id="{hostile}"'))))
    assert said == source(whitted_reference.load(written(tmp_path)))


def test_numbers_are_written_as_they_are(tmp_path: Path) -> None:
    # Lengths are multiplied by a power of two, so that every one can be had back exactly.
    loaded = whitted_reference.load(written(tmp_path))
    (ball,) = [s for s in loaded.shapes if isinstance(s, scene.Sphere) and s.look.id == "ball"]
    radii = [float(line.split()[2]) for line in source(loaded).splitlines() if line.startswith("sphere")]
    assert any(np.log2(radius / ball.radius) % 1 == 0 for radius in radii)
    assert float(np.finfo(np.float32).max) == LARGEST
