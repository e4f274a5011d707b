"""One pixel explained: the values are those of the picture, the words are true, the drawing holds what it should."""

from __future__ import annotations

import dataclasses
import json
import math
import random
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import whitted_reference
from whitted_reference.float32 import fma
from whitted_validation import explain, scene_files
from whitted_validation.bounds import Bounds
from whitted_validation.cli import run
from whitted_validation.explanation import report
from whitted_validation.explanation.comparison import (
    Pair,
    growth,
    paired,
    partings,
    values,
)
from whitted_validation.explanation.explanation import Explainer, Explanation, cut_out
from whitted_validation.explanation.terminal import WIDTH as COLUMNS
from whitted_validation.printable import LONGEST_NAME, named
from whitted_validation.refusal import Refusal
from whitted_validation.request import Request
from whitted_validation.validation import validate
from whitted_validation.verdict import Difference, Judgement, Status

FLOOR = '<shape type="rectangle" id="floor"><transform name="to_world"><scale value="9"/></transform>{paint}</shape>'
PAINT = '<bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.5, 0.25, 0.125"/>{more}</bsdf>'
LAMP = (
    '<emitter type="point" id="lamp"><point name="position" value="{at}"/><float name="intensity" value="9"/></emitter>'
)
SPOT = """<emitter type="spot" id="spot"><transform name="to_world">
  <lookat origin="0, 0, 3" target="8, 0, 3" up="0, 0, 1"/></transform><float name="intensity" value="9"/></emitter>"""
BALL = '<shape type="sphere" id="ball"><point name="center" value="0, 2, 2"/><float name="radius" value="0.5"/></shape>'


def scene(folder: Path, body: str, integrator: str = "") -> Path:
    """Write a scene of 5 x 5 pixels that looks down from (0, 0, 4) on the point (0, 0, 0)."""
    file = folder / "small.xml"
    file.write_text(
        f"""<scene version="3.0.0"><integrator type="whitted">{integrator}</integrator>
        <sensor type="perspective"><float name="fov" value="20"/>
          <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
          <film type="hdrfilm"><integer name="width" value="5"/><integer name="height" value="5"/>
            <rfilter type="box"/></film></sensor>{body}</scene>""",
        encoding="utf-8",
    )
    return file


def floor(more: str = "") -> str:
    """Return a painted floor in z = 0."""
    return FLOOR.format(paint=PAINT.format(more=more))


def lamp(at: str = "0, 3, 3") -> str:
    """Return a lamp, by default to the side of the eye."""
    return LAMP.format(at=at)


def words(explanation: Explanation) -> str:
    """Return the answer to the first question."""
    return " ".join(explanation.answers[0][1])


# -------------------------------------------------------------------------------------------- the plugin
@pytest.mark.parametrize("name", ["whitted_1980", "hall_of_mirrors", "textured", "instances", "spot", "smooth_mesh"])
@pytest.mark.parametrize("spp", [1, 4])
def test_the_explained_colour_is_the_pixel_of_the_picture_bit_for_bit(llvm_ad_rgb: str, name: str, spp: int) -> None:
    loaded = mi.load_file(str(scene_files.find(name)), optimize=False, parallel=False)
    integrator = loaded.integrator()
    picture = np.array(integrator.render(loaded, spp=spp))
    where = random.Random(name)
    for _ in range(10):
        y, x = where.randrange(picture.shape[0]), where.randrange(picture.shape[1])
        seen = integrator.explain(loaded, x, y, spp=spp)
        assert np.array_equal(np.array(seen.colour, np.float32), picture[y, x]), (x, y)


def test_so_it_is_in_every_variant(any_variant: str) -> None:
    loaded = mi.load_file(str(scene_files.find("whitted_1980")), optimize=False, parallel=False)
    film = mi.traverse(loaded.sensors()[0].film())
    film["size"] = film["crop_size"] = (8, 8)
    film.update()
    loaded.sensors()[0].parameters_changed()
    for spp in (1, 9):
        picture = np.array(loaded.integrator().render(loaded, spp=spp))
        for y, x in np.ndindex(8, 8):
            seen = loaded.integrator().explain(loaded, x, y, spp=spp)
            assert np.array_equal(np.array(seen.colour, np.float32), picture[y, x]), (x, y)


def test_the_kernel_of_a_picture_is_the_same_before_and_after(llvm_ad_rgb: str) -> None:
    loaded = mi.load_file(str(scene_files.find("whitted_1980")), optimize=False, parallel=False)

    def kernels() -> set[str]:
        dr.kernel_history_clear()
        with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
            dr.eval(loaded.integrator().render(loaded, spp=1))
            return {kernel["hash"] for kernel in dr.kernel_history() if "hash" in kernel}

    kernels()  # the first picture also fills tables
    before = kernels()
    loaded.integrator().explain(loaded, 3, 3)
    assert kernels() == before
    assert before


def test_the_rays_of_the_plugin_add_up_to_its_colour(llvm_ad_rgb: str) -> None:
    loaded = mi.load_file(str(scene_files.find("hall_of_mirrors")), optimize=False, parallel=False)
    for x, y in [(256, 256), (250, 240), (262, 250)]:
        (sample,) = loaded.integrator().explain(loaded, x, y, spp=1).samples
        total = [0.0] * 3
        for ray in sample.rays:
            total = [fma(w, c, t) for w, c, t in zip(ray.throughput, ray.colour, total, strict=True)]
        assert tuple(total) == sample.colour
        assert len(sample.rays) > 5


def test_what_lights_add_is_part_of_what_the_ray_adds(llvm_ad_rgb: str) -> None:
    loaded = mi.load_file(str(scene_files.find("shadows")), optimize=False, parallel=False)
    (sample,) = loaded.integrator().explain(loaded, 200, 300, spp=1).samples
    (ray,) = sample.rays
    assert [light.blocked_by for light in ray.lights] == [None, None, "ball"]
    assert ray.emitted == (0.0, 0.0, 0.0)
    total = np.array(ray.ambient, np.float32)
    by_kind = [light.colour for light in ray.lights if math.isfinite(light.distance)]
    for colours in (by_kind, [light.colour for light in ray.lights if math.isinf(light.distance)]):
        total = total + sum(np.array(colour, np.float32) for colour in colours)  # as the kernel: kind after kind
    assert tuple(map(float, total)) == ray.colour


def test_a_pixel_outside_is_refused_by_the_integrator(llvm_ad_rgb: str) -> None:
    loaded = mi.load_file(str(scene_files.find("shadows")), optimize=False, parallel=False)
    with pytest.raises(Exception, match=r"pixel \(512, 0\) is not in the picture of 512 x 512 pixels"):
        loaded.integrator().explain(loaded, 512, 0)


# ----------------------------------------------------------------------------------------- the reference
@pytest.mark.parametrize("name", ["whitted_1980", "textured", "instances", "spot", "gold"])
def test_the_rays_of_the_reference_add_up_to_its_pixel_exactly(llvm_ad_rgb: str, name: str) -> None:
    tracer = whitted_reference.Tracer(whitted_reference.load(scene_files.find(name)))
    explainer = Explainer(Request(name, llvm_ad_rgb, {}, [], None, 0))
    where = random.Random(name)
    for _ in range(6):
        x, y = where.randrange(tracer.film.crop_width), where.randrange(tracer.film.crop_height)
        (sample,) = explainer.pixel(x, y).reference.samples
        back = (0.0, 0.0, 0.0)
        for ray in reversed(sample.rays):
            k_m = ray.k_m or (0.0, 0.0, 0.0)
            back = tuple(c + k * b for c, k, b in zip(ray.colour, k_m, back, strict=True))
        assert back == tracer.pixel(x, y) == sample.colour


def test_distances_count_from_the_eye_in_both(tmp_path: Path, llvm_ad_rgb: str) -> None:
    explanation = explain(scene(tmp_path, floor() + lamp()), 2, 2, variant=llvm_ad_rgb)
    (plugin,), (reference,) = (side.samples[0].rays for side in (explanation.plugin, explanation.reference))
    assert plugin.o == reference.o == (0.0, 0.0, 4.0)
    assert plugin.t == reference.t == 4.0


# --------------------------------------------------------------------------------------------- the words
@pytest.mark.parametrize(
    ("body", "integrator", "said"),
    [
        ("", "", "The ray meets nothing: there is no background, so this is black."),
        ('<emitter type="constant" id="sky"/>', "", "The ray meets nothing and sees the background."),
        (floor() + lamp(), "", "The ray meets `floor`. Lit by `lamp`. No ambient light."),
        (floor() + lamp() + BALL.replace("0, 2, 2", "0, 1, 1"), "", "In the shadow of `ball` from `lamp`."),
        (floor() + lamp("0, 3, -3"), "", "Facing away from `lamp`."),
        (floor() + SPOT, "", "Outside the light of `spot`."),
        (floor(), "", "There is no light that could shine on it."),
        (floor() + lamp(), '<integer name="max_depth" value="1"/>', "max_depth = 1 is the limit."),
        (floor() + lamp(), '<integer name="max_depth" value="0"/>', "max_depth = 0 lets nothing be seen here."),
        (
            floor().replace("<scale", '<rotate y="1" angle="180"/><scale') + lamp(),
            "",
            "The ray meets `floor` from behind, and a one-sided surface is black there.",
        ),
        (floor() + lamp("0, 3, -3"), '<float name="ambient" value="0.5"/>', "Ambient light only."),
        (
            floor('<float name="mirror_reflectance" value="0.5"/>') + lamp(),
            "",
            "Its mirror ray meets nothing: there is no background, so this is black.",
        ),
    ],
)
def test_why_a_pixel_is_dark_is_said_in_words(
    tmp_path: Path, llvm_ad_rgb: str, body: str, integrator: str, said: str
) -> None:
    explanation = explain(scene(tmp_path, body, integrator), 2, 2, variant=llvm_ad_rgb)
    assert said in words(explanation)
    black = not any(explanation.plugin.colour)
    assert (explanation.answers[0][0] == "Why is this pixel black?") is black
    assert explanation.status is Status.EQUAL
    assert explanation.answers[1][1][0].startswith("Yes")


def test_shares_of_a_chain_of_mirrors_make_up_the_whole(llvm_ad_rgb: str) -> None:
    said = explain("hall_of_mirrors", 256, 256, variant=llvm_ad_rgb).answers[0][1]
    shares = [float(part.rsplit(" ", 1)[1]) for line in said for part in line.split(" % of the colour")[:-1]]
    assert abs(sum(shares) - 100) <= len(shares) / 2  # each is rounded by half a percent at most
    assert any("27 more mirror rays meet `mirror_front` and `mirror_back`." in line for line in said)


def test_where_the_programs_part_is_said_in_words(tmp_path: Path, llvm_ad_rgb: str) -> None:
    file = scene(tmp_path, floor() + lamp() + BALL.replace("0, 2, 2", "0, 1, 1"))
    explainer = Explainer(Request(str(file), llvm_ad_rgb, {}, [], None, 0))
    integrator = explainer._loaded.integrator
    integrator.settings = dataclasses.replace(integrator.settings, enable_shadows=False)
    explanation = explainer.pixel(2, 2)
    assert explanation.status is Status.UNEXPLAINED
    said = explanation.answers[1][1]
    assert said[0].startswith("No. They differ by 0.")
    assert said[-1] == (
        "They part at ray 0 at `floor`: for the plugin `lamp` shines here, for the reference it is blocked."
    )
    assert "light `lamp`: plugin: shines here; reference: is blocked" in str(explanation)
    for kind in ("lit", "blocked"):  # both ways are drawn, from above and from the side
        assert explanation.drawing().count(f'class="shadow {kind}"') == 2


def test_after_the_parting_each_program_goes_alone(tmp_path: Path, llvm_ad_rgb: str) -> None:
    mirror = floor('<float name="mirror_reflectance" value="0.5"/>')
    (ours,), (theirs,) = (
        explain(scene(tmp_path, body), 2, 2, variant=llvm_ad_rgb).reference.samples
        for body in (mirror.replace('"floor"', '"roof"'), mirror)
    )
    rays = paired(ours, theirs)
    assert [[name for name, _ in ray.sides] for ray in rays] == [["plugin", "reference"], ["plugin"], ["reference"]]
    assert list(partings(rays)) == ["ray 0: the plugin meets `roof`, the reference `floor`"]


def test_one_program_may_meet_a_lit_surface_where_the_other_meets_nothing(tmp_path: Path, llvm_ad_rgb: str) -> None:
    """Such is a pixel on an outline."""
    lit, missed = (
        explain(scene(tmp_path, body), 2, 2, variant=llvm_ad_rgb)
        for body in (floor() + lamp("0, -3, 3") + BALL, BALL + lamp("0, -3, 3"))
    )
    for ours, theirs in ((lit.plugin, missed.reference), (missed.plugin, lit.reference)):
        mixed = dataclasses.replace(lit, plugin=ours, reference=theirs)
        assert "light `lamp` shines here" in str(mixed)
        assert "close: `lamp` is 45° above the horizon" in str(mixed)
        assert "inf" not in str(mixed)


@pytest.mark.parametrize(
    ("at", "said"),
    [
        ("0, 1.25, 1", "the way to `lamp` passes `ball` at {}"),
        ("0, 0.75, 1", "it lies {} inside the shadow of `ball` from `lamp`"),
    ],
)
def test_how_far_a_shadow_edge_is_off_is_its_distance(tmp_path: Path, llvm_ad_rgb: str, at: str, said: str) -> None:
    """The way to the lamp is the diagonal of y and z; the ball has radius 0.5 and is a quarter off in y."""
    body = (
        floor() + lamp("0, 3, 3") + BALL.replace("0, 2, 2", at).replace('"0.5"', '"0.05"' if at[3] == "1" else '"0.5"')
    )
    explanation = explain(scene(tmp_path, body), 2, 2, variant=llvm_ad_rgb)
    off = 0.25 / math.sqrt(2)
    by = off - 0.05 if at[3] == "1" else 0.5 - off
    assert said.format(f"{by:.3g}") in str(explanation).replace("\n│       ", " ")


def test_angles_are_told_in_degrees(tmp_path: Path, llvm_ad_rgb: str) -> None:
    text = str(explain(scene(tmp_path, floor() + lamp("0, 3, 3")), 2, 2, variant=llvm_ad_rgb))
    assert "`lamp` is 45° above the horizon" in text
    assert "the eye is 90° in front of the plane of the surface (n.v = 1)" in text


def test_how_far_a_texture_jumps_is_told(tmp_path: Path, llvm_ad_rgb: str) -> None:
    board = '<texture type="checkerboard" name="diffuse_reflectance"/>'
    paint = f'<bsdf type="blinnphong">{board}</bsdf>'
    moved = FLOOR.format(paint=paint).replace('<scale value="9"/>', '<scale value="9"/><translate x="0.3" y="0.6"/>')
    text = str(explain(scene(tmp_path, moved + lamp()), 2, 2, variant=llvm_ad_rgb))
    assert f"the colour of `floor` jumps at {0.3 / 18:.3g} from here, in (u, v)" in text


def test_the_value_at_which_the_error_grows_most_is_named() -> None:
    found = growth([("t of ray 0", 0.7), ("p of ray 0", 3.0), ("k_d of ray 0", 3e6), ("colour of ray 0", 4e6)])
    assert found == "The error grows most at k_d of ray 0: from 3 to 3e+06 ulp."


def test_every_value_that_both_have_is_compared_in_the_order_of_tracing(llvm_ad_rgb: str) -> None:
    (pair,) = explain("whitted_1980", 300, 260, variant=llvm_ad_rgb).samples
    names = [name for name, _ in values(paired(*pair))]
    assert names[:3] == ["o of ray 0", "d of ray 0", "t of ray 0"]
    assert names.index("n.h of `lamp` of ray 0") < names.index("o of ray 1")


# ----------------------------------------------------------------------------------------- the numbers
def test_the_colour_is_shown_to_the_last_digit_of_float32(tmp_path: Path, llvm_ad_rgb: str) -> None:
    explainer = Explainer(Request("whitted_1980", llvm_ad_rgb, {}, [], None, 0))
    loaded = explainer._loaded
    picture = np.array(loaded.integrator.render(loaded.scene, loaded.sensor, spp=1))
    for x, y in [(300, 260), (100, 400), (200, 200)]:
        explanation = explainer.pixel(x, y)
        line = next(line for line in str(explanation).splitlines() if line.startswith("plugin"))
        assert np.array_equal(np.array(line.split()[1:], np.float32), picture[y, x])
        shown = explanation.html().split("plugin</td>")[1].split(">")[1].split("<")[0]
        assert np.array_equal(np.array(shown.split(), np.float32), picture[y, x])
        last = [line for line in str(explanation).splitlines() if "sum so far" in line][-1]
        assert last.split()[4:7] == [f"{number:.6g}" for number in picture[y, x]]


@pytest.mark.parametrize(
    ("plugin", "reference", "apart"),
    [
        ((1.0,), (1.0,), 0.0),
        ((1.0 + 2.0**-23,), (1.0,), 1.0),
        ((1.0, 2.0**-23), (1.0, 0.0), 1.0),  # of the largest component
        ((math.inf,), (math.inf,), 0.0),
        ((0.0,), (2.0**-149,), 1.0),  # the least number of all
        ((1.0,), (0.0,), 2.0**23),  # the plugin's, if that is the larger
        ((1.0,), (math.inf,), math.inf),
        ((0.0,), (0.0,), 0.0),
    ],
)
def test_ulps_are_those_of_the_largest_component(
    plugin: tuple[float, ...], reference: tuple[float, ...], apart: float
) -> None:
    assert Pair("x", plugin, reference).ulps == apart


# --------------------------------------------------------------------------------------- hostile and large
HOSTILE = "[bold]&lt;/svg&gt;&lt;script&gt;alert(1)&lt;/script&gt; `x` &#x202e;" + "y" * 60


@pytest.fixture
def hostile(tmp_path: Path, llvm_ad_rgb: str) -> Explanation:
    """Explain a pixel of a scene whose ids are no names."""
    body = floor().replace('id="floor"', f'id="{HOSTILE}"') + lamp().replace('"lamp"', '"&lt;img src=x onerror=a()>"')
    return explain(scene(tmp_path, body), 2, 2, variant=llvm_ad_rgb)


def test_no_name_becomes_markup_on_the_page(hostile: Explanation, read_page: Callable[[str], Any]) -> None:
    page = read_page(hostile.html())
    assert not {"script", "img"} & set(page.tags)
    assert not [name for name in page.attributes if name.startswith("on") or name == "style"]
    ET.fromstring(f"<all>{hostile.drawing()}</all>")  # well-formed


def test_no_name_becomes_markup_or_breaks_lines_in_the_terminal(hostile: Explanation) -> None:
    text = str(hostile)
    assert "[bold]" in text
    assert "\\u202e" in named("\u202e")
    assert all(line.isprintable() for line in text.splitlines())
    assert max(map(len, text.splitlines())) <= COLUMNS


def test_names_are_quoted_and_cut() -> None:
    assert named("a`b") == "`a'b`"
    assert named(None) == "nothing"
    assert len(named("x" * 1000)) == LONGEST_NAME + 2


# ------------------------------------------------------------------------------- the command and the report
def test_the_command_prints_the_explanation(
    tmp_path: Path, llvm_ad_rgb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = scene(tmp_path, floor() + lamp())
    assert run(["explain", str(file), "2", "2", "-m", llvm_ad_rgb, "--report", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert out.rstrip("\n") == str(explain(file, 2, 2, variant=llvm_ad_rgb))
    facts = json.loads((tmp_path / "out/results.json").read_text())
    assert (facts["x"], facts["y"], facts["status"]) == (2, 2, "equal")
    assert '<div class="explain">' in (tmp_path / "out/report.html").read_text()


def test_samples_that_go_the_same_way_are_told_of_together(tmp_path: Path, llvm_ad_rgb: str) -> None:
    half = floor().replace("<scale", '<translate x="1"/><scale')  # its edge runs through the middle of the pixel
    explanation = explain(scene(tmp_path, half + lamp()), 2, 2, grid=2, variant=llvm_ad_rgb)
    assert [heading for heading, _ in explanation.trees] == [
        "Sample (0, 0) of 2 x 2 and 1 more like it",
        "Sample (1, 0) of 2 x 2 and 1 more like it",
    ]
    assert explanation.status is Status.EQUAL


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["5", "0"], "small.xml: there is no pixel 5 0 in a picture of 5 x 5; allowed are 0 0 to 4 4"),
        (["0", "x"], "Invalid value for 'Y': 'x' is not a valid integer."),
        (["0", "0", "-s", "1"], "small.xml: there is no -s 1; its only sensor is 0"),
        (["0", "0", "-m", "llvm_ad_spectral"], "-m llvm_ad_spectral: pixels are explained in rgb and mono variants"),
        (["0"], "Missing argument 'Y'."),
    ],
)
def test_misuse_is_one_line_and_2(
    tmp_path: Path, llvm_ad_rgb: str, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert run(["explain", str(scene(tmp_path, floor())), *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    (line,) = captured.err.splitlines()
    assert line.endswith(said)


def test_a_scene_that_the_reference_does_not_know_is_refused(tmp_path: Path, llvm_ad_rgb: str) -> None:
    with pytest.raises(Refusal, match="dielectric"):
        explain(scene(tmp_path, FLOOR.format(paint='<bsdf type="dielectric"/>') + lamp()), 2, 2)


def test_the_report_of_validate_explains_what_differs_and_some_of_the_rest(tmp_path: Path, llvm_ad_rgb: str) -> None:
    file = scene(tmp_path, floor() + lamp() + BALL)
    request = Request(str(file), llvm_ad_rgb, {}, [], None, 0)
    verdict = validate(file, variant=llvm_ad_rgb, size=(9, 6))
    found = report.explained(verdict, request, (9, 6))
    assert {"1,1", "4,3", "7,5"} <= set(found)
    colour = verdict.judgement.picture[3, 4]
    assert " ".join(f"{c:>14.9g}" for c in colour) in found["4,3"]
    assert report.explained(dataclasses.replace(verdict, against="a.exr", variant=""), request, None) == {}


def test_in_grey_every_colour_is_one_number_in_both(tmp_path: Path, llvm_ad_mono: str) -> None:
    body = floor('<float name="specular_reflectance" value="0.5"/><float name="mirror_reflectance" value="0.5"/>')
    sky = '<emitter type="constant"><float name="radiance" value="0.25"/></emitter>'
    file = scene(tmp_path, body + lamp() + sky, '<rgb name="ambient" value="0.1, 0.2, 0.3"/>')
    explanation = explain(file, 2, 2, variant=llvm_ad_mono)
    places = {"o", "d", "p", "n", "n_g", "r"}
    for side in (explanation.plugin, explanation.reference):
        rays = side.samples[0].rays
        kept = [values for ray in rays for name, values in vars(ray).items() if name not in places]
        kept += [getattr(rays[0].lights[0], name) for name in ("irradiance", "diffuse", "specular", "colour")]
        assert {len(values) for values in kept if isinstance(values, tuple)} <= {0, 1}  # none of the background
    assert len(explanation.plugin.colour) == len(explanation.reference.colour) == 1
    assert explanation.status is Status.EQUAL
    verdict = validate(file, variant=llvm_ad_mono)
    found = report.explained(verdict, Request(str(file), llvm_ad_mono, {}, [], None, 0), None)
    assert f'<td class="number">{verdict.judgement.picture[2, 2, 0]:>14.9g}</td>' in found["2,2"]


def test_size_is_that_of_validate(tmp_path: Path, llvm_ad_rgb: str, capsys: pytest.CaptureFixture[str]) -> None:
    """What the page says explains any other pixel."""
    file = scene(tmp_path, floor() + lamp())
    assert run(["validate", str(file), "--size", "9x7", "--grid", "2", "--report", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "report.html").read_text()
    before, after = json.loads(re.findall(r'"command":(\[[^]]*\])', page)[0])
    assert after == "--size=9x7 --grid=2"
    capsys.readouterr()
    assert run([*before.split()[1:], "8", "6", *after.split()]) == 0
    assert "pixel (8, 6) of 9 x 7, mean of 2 x 2 samples" in capsys.readouterr().out


def test_the_worst_pixels_are_explained_first() -> None:
    bounds = Bounds(
        *(np.zeros((30, 40, *more)) for more in ((3,), (3,), *[()] * (len(dataclasses.fields(Bounds)) - 2)))
    )
    places = [(i % 40, 3 * (i // 40)) for i in range(100)]
    differences = [Difference(x, y, Status.UNEXPLAINED, 1.0, 0.0, (), 1, True) for x, y in places]
    judgement = Judgement(np.zeros((30, 40, 3)), bounds, np.zeros((30, 40), np.uint8), differences)
    chosen = list(report._chosen(judgement))
    assert chosen[: report.MOST_UNEQUAL] == places[: report.MOST_UNEQUAL]
    assert len(chosen) == report.MOST_UNEQUAL + report.TYPICAL**2
    cut = cut_out(judgement, *places[2])
    assert cut.differences == differences[2:3]
    assert cut.picture.shape == cut.bounds.bound.shape == (1, 1, 3)
