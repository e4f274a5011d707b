"""The page in a real browser: what it shows is what was measured, and no name runs.

Needs Chromium, see conftest.py.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import mitsuba as mi
import numpy as np
import pytest

import whitted_validation
from whitted_validation import report
from whitted_validation.cli import run
from whitted_validation.seen import look
from whitted_validation.validation import Here

if TYPE_CHECKING:
    from tests.validation.conftest import Browser

U = 2.0**-24
EVIL = """"><img src=x onerror=hacked=1></script><script>hacked=1</script><svg onload='hacked=1'>`{hacked=1}"""
# What a file name can hold of it.
EVIL_FILE = "<img src=x onerror=hacked=1>&lt;<i>.xml"
SCENE = """<scene version="3.0.0"><integrator type="whitted"/>
  <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="12"/>
    <rfilter type="box"/></film></sensor>
  <emitter type="point" id="EVIL lamp"><point name="position" value="1, 3, 2"/><rgb name="intensity" value="9"/>
  </emitter>
  <shape type="sphere" id="EVIL ball"><point name="center" value="0, 0, 5"/><bsdf type="blinnphong">
    <rgb name="mirror_reflectance" value="0.25, 0.5, 0.75"/></bsdf></shape>
  <shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="9"/>
    <translate y="-1"/></transform></shape></scene>"""


class Judged:
    """A report of a scene with hostile names, of a picture with three faults, and what went into it."""

    def __init__(self, folder: Path) -> None:
        file = folder / EVIL_FILE
        file.write_text(SCENE.replace("EVIL", EVIL.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")))
        verdict = whitted_validation.validate(file, executor=Here())
        self.seen = look(verdict.description, Here())
        self.picture, self.reference = verdict.judgement.picture.copy(), verdict.judgement.bounds.colour
        self.picture[4, 6] += 0.25
        self.picture[3, 5, 1] = np.nan
        self.picture[11, 15, 2] = np.inf
        np.save(folder / "other.npy", self.picture)
        self.folder = folder / "report"
        assert run(["validate", str(file), "--against", str(folder / "other.npy"), "--report", str(self.folder)]) == 1
        mi.set_log_level(mi.LogLevel.Warn)
        self.page = self.folder / "report.html"
        (self.facts,) = json.loads((self.folder / "results.json").read_text())["scenes"]


@pytest.fixture(scope="module")
def judged(tmp_path_factory: pytest.TempPathFactory) -> Judged:
    folder = tmp_path_factory.mktemp("judged")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        return Judged(folder)


def close(shown: np.ndarray, true: np.ndarray, digits: int) -> bool:
    """Tell whether numbers are what `digits` significant digits show of others."""
    same = shown == true
    with np.errstate(invalid="ignore"):
        near = np.abs(shown - true) <= 0.5 * 10.0 ** (np.floor(np.log10(np.abs(true) + 1e-300)) + 1 - digits) * (1 + U)
    return bool((same | near | (np.isnan(shown) & np.isnan(true))).all())


def noise() -> np.ndarray:
    """Draw bits of every kind: signs, denormals, infinities, NaN."""
    a = np.random.default_rng(4).integers(0, 2**32, (9, 14, 3), dtype=np.uint32).view(np.float32)
    a[0, 0] = 0.0, -0.0, np.nan
    a[0, 1] = np.inf, -np.inf, 2.0**-149
    return a


def slope() -> np.ndarray:
    """Draw what neighbours foretell."""
    y, x = np.mgrid[0:9, 0:14]
    return np.stack([np.exp(0.01 * x + k * 0.02 * y) for k in range(3)], axis=2).astype(np.float32)


@pytest.mark.parametrize(("make", "way"), [(noise, "plain"), (slope, "smooth")])
def test_every_word_of_both_pictures_comes_back(
    browser: Browser, tmp_path: Path, make: Callable[[], np.ndarray], way: str
) -> None:
    """A and the float32 of B to the last bit; B itself to 1/16 of float32's spacing."""
    a = make()
    rng = np.random.default_rng(5)
    with np.errstate(invalid="ignore", over="ignore"):
        double = a.astype(np.float64)
        b = np.where(np.isfinite(a), double * (1 + 1e-7 * rng.standard_normal(a.shape)), 0.5)
        near = b.astype(np.float32)
    planes = report.Viewer(a, b).data()["planes"]
    assert (planes["a0"][0], planes["b0"][0]) == (way, "like")
    report.write(tmp_path, {}, "planes", [report.Viewer(a, b)])
    browser.open(tmp_path / "report.html")
    words = browser.ask(
        "['a', 'b'].map((n) => document.querySelector('.viewer').viewer.pair[n].map("
        "(plane) => [...new Uint32Array(plane.buffer)]))"
    )
    for found, true in zip(words, (a, near), strict=True):
        assert (np.array(found, np.uint32).reshape(3, 9, 14).transpose(1, 2, 0) == true.view(np.uint32)).all()
    errors = browser.ask(
        "(() => {const p = document.querySelector('.viewer').viewer.pair;"
        "return [...p.worst.keys()].map((i) => [0, 1, 2].map((c) => String(p.error(i, c))))})()"
    )
    found = np.array([[float(x) for x in pixel] for pixel in errors]).reshape(9, 14, 3)
    true = np.abs(double - b)
    known = np.isfinite(true)
    assert (np.isnan(found) == np.isnan(true)).all()
    assert (found[~known & ~np.isnan(true)] == np.inf).all()
    allowed = np.abs(np.spacing(near).astype(np.float64)) / 16 + 4 * 2.0**-53 * np.abs(b)
    assert (np.abs(found[known] - true[known]) <= allowed[known]).all()


def test_hovering_tells_the_numbers_of_the_pixel(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page)
    statuses = {(d["x"], d["y"]): d for d in judged.facts["differences"]}
    assert set(statuses) == {(6, 4), (5, 3), (15, 11)}
    for x, y in [*((x, y) for x in range(16) for y in (0, 4, 6)), *statuses]:
        browser.hover(x, y)
        assert browser.text(".place") == f"pixel {x}, {y}"
        shown = browser.numbers(".values", 2)
        a, b = judged.picture[y, x], judged.reference[y, x]
        assert (shown[:, 0].astype(np.float32).view(np.uint32) == a.astype(np.float32).view(np.uint32)).all()
        near = np.abs(np.spacing(b.astype(np.float32)).astype(np.float64))
        assert (np.abs(shown[:, 1] - b) <= near / 16 + 0.5e-9 * np.abs(b)).all()
        errors = browser.numbers(".errors", 3)
        finite = np.isfinite(a)
        off = np.abs(a.astype(np.float32).astype(np.float64) - b)
        assert (np.abs(errors[finite, 0] - off[finite]) <= (near / 16 + 0.5e-2 * off)[finite]).all()
        assert browser.text(".badge") == (statuses[x, y]["status"] if (x, y) in statuses else "equal")
        told = statuses[x, y]["told"] if (x, y) in statuses else ""
        assert browser.text(".told") == told
        if (x, y) in statuses and np.isfinite(a).all():
            difference = statuses[x, y]
            worst = np.nanargmax(off / errors[:, 2])
            assert close(errors[worst, 0], np.array(difference["error"]), 3)
            assert abs(errors[worst, 2] / difference["bound"] - 1) <= 0.05 + 2.0**-6  # two digits of six bits


def test_the_pixel_is_told_with_object_light_and_bounces(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page)
    seen = judged.seen
    assert seen.objects[seen.object[6, 8]] == f"{EVIL} ball"
    assert seen.light_texts[seen.lights[6, 8]] == f"lit by {EVIL} lamp"
    assert seen.objects[seen.object[0, 0]] == "background"
    assert (seen.bounces[6, 8], seen.bounces[0, 0]) == (1, 0)
    for x in range(16):
        for y in (1, 8):
            browser.hover(x, y)
            texts = browser.ask("[...document.querySelectorAll('.facts dd')].map((node) => node.textContent)")
            object, light = seen.objects[seen.object[y, x]], seen.light_texts[seen.lights[y, x]]
            expected = [object, light, "by the rounding model", str(seen.bounces[y, x])]
            assert texts == [text for text in expected if text]  # no light where nothing is met


def test_unequal_pixels_are_listed_as_in_the_results_and_lead_there(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page)
    listed = browser.ask("[...document.querySelectorAll('.unequal button')].map((b) => b.textContent)")
    assert listed == [f"{d['x']}, {d['y']}" for d in judged.facts["differences"]]
    assert listed == ["5, 3", "15, 11", "6, 4"]  # what is no number comes before a finite error
    browser.ask("document.querySelectorAll('.unequal button')[2].click()")
    assert browser.text(".place") == "pixel 6, 4"
    assert browser.text(".told").startswith("Unexplained.")


def test_unexplained_pixels_are_listed_before_explained_ones(browser: Browser, tmp_path: Path) -> None:
    b = np.zeros((2, 3, 3))
    a = b + np.arange(6).reshape(2, 3, 1)
    status = np.array([[0, 2, 1], [2, 1, 0]], np.uint8)
    report.write(tmp_path, {}, "t", [report.Viewer(a, b, status=status)])
    browser.open(tmp_path / "report.html")
    listed = browser.ask("[...document.querySelectorAll('.unequal button')].map((b) => b.textContent)")
    assert listed == ["0, 1", "1, 0", "1, 1", "2, 0"]


def test_pixels_are_listed_in_the_order_in_which_they_are_told_of(browser: Browser, tmp_path: Path) -> None:
    b = np.zeros((1, 4, 3))
    told = {"2,0": "c", "0,0": "a", "3,0": "d"}
    report.write(tmp_path, {}, "t", [report.Viewer(b + 1, b, status=np.array([[2, 2, 2, 1]], np.uint8), told=told)])
    browser.open(tmp_path / "report.html")
    listed = browser.ask("[...document.querySelectorAll('.unequal button')].map((b) => b.textContent)")
    assert listed == ["2, 0", "0, 0", "3, 0", "1, 0"]


def srgb(linear: np.ndarray) -> list[int]:
    x = np.clip(linear, 0.0, 1.0)
    coded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return [int(v) for v in 255.0 * coded + 0.5]


def test_the_slider_divides_a_from_b(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page)
    browser.ask("document.querySelector('.mark').click(); document.querySelector('.divide').focus()")
    a, b = judged.picture[4, 6], judged.reference[4, 6]
    browser.ask("document.querySelector('.viewer').viewer.choose(null)")
    browser.key("Home", 36)
    assert browser.drawn(6, 4) == srgb(b)
    browser.key("End", 35)
    assert browser.drawn(6, 4) == srgb(a)
    assert srgb(a) != srgb(b)
    # With the mouse: take the line at the right end and leave it on the left.
    right, down = browser.place(15.45, 6)
    left, _ = browser.place(2, 6)
    for kind, x in (("mousePressed", right), ("mouseMoved", left), ("mouseReleased", left)):
        browser.send("Input.dispatchMouseEvent", type=kind, x=x, y=down, button="left", buttons=1, clickCount=1)
    assert browser.drawn(6, 4) == srgb(b)
    assert browser.drawn(1, 4) == srgb(judged.picture[4, 1])


def test_exposure_brightens_by_stops(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page)
    browser.ask("document.querySelector('.views input[value=a]').click(); document.querySelector('.exposure').focus()")
    browser.key("ArrowRight", 39)
    browser.key("ArrowRight", 39)
    assert browser.text(".stops") == "+1"
    assert browser.drawn(10, 8) == srgb(2.0 * judged.picture[8, 10])


def test_everything_is_reached_and_done_by_keys(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page)
    controls = browser.ask(
        "document.querySelectorAll('.viewer :is(button, input, select, canvas[tabindex], summary)').length"
    )
    reached = set()
    for _ in range(4 * controls):
        browser.key("Tab", 9)
        reached.add(browser.ask("document.activeElement.className || document.activeElement.tagName"))
    assert {"view", "divide", "exposure", "mark", "in", "fit", "out", "SUMMARY"} <= reached
    browser.ask("document.querySelector('canvas.view').focus()")
    browser.ask("document.querySelector('.viewer').viewer.choose(0)")
    for name, code, shift, place in (
        ("ArrowRight", 39, False, "1, 0"),
        ("ArrowDown", 40, False, "1, 1"),
        ("ArrowRight", 39, True, "11, 1"),
        ("ArrowRight", 39, True, "15, 1"),
        ("ArrowLeft", 37, False, "14, 1"),
        ("ArrowUp", 38, True, "14, 0"),
    ):
        browser.key(name, code, shift=shift)
        assert browser.text(".place") == f"pixel {place}"
    for key, view in (("1", "a"), ("3", "b"), ("4", "error"), ("5", "verdict"), ("2", "split")):
        browser.key(key, ord(key), key)
        assert browser.ask("document.querySelector('.views input:checked').value") == view
    browser.key("n", ord("N"), "n")
    assert browser.text(".place") in {f"pixel {d['x']}, {d['y']}" for d in judged.facts["differences"]}
    assert browser.complaints() == []


def test_near_enough_the_numbers_stand_in_the_pixels(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page, width=600)
    browser.ask(
        """{window.written = []; const old = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, ...at) {
          written.push(text); return old.call(this, text, ...at)}}"""
    )
    browser.ask(
        "document.querySelector('.views input[value=a]').click(); document.querySelector('canvas.view').focus()"
    )
    browser.ask("document.querySelector('.viewer').viewer.choose(4 * 16 + 6)")
    assert browser.ask("written.length") == 0
    browser.ask("written.length = 0")
    for _ in range(3):
        browser.key("+", 187, "+")
    assert stands(browser.ask("written"), judged.picture[4, 6])
    assert not stands(browser.ask("written"), judged.reference[4, 6])
    # Undivided, the line at the left end, it is B.
    browser.ask("document.querySelector('.views input[value=split]').click()")
    browser.ask("document.querySelector('.divide').focus(); written.length = 0")
    browser.key("Home", 36)
    assert stands(browser.ask("written"), judged.reference[4, 6])
    assert not stands(browser.ask("written"), judged.picture[4, 6])


def stands(written: list[str], pixel: np.ndarray) -> bool:
    """Tell whether the three numbers of a pixel are among the words that were written."""
    numbers = [float(text) for text in written if re.fullmatch(r"[\d.e+\-]+", text)]
    return all(any(close(np.array(number), x, 4) for number in numbers) for x in pixel)


def test_no_name_runs_and_nothing_is_loaded(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page)
    browser.hover(8, 6)
    assert browser.ask("typeof hacked") == "undefined"
    assert browser.ask("document.querySelectorAll('img[src=x], main i, svg[onload]').length") == 0
    assert browser.text("h2") == Path(EVIL_FILE).stem
    asked = [e["params"]["request"]["url"] for e in browser.events if e["method"] == "Network.requestWillBeSent"]
    assert asked == [judged.page.as_uri()]
    assert browser.complaints() == []


def test_a_script_that_got_into_the_page_would_not_run(browser: Browser, judged: Judged, tmp_path: Path) -> None:
    """The second lock: if an escape were forgotten."""
    page = judged.page.read_text().replace("<main>", "<main><script>hacked=1</script><img src=x onerror=hacked=1>")
    (tmp_path / "page.html").write_text(page)
    browser.open(tmp_path / "page.html")
    assert browser.ask("typeof hacked") == "undefined"
    assert len(browser.complaints()) >= 2


def test_an_explanation_shows_with_its_pixel(browser: Browser, tmp_path: Path) -> None:
    a = np.zeros((4, 5, 3), np.float32)
    explained = {"3,2": "<p>the ray meets nothing</p><img src=x onerror=hacked=1>"}
    command = "whitted explain 'a b.xml'", "--size=5x4"
    status = np.zeros((4, 5), np.uint8)
    shown = report.Viewer(a, a.astype(float), status=status, explained=explained, command=command)
    report.write(tmp_path, {}, "t", [shown])
    browser.open(tmp_path / "report.html")
    assert browser.text(".place") == "pixel 3, 2"  # where all are equal, one that has something to show
    assert "the ray meets nothing" in browser.text(".rays")
    assert browser.ask("document.querySelector('.not-drawn').hidden")
    browser.ask("document.querySelector('.viewer').viewer.choose(0)")
    assert browser.ask("document.querySelector('.rays').hidden")
    assert browser.text(".not-drawn code") == "whitted explain 'a b.xml' 0 0 --size=5x4"
    across, down = browser.place(3, 2)
    for kind in ("mousePressed", "mouseReleased"):
        browser.send("Input.dispatchMouseEvent", type=kind, x=across, y=down, button="left", buttons=1, clickCount=1)
    assert "the ray meets nothing" in browser.text(".rays")
    browser.ask("document.querySelector('canvas.view').focus()")
    browser.key("ArrowLeft", 37)
    assert browser.ask("document.querySelector('.rays').hidden")
    assert browser.ask("typeof hacked") == "undefined"


def test_of_several_scenes_only_unequal_ones_show_rays_at_once(browser: Browser, tmp_path: Path) -> None:
    """A page of all scenes would be a hundred screens long."""
    a = np.zeros((1, 2, 3), np.float32)
    shown = [
        report.Viewer(a, a + k, status=np.array([[0, 2 * k]], np.uint8), explained={"1,0": "<p>rays</p>"})
        for k in (0, 1)
    ]
    report.write(tmp_path, {}, "t", shown)
    browser.open(tmp_path / "report.html")
    hidden = browser.ask("[...document.querySelectorAll('.rays')].map((rays) => rays.hidden)")
    assert hidden == [True, False]
    assert browser.text(".place") == "pixel 1, 0"


def test_on_a_phone_it_fits_and_fingers_work(browser: Browser, judged: Judged) -> None:
    browser.open(judged.page, width=375, height=740, touch=True)
    assert browser.ask("document.scrollingElement.scrollWidth") <= 375
    heights = browser.ask("[...document.querySelectorAll('button, select')].map((node) => node.offsetHeight || 99)")
    assert min(heights) >= 40  # wide enough for a finger; 99 stands for what is hidden
    across, down = browser.place(12, 10)
    browser.send("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": across, "y": down}])
    browser.send("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert browser.text(".place") == "pixel 12, 10"
    before = browser.ask("document.querySelector('.viewer').viewer.scale")

    def fingers(kind: str, apart: float) -> None:
        points = [{"x": 180 - apart, "y": down, "id": 0}, {"x": 180 + apart, "y": down, "id": 1}]
        browser.send("Input.dispatchTouchEvent", type=kind, touchPoints=points if kind != "touchEnd" else [])

    fingers("touchStart", 20)
    for apart in range(25, 65, 5):
        fingers("touchMove", apart)
    fingers("touchEnd", 0)
    assert browser.ask("document.querySelector('.viewer').viewer.scale") > 2 * before


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_letters_stand_out_in_light_and_dark(browser: Browser, judged: Judged, scheme: str) -> None:
    """Contrast of at least 4.5 between text and ground (WCAG 2.1, success criterion 1.4.3)."""
    browser.open(judged.page)
    browser.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])
    pairs = browser.ask(
        """[['body', 'body'], ['.quiet', 'body'], ['.badge', '.pixel'], ['.pixel dt', '.pixel'], ['a', 'body'],
        ['.unequal button', '.unequal button']].map(([text, ground]) => [
          getComputedStyle(document.querySelector(text)).color,
          getComputedStyle(document.querySelector(ground)).backgroundColor])"""
    )
    for text, ground in pairs:
        lighter, darker = sorted((luminance(text), luminance(ground)), reverse=True)
        assert (lighter + 0.05) / (darker + 0.05) >= 4.5, (text, ground)
    assert (luminance(pairs[0][1]) < 0.1) == (scheme == "dark")


def luminance(css: str) -> float:
    coded = np.array(re.findall(r"[\d.]+", css)[:3], float) / 255
    return float(np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4) @ (0.2126, 0.7152, 0.0722))
