"""Whole pictures: workers, progress, sizes, ties, recursion."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import pytest

from whitted_reference import SceneError, image, render

BODY = """<shape type="sphere" id="ball"><transform name="to_world"><translate z="4"/></transform></shape>
  <emitter type="point"><point name="position" value="2,2,0"/><float name="intensity" value="40"/></emitter>
  <emitter type="constant"/>"""
SENSOR = """<sensor type="perspective"><float name="fov" value="60"/><film type="hdrfilm">
  <integer name="width" value="{}"/><integer name="height" value="{}"/><rfilter type="box"/>
  </film></sensor>"""


def test_any_executor_draws_the_same_picture(load_scene):
    scene = load_scene(BODY, sensor=SENSOR.format(13, 9))
    here = render(scene)
    with ThreadPoolExecutor(3) as threads:
        assert render(scene, executor=threads) == here
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        assert render(scene, executor=processes) == here


def test_large_pictures_go_to_processes_by_themselves(load_scene, monkeypatch):
    scene = load_scene(BODY, sensor=SENSOR.format(13, 9))
    here = render(scene)
    monkeypatch.setattr(image, "WORTH_PROCESSES", 1)
    assert render(scene) == here


def test_progress_counts_rows_up_to_all(load_scene):
    scene = load_scene(BODY, sensor=SENSOR.format(4, 5))
    seen: list[tuple[int, int]] = []
    render(scene, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(i + 1, 5) for i in range(5)]
    seen.clear()
    with ThreadPoolExecutor(2) as threads:
        render(scene, executor=threads, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(i + 1, 5) for i in range(5)]


def test_size_replaces_the_film(load_scene):
    scene = load_scene(BODY, sensor=SENSOR.format(4, 5))
    picture = render(scene, size=(6, 3))
    assert (picture.width, picture.height, len(picture.rows), len(picture.rows[0])) == (6, 3, 3, 18)


def test_ties_are_listed_by_pixel(load_scene):
    twins = "".join(
        f"""<shape type="rectangle" id="{name}"><transform name="to_world"><scale x="0.5" y="9" z="-1"/>
        <translate x="0.5" z="2"/></transform><bsdf type="diffuse"/></shape>"""
        for name in ("one", "other")
    )
    picture = render(load_scene(twins, sensor=SENSOR.format(4, 1)))
    assert picture.ties == {(0, 0): ("one", "other"), (1, 0): ("one", "other")}


def test_missing_sensor_is_refused(load_scene):
    scene = load_scene(BODY, sensor=SENSOR.format(4, 5))
    with pytest.raises(SceneError, match="sensor 1 asked for; the scene has 1"):
        render(scene, sensor=1)


def test_unlimited_depth_fits_into_the_recursion_limit_and_endless_does_not(load_scene):
    hall = """<shape type="sphere"><transform name="to_world"><scale value="9"/></transform>
      <boolean name="flip_normals" value="true"/><bsdf type="conductor"/></shape>"""
    sensor = SENSOR.format(2, 1)
    assert render(load_scene(hall, '<integer name="max_depth" value="-1"/>', sensor)).pixel(0, 0) == (0, 0, 0)
    with pytest.raises(SceneError, match="10000 bounces; allowed: fewer"):
        render(load_scene(hall, '<integer name="max_depth" value="1000000"/>', sensor))
