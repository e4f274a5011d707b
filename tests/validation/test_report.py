"""Reports: JSON that loses no number, sections that escape, charts to scale, pages of a sensible size."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import math
import re
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

from whitted_validation import report, scene_files
from whitted_validation.printable import printable
from whitted_validation.refusal import Refusal
from whitted_validation.report import viewer, words
from whitted_validation.verdict import Difference, Status

EVIL = "<script>x</script>\"'&`</title></svg>"
ASSETS = Path(report.__file__).parent


def written(folder: Path, *sections: report.Section, results: dict[str, Any] | None = None, style: str = "") -> str:
    report.write(folder, results or {}, EVIL, sections, style)
    return (folder / "report.html").read_text()


# ---------------------------------------------------------------------------------------------- results.json
def test_numbers_that_json_has_no_word_for_survive(tmp_path: Path) -> None:
    numbers = [math.nan, math.inf, -math.inf, 0.1, 2.0**-1074, np.float32(0.1), np.int64(7), 3]
    report.write(tmp_path, {"list": numbers, "array": np.array([1.5, np.nan]), "path": Path("a") / "b"}, "t", [])
    text = (tmp_path / "results.json").read_text()

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is not JSON")

    facts = json.loads(text, parse_constant=refuse)
    read = [float(x) for x in facts["list"]]
    assert [x if x == x else "NaN" for x in read] == ["NaN", *map(float, numbers[1:])]
    assert facts["array"] == [1.5, "NaN"]
    assert facts["path"] == str(Path("a") / "b")


def test_results_say_what_made_them(tmp_path: Path) -> None:
    written(tmp_path)
    facts = json.loads((tmp_path / "results.json").read_text())
    assert list(facts) == ["schema", "command", "environment"]
    assert {"mitsuba-whitted", "mitsuba", "drjit", "numpy", "Python", "platform"} <= set(facts["environment"])


def test_a_folder_that_cannot_be_written_is_refused_in_a_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(Refusal, match=r"--report .*file: cannot be written: ") as refused:
        report.write(tmp_path / "file", {}, "t", [])
    assert "\n" not in str(refused.value)


def test_a_report_that_fails_leaves_the_old_one(tmp_path: Path) -> None:
    written(tmp_path, report.Sentence("old"))
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(TypeError):
        report.write(tmp_path, {"x": object()}, "t", [report.Sentence("new")])
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


# --------------------------------------------------------------------------------------------------- sections
def test_every_section_escapes_what_it_shows(tmp_path: Path) -> None:
    points = {EVIL: [(1.0, 2.0), (2.0, 3.0)], "other": [(1.0, 1.0)]}
    plane = np.zeros((2, 2), int)
    a = np.zeros((2, 2, 3), np.float32)
    page = written(
        tmp_path,
        report.Sentence(EVIL),
        report.Table([EVIL, "n"], [[EVIL, 1], [report.Cell(EVIL, to=EVIL), 2]], EVIL),
        report.Chart(EVIL, EVIL, EVIL, points),
        report.Bars(EVIL, EVIL, EVIL, [EVIL], {EVIL: [1], "other": [2]}),
        report.Picture(a, EVIL),
        report.Viewer(a, a, (EVIL, EVIL), labels={EVIL: (plane, [EVIL])}, told={EVIL: EVIL}, explained={EVIL: EVIL}),
        report.Group(EVIL, [], EVIL),
        results={"environment": {EVIL: EVIL}, "command": [EVIL]},
    )
    assert "<script>x" not in page
    assert page.count("</script>") == 2  # of the viewer's data, and of the page's own script
    assert page.count("</title>") == 1 + page.count("<title>") - 1
    assert html.escape(EVIL) in page


def test_what_does_not_print_or_turns_the_writing_is_spelt_out(tmp_path: Path) -> None:
    name = "caf\udce9 \u202eright to left\x1b[31m"
    plane, a = np.zeros((2, 2), int), np.zeros((2, 2, 3), np.float32)
    told = {"0,0": name}
    shown = report.Viewer(a, a, (name, "b"), labels={"object": (plane, [name])}, told=told, command=(name, ""))
    page = written(tmp_path, report.Sentence(name), shown, results={"command": [name]})
    spelt = "caf\\udce9 \\u202eright to left\\x1b[31m"
    assert page.count(spelt) == 2  # the sentence and the command
    data = shown.data()
    texts = json.loads(zlib.decompress(base64.b64decode(data["labels"]["object"]["texts"])))
    assert [*texts, data["names"][0], data["told"]["0,0"], data["command"][0]] == [spelt] * 4
    assert not [line for line in page.splitlines() if not line.replace("\N{NO-BREAK SPACE}", "").isprintable()]
    assert json.loads((tmp_path / "results.json").read_text())["command"] == [name]


def test_emoji_are_left_whole() -> None:
    family = "\N{WOMAN}\N{ZERO WIDTH JOINER}\N{GIRL}"
    assert printable(family) == family


def test_only_the_pages_own_script_and_styles_may_run(tmp_path: Path) -> None:
    page = written(tmp_path, style=".mine { color: red }")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)
    assert policy
    assert policy[1].startswith("default-src 'none'; ")
    assert "unsafe" not in policy[1]
    for kind in ("script", "style"):
        (text,) = re.findall(rf"<{kind}>(.*?)</{kind}>", page, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy[1]
    assert ".mine" in page


def test_the_pages_own_files_ask_nothing_of_the_network() -> None:
    for asset in ASSETS.iterdir():
        if asset.suffix in (".js", ".css", ".html"):
            assert not re.search(r"https?:|//[a-z]+\.|url\(|import |fetch\(|XMLHttp|eval\(|style=", asset.read_text())


def test_numbers_in_tables_are_aligned_and_short() -> None:
    table = report.Table(["what", "x"], [["a", 1234567], ["b", 1.23456e-9], ["c", math.inf], ["d", 0.25]]).html()
    shown = re.findall(r'<td class="number ">([^<]*)</td>', table)
    assert shown == ["1,234,567", "1.23e-09", "infinite", "0.25"]
    assert '<th scope="col" class="number">x</th>' in table


def test_a_cell_leads_to_its_group(tmp_path: Path) -> None:
    page = written(tmp_path, report.Table(["a"], [[report.Cell("b", to="A title")]]), report.Group("A title", []))
    (target,) = re.findall(r'href="#([^"]*)"', page)
    assert page.count(f'id="{target}"') == 1


def test_points_stand_where_their_logarithms_say() -> None:
    chart = report.Chart("t", "x", "y", {"a": [(1e-4, 1e-8), (1e-2, 1e-4), (1.0, 1.0), (0.0, 1.0), (1.0, math.nan)]})
    (points,) = re.findall(r'<polyline points="([^"]*)"', chart.html())
    x, y = np.array([point.split(",") for point in points.split()], float).T
    assert np.allclose(np.diff(x), np.diff(x)[0], rtol=0, atol=0.1)  # a tenth of a pixel is written
    assert np.allclose(np.diff(y), np.diff(y)[0], rtol=0, atol=0.1)
    assert (np.diff(x) > 0).all()
    assert (np.diff(y) < 0).all()  # up
    assert "(2 points cannot be shown on these axes)" in chart.html()


@pytest.mark.parametrize("points", [[], [(1.0, 1.0)], [(0.0, -1.0)], [(1e-300, 1e300)], [(math.inf, math.nan)]])
@pytest.mark.parametrize("log", [True, False])
def test_a_chart_of_little_is_still_drawn(points: list[tuple[float, float]], log: bool) -> None:
    drawn = report.Chart("t", "x", "y", {"a": points}, log, log).html()
    assert "nan" not in drawn
    assert drawn.count("<text") < 40


def test_bars_have_the_heights_of_their_numbers() -> None:
    drawn = report.Bars("t", "x", "y", ["p", "q"], {"a": [1, 3], "b": [2, 0]}).html()
    tops = [tuple(map(float, at)) for at in re.findall(r'y="([\d.]+)" width="[\d.]+" height="([\d.]+)"', drawn)]
    a_p, a_q, b_p, b_q = tops
    unit = a_p[1]
    assert np.allclose([a_q[1], b_p[1], b_q[1]], [3 * unit, 2 * unit, 0], rtol=0, atol=0.4)  # four numbers of 0.1
    assert abs(b_p[0] + b_p[1] - a_p[0]) <= 0.2  # b stands on a
    assert re.findall(r'class="sum"[^>]*>([^<]*)<', drawn) == ["3", "3"]
    empty = report.Bars("t", "x", "y", [], {}).html()
    assert "nan" not in empty


@pytest.mark.parametrize(
    ("counts", "shown"),
    [
        ([24700, 0, 5960, 28100], ["24,700", "5,960", "28,100"]),
        ([12345678, 3], ["3"]),  # too wide beside a neighbour, at thirteen bars
        ([240000, 240001, 1], ["240,000", "1"]),  # at one height
        ([0.25, 3e9], ["0.25"]),
    ],
)
def test_sums_over_bars_are_whole_and_leave_each_other_room(counts: list[float], shown: list[str]) -> None:
    counts = [*counts, *[0] * (13 - len(counts))]
    drawn = report.Bars("t", "x", "y", [str(k) for k in range(13)], {"a": counts}).html()
    assert re.findall(r'class="sum"[^>]*>([^<]*)<', drawn) == shown


# ----------------------------------------------------------------------------------------------------- viewer
def test_a_page_of_512_squared_stays_below_three_megabytes(tmp_path: Path, llvm_ad_rgb: str) -> None:
    """The scene whose picture compresses worst, with an error of about a rounding in every pixel, all different."""
    scene = mi.load_file(str(scene_files.find("textured")), optimize=False)
    film = mi.traverse(scene.sensors()[0].film())
    film["size"] = film["crop_size"] = (512, 512)
    film.update()
    a = np.array(mi.render(scene, spp=1))
    rng = np.random.default_rng(1)
    b = a * (1 + 2.0**-24 * rng.standard_normal(a.shape))
    index = (np.arange(512 * 512) // 97 % 200).reshape(512, 512)
    report.write(
        tmp_path,
        {},
        "t",
        [
            report.Viewer(
                a,
                b,
                bound=2.0**-20 * a,
                status=np.zeros((512, 512), np.uint8),
                numbers={"bounces": index % 7},
                labels={"object": (index, [f"ball_{k}" for k in range(200)])},
            )
        ],
    )
    size = (tmp_path / "report.html").stat().st_size
    print(f"{size / 1e6:.2f} MB")
    assert size < 3e6


def unpacked(packed: list[str], height: int, width: int) -> np.ndarray:
    """Undo what the page holds, as the browser does (test_browser.py compares with the browser itself)."""
    way, text = packed
    data = np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8).reshape(4, -1).T
    folded = np.ascontiguousarray(data).view("<u4").reshape(height, width)
    words = (folded >> 1) ^ (0 - (folded & 1)).astype(np.uint32)
    return words.cumsum(axis=0, dtype=np.uint32).cumsum(axis=1, dtype=np.uint32) if way == "smooth" else words


@pytest.mark.parametrize("shape", [(7, 5), (1, 23), (20, 3)])
def test_too_large_a_pair_is_shown_by_the_worst_pixel_of_each_block(
    shape: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer, "MOST_PIXELS", 10)
    rng = np.random.default_rng(2)
    b = rng.random((*shape, 3))
    a = (b + rng.random(b.shape)).astype(np.float32)
    a[0, 0, 0] = np.nan
    data = report.Viewer(a, b).data()
    step, height, width = data["step"], data["height"], data["width"]
    assert height * width <= 10
    assert data["of"] == [shape[1], shape[0]]
    error = np.nan_to_num(np.abs(a - b).max(axis=2), nan=np.inf)
    xs, ys = (unpacked(data["planes"][name], height, width) for name in "xy")
    shown = unpacked(data["planes"]["a1"], height, width).view(np.float32)
    for i in range(height):
        for j in range(width):
            block = error[i * step : (i + 1) * step, j * step : (j + 1) * step]
            y, x = ys[i, j], xs[i, j]
            assert (y // step, x // step) == (i, j)
            assert error[y, x] == block.max()
            assert shown[i, j] == a[y, x, 1]


# ------------------------------------------------------------------------------------------------------ words
def scene(equal: int, explained: int, unexplained: int) -> dict[str, Any]:
    return {"against": "", "pixels": {"equal": equal, "explained": explained, "unexplained": unexplained}}


def turned(*reasons: str) -> Difference:
    return Difference(1, 2, Status.EXPLAINED if reasons else Status.UNEXPLAINED, 0.1, 1e-7, reasons, 3, True)


SHADOW = "silhouette of `ball`, light `key_light`, bounce 0"


@pytest.mark.parametrize(
    ("counts", "differences", "sentence"),
    [
        ((65536, 0, 0), [], "All 65,536 pixels agree within their bound."),
        (
            (65505, 31, 0),
            [turned(SHADOW)] * 31,
            "99.95 % of 65,536 pixels agree within their bound; 31 differ, all on the shadow edge of `ball` from "
            "`key_light`.",
        ),
        (
            (97, 3, 0),
            [turned(SHADOW), turned("silhouette of `ball`, bounce 0"), turned("silhouette of `ball`, bounce 0")],
            "97.00 % of 100 pixels agree within their bound; 3 differ: 2 on the outline of `ball`, 1 on the shadow "
            "edge of `ball` from `key_light`.",
        ),
        (
            (98, 2, 0),
            [turned("silhouette of `ball`, bounce 1")] * 2,
            "98.00 % of 100 pixels agree within their bound; 2 differ, both on the outline of `ball` seen in a mirror.",
        ),
        (
            (999_999, 0, 1),
            [turned()],
            "99.99 % of 1,000,000 pixels agree within their bound; 1 differs without an explanation: a fault in one "
            "of the two programs.",
        ),
    ],
)
def test_the_verdict_is_a_sentence(counts: tuple[int, int, int], differences: list[Difference], sentence: str) -> None:
    assert words.of_scene(scene(*counts), differences) == sentence


@pytest.mark.parametrize("pixels", [3, 96, 16384, 262144, 10**8])
def test_what_is_not_whole_is_never_called_100_percent(pixels: int) -> None:
    said = words.of_scene(scene(pixels - 1, 0, 1), [turned()])
    share = float(said.split(" %")[0])
    assert share < 100
    assert share <= 100 * (pixels - 1) / pixels


@pytest.mark.parametrize(
    ("reason", "place"),
    [
        ("silhouette of `a`, bounce 0", "on the outline of `a`"),
        ("triangle edge of `a`, bounce 2", "on a triangle edge of `a` seen over 2 mirrors"),
        ("horizon n.l = 0 of `a`, light `b`, bounce 1", "where `a` turns away from `b` seen in a mirror"),
        ("facing of `a`, bounce 0", "where `a` turns its back to the ray"),
        ("spot cone of torch of `a`, bounce 0", "on `a` at the rim of the cone of `torch`"),
        ("something new", "by “something new”"),
        ("silhouette of `a`, light `b`, bounce 7`, bounce 0", "on the shadow edge of `a` from `b', bounce 7`"),
    ],
)
def test_a_turned_decision_is_told_as_a_place(reason: str, place: str) -> None:
    assert words.place(reason) == place


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"alternatives": 1}, "no yes/no decision on the way of this pixel is close enough for rounding to turn it."),
        ({"alternatives": 2}, "1 other way to decide within rounding was tried, and none gives A's colour."),
        (
            {"complete": False},
            "2 other ways to decide within rounding were tried, and none gives A's colour (the search ",
        ),
        ({"settled_by": "40 digits"}, "A's colour. B was computed again in 40 digits, and stands."),
    ],
)
def test_what_is_unexplained_says_what_was_tried(change: dict[str, Any], said: str) -> None:
    assert said in words.why(replace(turned(), **change))


def test_a_student_is_told_why_the_two_differ() -> None:
    assert words.why(turned(SHADOW, "tie of `floor`, bounce 1")) == (
        "This pixel lies on the shadow edge of `ball` from `key_light`, and on a tie of `floor` seen in a mirror, so "
        "close that float32 rounding decides whether it is on one side or the other. A has the colour that the "
        "reference finds on the other side."
    )
    assert words.why(turned("beyond float32: most draws decide otherwise")) == (
        "Explained: beyond float32: most draws decide otherwise."
    )
    assert "no number" in words.why(turned(), finite=False)


def test_several_scenes_are_summed_up() -> None:
    scenes = [scene(90, 10, 0), scene(95, 0, 5)]
    assert words.of_everything(scenes, 1, False) == (
        "92.50 % of 200 pixels agree within their bound in 2 scenes; 10 differ where rounding may turn a decision; "
        "5 pixels of 1 scene differ without an explanation; 1 scene not judged; not all scenes are done."
    )
