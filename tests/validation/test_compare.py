"""`whitted compare`: the figures, pictures of other renderers, what is no picture, the report and the API."""

from __future__ import annotations

import json
import math
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import whitted_validation
from whitted_validation import flip as flip_module
from whitted_validation.cli import run
from whitted_validation.comparison import MOST_LISTED, Comparison

U = 2.0**-24  # float32's unit roundoff
RGB = np.random.default_rng(4).random((6, 8, 3)).astype(np.float32)


@pytest.fixture(autouse=True)
def here(tmp_path: Path, scalar_rgb: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Work in an empty folder, without FLIP unless a test asks for it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)


def compared(a: Any, b: Any) -> Comparison:
    return whitted_validation.compare(a, b)


# --- The figures ---


def test_known_errors_give_known_figures() -> None:
    a, b = np.zeros((10, 100, 3)), np.zeros((10, 100, 3))
    a.reshape(-1, 3)[:1000] = 1.0  # squares 1 and 49 in equal numbers: the mean is 25
    a.reshape(-1, 3)[:500] = -7.0
    found = compared(a, b)
    assert (found.largest, found.rmse) == (7.0, 5.0)
    assert found.percentiles == ((50.0, 1.0), (90.0, 7.0), (99.0, 7.0), (99.9, 7.0))
    assert (found.equal, found.above) == (0, 1000)


def test_a_percentile_is_an_error_that_so_many_pixels_do_not_exceed() -> None:
    errors = np.arange(1.0, 1001.0).reshape(40, 25)
    np.random.default_rng(0).shuffle(errors.reshape(-1))
    found = compared(errors, np.zeros((40, 25)))
    assert found.percentiles == ((50.0, 500.0), (90.0, 900.0), (99.0, 990.0), (99.9, 999.0))


def test_the_share_counts_errors_above_a_thousandth() -> None:
    a = np.zeros((1, 4))
    a[0] = 0.0, 1e-3, np.nextafter(1e-3, 1.0), 1.0
    found = compared(a, np.zeros((1, 4)))
    assert (found.equal, found.above) == (1, 2)


def test_the_error_of_a_pixel_is_its_worst_channel() -> None:
    a = np.zeros((2, 2, 3))
    a[1, 0] = 0.25, -0.5, 0.125
    (pixel,) = compared(a, np.zeros((2, 2, 3))).worst
    assert (pixel.x, pixel.y, pixel.error, pixel.a, pixel.b) == (0, 1, 0.5, (0.25, -0.5, 0.125), (0.0, 0.0, 0.0))


def test_worst_pixels_come_in_order_and_ties_in_reading_order() -> None:
    a = np.full((10, 10), 0.5)
    a[7, 3], a[2, 9] = 2.0, 1.0
    worst = compared(a, np.zeros((10, 10))).worst
    ties = [(i % 10, i // 10) for i in range(MOST_LISTED - 2)]
    assert [(p.x, p.y) for p in worst] == [(3, 7), (9, 2), *ties]


def test_equal_pictures_have_no_worst_pixel() -> None:
    found = compared(RGB, RGB)
    assert (found.worst, found.rmse, found.sentence) == ((), 0.0, "All 48 pixels are equal.")


def test_bands_of_rows_make_one_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    a, b = RGB.copy(), RGB[::-1]
    a[5, 2] = math.nan
    whole = compared(a, b)
    monkeypatch.setattr("whitted_validation.comparison._BAND", 2 * 8)
    parts = compared(a, b)
    assert np.array_equal(whole.error, parts.error)
    # Sums of 144 positive squares in another order: each addition, and each square, rounds by 2^-53 at most, and
    # the root halves that; scaling by powers of two rounds nothing.
    assert abs(whole.finite_rmse - parts.finite_rmse) <= 144 * 2 * 2.0**-53 * whole.finite_rmse


@pytest.mark.parametrize("size", [1e-300, 1e-160, 1e160, 1e300])
def test_the_mean_square_neither_overflows_nor_underflows(size: float) -> None:
    size = 2.0 ** round(math.log2(size))
    assert compared(np.full((4, 4), size), np.zeros((4, 4))).rmse == size


def test_nan_and_infinity_are_counted_and_exceed_every_limit() -> None:
    a = RGB.astype(np.float64)
    b = a.copy()
    a[1, 2, 0], a[1, 2, 1], a[3, 4, 2] = math.nan, math.inf, math.nan
    b[0, 0, 0], b[5, 5, 1] = -math.inf, b[5, 5, 1] + 0.5
    found = compared(a, b)
    assert (found.not_finite[0].nan, found.not_finite[0].infinite) == (2, 1)
    assert (found.not_finite[1].nan, found.not_finite[1].infinite) == (0, 1)
    assert found.largest == found.rmse == math.inf
    assert found.finite_largest == abs(a[5, 5, 1] - b[5, 5, 1])
    assert [(p.x, p.y) for p in found.worst] == [(0, 0), (2, 1), (4, 3), (5, 5)]
    assert len(found.exceeded(1e308, 1e308)) == 2
    assert "not finite in A  pixels with nan: 2, with infinity: 1" in str(found)
    assert "cannot be compared" in found.sentence


def test_the_same_nan_in_both_is_no_agreement() -> None:
    a = RGB.copy()
    a[0, 0] = math.nan
    assert compared(a, a).largest == math.inf


# --- The command ---


def test_pictures_of_two_sizes_are_refused_in_a_line(capsys: pytest.CaptureFixture[str]) -> None:
    np.save("a", RGB)
    np.save("b", RGB[:5])
    assert run(["compare", "a.npy", "b.npy", "--report", "page"]) == 2
    assert capsys.readouterr().err == "whitted: a.npy is 8 x 6 pixels, b.npy 8 x 5; one size needed\n"
    assert not Path("page").exists()


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ([], 0),
        (["--max-error", "0.5", "--max-rmse", "0.5"], 0),
        (["--max-error", "0.499"], 1),
        (["--max-rmse", "0.001"], 1),
        (["--max-error", "nan"], 2),
        (["--max-rmse", "-1"], 2),
        (["--layer", "beauty"], 2),
        (["--report", "b.npy"], 2),
    ],
)
def test_the_exit_code_says_whether_limits_hold(options: list[str], code: int) -> None:
    other = RGB.astype(np.float64)
    np.save("a", other)
    other[2, 3, 1] += 0.5 if other[2, 3, 1] < 0.5 else -0.5
    np.save("b", other)
    assert run(["compare", "a.npy", "b.npy", *options]) == code


HOSTILE = "<img src=x onerror=alert(1)>\x1b[2J\u202e.npy"


def test_a_report_is_written_and_a_hostile_name_does_nothing(
    capsys: pytest.CaptureFixture[str], read_page: Callable[[str], Any]
) -> None:
    np.save(HOSTILE, RGB)
    other = RGB.copy()
    other[2, 3] = math.nan
    np.save("b", other)
    assert run(["compare", HOSTILE, "b.npy", "--report", "page", "--max-error", "1"]) == 1
    said = capsys.readouterr()
    assert "\x1b" not in said.out + said.err
    results = json.loads(Path("page/results.json").read_text())
    assert (results["exit"], results["equal"], results["above"]) == (1, 47, 1)
    assert results["b"] == {"name": "b.npy", "stepped": False, "nan": 1, "infinite": 0}
    assert results["error"]["largest"] == "Infinity"
    assert results["error"]["finite_largest"] == 0
    assert [(p["x"], p["y"], p["b"]) for p in results["worst"]] == [(3, 2, ["NaN"] * 3)]
    page = read_page(Path("page/report.html").read_text())
    assert "img" not in page.tags
    assert all(source.startswith(("#", "data:")) for source in page.sources)
    assert "<img src=x onerror=alert(1)>" in page.text
    assert results["sentence"] in page.text


def test_a_name_that_is_not_utf8_is_shown_as_well_as_can_be(capsys: pytest.CaptureFixture[str]) -> None:
    np.save("a", RGB)
    name = "raw\udcff.npy"
    Path("a.npy").rename(name)
    assert run(["compare", name, name, "--report", "page"]) == 0
    assert "raw\\udcff.npy" in capsys.readouterr().out
    assert Path("page/report.html").exists()


def test_a_large_pair_is_shown_by_the_worst_pixel_of_each_block() -> None:
    a = np.zeros((1100, 1100), np.float32)
    b = a.copy()
    b[801, 33] = 0.25
    np.save("a", a)
    np.save("b", b)
    assert run(["compare", "a.npy", "b.npy", "--report", "page"]) == 0
    text = Path("page/report.html").read_text()
    data = json.loads(text.split('<script type="application/json">')[1].split("</script>")[0])
    assert (data["width"], data["height"], data["of"], data["step"]) == (550, 550, [1100, 1100], 2)
    assert [(p["x"], p["y"]) for p in json.loads(Path("page/results.json").read_text())["worst"]] == [(33, 801)]


def test_a_comparison_shows_itself_in_a_notebook() -> None:
    np.save("<b>", RGB)
    shown = compared("<b>.npy", RGB)._repr_html_()
    assert shown.count("data:image/png") == 3
    assert "<b>" not in shown
    assert "A: &lt;b&gt;.npy" in shown
    assert "All 48 pixels are equal." in shown


def test_a_large_picture_is_made_smaller_for_a_notebook() -> None:
    from whitted_validation.report.pair import MOST_PIXELS, pair

    a = np.zeros((600, 700, 3))
    b = a.copy()
    b[599, 699] = 1.0
    assert MOST_PIXELS < 600 * 700
    shown = pair(a, b, ("a", "b"))
    assert 'width="350" height="300"' in shown
    assert "the worst pixel of each 2 x 2" in shown


# --- FLIP ---


def test_without_flip_it_is_said() -> None:
    found = compared(RGB, RGB)
    assert (found.flip.mean, found.flip.note) == (None, "not installed; pip install 'mitsuba-whitted[flip]'")


PACKAGE = """
import sys
def evaluate(reference, test, kind, inputsRGB, applyMagma):
    if not reference.any():
        print("Start exposure must be smaller than stop exposure!")
        sys.exit(255)
    assert reference.dtype == test.dtype == "float32" and not inputsRGB and reference.min() >= 0
    return None, float(abs(reference - test).mean()) + (kind == "HDR"), {}
"""


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Put a package in the place of flip-evaluator that ends the process as that does."""
    (tmp_path / "stand_in").mkdir()
    (tmp_path / "stand_in/flip_evaluator.py").write_text(PACKAGE)
    monkeypatch.syspath_prepend(tmp_path / "stand_in")
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: True)


def test_flip_gets_both_pictures_b_as_the_reference(stand_in: None) -> None:
    found = compared(np.full((4, 4), -1.0), np.full((4, 4), 0.25))
    assert (found.flip.mean, found.flip.note) == (1.25, "HDR, 67 pixels a degree")


def test_two_pngs_are_seen_as_a_screen_shows_them(stand_in: None) -> None:
    mi.Bitmap(np.full((4, 4), 255, np.uint8)).write("a.png")
    assert compared("a.png", "a.png").flip.note == "LDR, 67 pixels a degree"


def test_a_flip_that_ends_its_process_ends_nothing_else(stand_in: None) -> None:
    found = compared(RGB, 0 * RGB)
    assert found.flip.mean is None
    assert found.flip.note.endswith("says: Start exposure must be smaller than stop exposure!")


def test_flip_is_left_out_where_it_means_nothing_or_takes_minutes(
    stand_in: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "nan or infinity" in compared(RGB * math.nan, RGB).flip.note
    monkeypatch.setattr(flip_module, "MOST_PIXELS", 47)
    assert compared(RGB, RGB).flip.note == "not computed above 47 pixels"


def test_the_package_and_its_function_do_not_collide() -> None:
    code = "from whitted_validation import compare, comparison; print(compare is comparison.compare)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "True\n"
