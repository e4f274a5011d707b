"""Equal, explained, unexplained: what each needs, on pixels whose story is known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import whitted_reference
from whitted_reference import Scene
from whitted_validation import bounds
from whitted_validation.alternatives import Alternatives
from whitted_validation.validation import Here
from whitted_validation.verdict import Status, judge

SENSOR = """<sensor type="orthographic"><transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0"
  up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/>
  <rfilter type="box"/></film></sensor><emitter type="constant"><rgb name="radiance" value="0.25, 0.5, 0.75"/></emitter>
  <emitter type="directional" id="sun"><vector name="direction" value="0, 0, -1"/>
  <rgb name="irradiance" value="1"/></emitter>"""


@pytest.fixture
def scene(tmp_path: Path) -> Callable[[str], Scene]:
    """Load a scene around shapes, seen from +z by parallel rays a quarter apart, the first at x = 0.875."""

    def make(shapes: str) -> Scene:
        file = tmp_path / "scene.xml"
        file.write_text(f'<scene version="3.0.0"><integrator type="whitted"/>{SENSOR}{shapes}</scene>')
        return whitted_reference.load(file)

    return make


# Its right edge lies exactly on the rays of a column.
PLATE = """<shape type="rectangle" id="plate"><transform name="to_world"><scale x="0.375" y="3"/></transform>
  <bsdf type="diffuse"/></shape>"""


def edge_of(picture: np.ndarray) -> np.ndarray:
    """Find pixels of the first row that differ from the next."""
    return np.flatnonzero((picture[0, 1:] != picture[0, :-1]).any(axis=1))


def test_a_ray_along_an_edge_may_see_either_side(scene: Callable[[str], Scene]) -> None:
    described = scene(PLATE)
    known = bounds.measure(described, Here())
    columns = [x for x in range(8) if len(Alternatives(described).of_pixel(x, 3)[0]) > 1]
    assert len(columns) == 2  # the left and the right edge
    sky = np.array((0.25, 0.5, 0.75))
    picture = known.colour.copy()
    picture[3, columns[0]] = sky
    judgement = judge(described, known, picture, Here())
    assert judgement.good
    assert judgement.count(Status.EXPLAINED) == 1
    (difference,) = judgement.differences
    assert difference.reasons == ("rectangle edge of `plate`, bounce 0",)


def test_near_an_edge_no_third_colour_is_excused(scene: Callable[[str], Scene]) -> None:
    described = scene(PLATE)
    known = bounds.measure(described, Here())
    column = next(x for x in range(8) if len(Alternatives(described).of_pixel(x, 3)[0]) > 1)
    picture = known.colour.copy()
    picture[3, column] = 0.5 * (picture[3, column] + (0.25, 0.5, 0.75))
    assert judge(described, known, picture, Here()).count(Status.UNEXPLAINED) == 1


def test_away_from_edges_the_other_colour_is_no_excuse(scene: Callable[[str], Scene]) -> None:
    described = scene(PLATE)
    known = bounds.measure(described, Here())
    picture = known.colour.copy()
    picture[3, 0] = picture[3, 4]
    assert (picture[3, 0] != known.colour[3, 0]).any()
    assert judge(described, known, picture, Here()).count(Status.UNEXPLAINED) == 1


def test_a_pixel_is_equal_up_to_its_bound_and_no_further(scene: Callable[[str], Scene]) -> None:
    described = scene(PLATE)
    known = bounds.measure(described, Here())
    assert (known.bound[3, 4] > 0).all()
    for factor, good in ((1.0 - 1e-6, True), (1.0 + 1e-6, False)):
        picture = known.colour.copy()
        picture[3, 4] += factor * known.bound[3, 4]
        assert judge(described, known, picture, Here()).good == good


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_is_unexplained(scene: Callable[[str], Scene], value: float) -> None:
    described = scene(PLATE)
    known = bounds.measure(described, Here())
    picture = known.colour.copy()
    picture[0, 0, 0] = value
    assert judge(described, known, picture, Here()).count(Status.UNEXPLAINED) == 1


def test_a_picture_of_another_size_is_refused(scene: Callable[[str], Scene]) -> None:
    described = scene(PLATE)
    known = bounds.measure(described, Here())
    with pytest.raises(ValueError, match="shape"):
        judge(described, known, known.colour[1:], Here())


def test_an_empty_scene_has_one_colour_and_no_alternatives(scene: Callable[[str], Scene]) -> None:
    described = scene("")
    found, complete = Alternatives(described).of_pixel(0, 0)
    assert (len(found), complete) == (1, True)
    assert found[0].colour == (0.25, 0.5, 0.75)


def test_bounds_come_back_from_the_cache_unchanged(scene: Callable[[str], Scene], tmp_path: Path) -> None:
    described = scene(PLATE)
    first = bounds.measure(described, Here(), cache=tmp_path / "cache")
    again = bounds.measure(described, Here(), cache=tmp_path / "cache")
    assert len(list((tmp_path / "cache").iterdir())) == 1
    for name in vars(first):
        assert (getattr(first, name) == getattr(again, name)).all()


def test_samples_of_a_pixel_are_turned_one_by_one(scene: Callable[[str], Scene]) -> None:
    """With 2 x 2 samples a quarter of a pixel is seen otherwise: four samples, each with its own edge."""
    described = scene(PLATE.replace("0.375", "0.4375"))
    known = bounds.measure(described, Here(), grid=2)
    found = [Alternatives(described).of_pixel(x, 3, 2)[0] for x in range(8)]
    assert max(map(len, found)) == 4  # two of the four samples lie on an edge
    for x, alternatives in enumerate(found):
        assert np.allclose(alternatives[0].colour, known.colour[3, x], rtol=0, atol=2.0**-52)
