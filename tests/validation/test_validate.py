"""`whitted validate`: exit codes, results.json, the page, and the Python API."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np
import pytest

import whitted_reference
import whitted_validation
from whitted_validation.cli import run
from whitted_validation.refusal import Refusal
from whitted_validation.report.verdicts import _scene
from whitted_validation.seen import look
from whitted_validation.validation import Here
from whitted_validation.verdict import Status

SCENE = """<scene version="3.0.0"><integrator type="whitted"/>
  <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="12"/><integer name="height" value="8"/>
    <rfilter type="box"/></film></sensor>
  <emitter type="point" id="lamp"><point name="position" value="0, 3, 2"/><rgb name="intensity" value="9"/></emitter>
  <shape type="sphere" id="ball"><point name="center" value="0, 0, 5"/></shape>EXTRA</scene>"""


@pytest.fixture
def scene(tmp_path: Path, llvm_ad_rgb: str, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a small scene, with the cache beside it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file = tmp_path / "<i>ball & co.xml"
    file.write_text(SCENE.replace("EXTRA", ""))
    return file


def judged(arguments: list[str]) -> int:
    code = run(["validate", *arguments])
    mi.set_log_level(mi.LogLevel.Warn)
    return code


def test_a_good_scene_ends_with_0_and_a_complete_report(scene: Path, tmp_path: Path) -> None:
    assert judged([str(scene), "--report", str(tmp_path / "report")]) == 0
    results = json.loads((tmp_path / "report/results.json").read_text())
    assert (results["schema"], results["exit"], results["complete"]) == (2, 0, True)
    assert results["sentence"] == "All 96 pixels agree within their bound."
    (facts,) = results["scenes"]
    assert facts["pixels"] == {"equal": 96, "explained": 0, "unexplained": 0}
    assert facts["certified"] == {"rounding": 96, "noise": 0, "interval": 0, "decimal": 0}
    assert (facts["chaotic"], facts["loose"]) == (0, {"texture": 0, "grazing": 0, "mirrors": 0})
    assert facts["error"]["largest"] <= facts["bound"]["largest"]
    assert sum(bounce["pixels"] for bounce in facts["by_bounce"]) == 96
    assert all(sum(bounce["errors"]) == bounce["pixels"] and bounce["ratio"] <= 1 for bounce in facts["by_bounce"])
    assert sorted(file.name for file in (tmp_path / "report").iterdir()) == ["report.html", "results.json"]


def test_the_page_loads_nothing_and_names_are_escaped(
    scene: Path, tmp_path: Path, read_page: Callable[[str], Any]
) -> None:
    judged([str(scene), "--report", str(tmp_path / "report")])
    page = read_page((tmp_path / "report/report.html").read_text())
    assert len(page.sources) == 1  # from the table to the scene
    assert page.sources[0].startswith("#at-")
    assert not {"i", "img", "link", "iframe", "object"} & set(page.tags)
    assert "<i>ball & co" in page.text
    assert "All 96 pixels agree within their bound." in page.text


def test_another_picture_ends_with_1_and_the_worst_pixel_first(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = whitted_validation.validate(scene, executor=Here()).judgement.picture
    picture[4, 6] += 0.25
    picture[3, 5] += 0.125
    np.save(tmp_path / "other.npy", picture)
    mi.Bitmap(picture.astype(np.float32)).write(str(tmp_path / "other.exr"))
    for name in ("other.npy", "other.exr"):
        assert judged([str(scene), "--against", str(tmp_path / name), "--report", str(tmp_path)]) == 1
        (facts,) = json.loads((tmp_path / "results.json").read_text())["scenes"]
        assert [(d["x"], d["y"], d["status"]) for d in facts["differences"]] == [
            (6, 4, "unexplained"),
            (5, 3, "unexplained"),
        ]
        assert facts["sentence"].startswith("97.91 % of 96 pixels agree within their bound; 2 differ without")
        assert all(d["told"].startswith("Unexplained. A and B differ by more than") for d in facts["differences"])
    assert "2 unexplained" in capsys.readouterr().out


def test_what_the_reader_of_a_given_picture_remarks_is_said(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(SCENE.replace("EXTRA", '<emitter type="constant" id="sky"/>'))
    picture = whitted_validation.validate(scene, executor=Here()).judgement.picture
    capsys.readouterr()
    np.save(tmp_path / "other.npy", np.dstack([picture, np.full((8, 12), 0.5)]))
    assert judged([str(scene), "--against", str(tmp_path / "other.npy"), "--report", str(tmp_path)]) == 0
    remarks = [f"{tmp_path / 'other.npy'}: alpha, not 1 in 96 pixels, is left out"]
    remarks += whitted_reference.load(scene).messages
    assert capsys.readouterr().err.splitlines() == [f"whitted: {remark}" for remark in remarks]
    (facts,) = json.loads((tmp_path / "results.json").read_text())["scenes"]
    assert facts["remarks"] == remarks
    assert remarks[0] in (tmp_path / "report.html").read_text()


def test_what_is_off_its_bound_for_a_turned_decision_does_not_count_for_the_largest_ratio(scene: Path) -> None:
    verdict = whitted_validation.validate(scene, executor=Here())
    seen = look(verdict.description, Here())
    before = _scene(verdict, seen)["by_bounce"][0]["ratio"]
    verdict.judgement.picture[4, 6] += 0.25
    for status, larger in ((Status.EXPLAINED, False), (Status.UNEXPLAINED, True)):
        verdict.judgement.status[4, 6] = status
        ratio = _scene(verdict, seen)["by_bounce"][0]["ratio"]
        assert ratio > 1 if larger else 0 < ratio <= before


def test_no_name_reaches_the_terminal_as_a_command(
    scene: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hostile = tmp_path / "a\x1b]0;title\x07\u202eb\nc.xml"
    for arguments in ([], ["--against", str(hostile)]):
        assert judged([str(scene), "--size", "9\x1bx", *arguments]) == 2
        assert judged([str(hostile), *arguments]) == 2
    scene.rename(hostile)
    assert judged([str(hostile)]) == 0
    captured = capsys.readouterr()
    lines = (captured.out + captured.err).splitlines()
    assert len(lines) == 6
    assert all(line.isprintable() for line in lines)
    assert r"a\x1b]0;title\x07\u202eb" in lines[0]


@pytest.mark.parametrize(
    ("extra", "words"),
    [
        ('<emitter type="constant" id="a"/><shape type="sphere"><bsdf type="plastic" id="p"/></shape>', "not judged"),
        ('<shape type="sphere"><float name="radius" value="-1"/></shape>', "radius"),
    ],
)
def test_what_the_reference_does_not_know_ends_with_2(
    scene: Path, extra: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    scene.write_text(SCENE.replace("EXTRA", extra))
    assert judged([str(scene)]) == 2
    error = capsys.readouterr().err
    assert words in error
    assert "Traceback" not in error


def test_a_bad_scene_does_not_hide_a_good_one(scene: Path, tmp_path: Path) -> None:
    other = tmp_path / "bad.xml"
    other.write_text(SCENE.replace("EXTRA", '<shape type="sphere"><bsdf type="plastic"/></shape>'))
    assert judged([str(other), str(scene), "--report", str(tmp_path)]) == 2
    results = json.loads((tmp_path / "results.json").read_text())
    assert len(results["scenes"]) == len(results["not_judged"]) == 1
    assert "not judged" in results["not_judged"][0]["why"]


def test_ctrl_c_keeps_what_is_done_and_says_one_line(scene: Path, tmp_path: Path, llvm_ad_rgb: str) -> None:
    code = "import sys; from whitted_validation.cli import main; main()"
    arguments = ["validate", str(scene), "many_spheres", "--size", "96x96", "--report", str(tmp_path / "report")]
    file = tmp_path / "report/results.json"
    # A process group of its own: the signal goes to the workers too, as it does on a terminal.
    process = subprocess.Popen(
        [sys.executable, "-c", code, *arguments], stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    end = time.monotonic() + 100
    while not (file.is_file() and json.loads(file.read_text())["scenes"]):
        assert time.monotonic() < end
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    error = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert error.splitlines()[-1] == "whitted: interrupted"
    assert "Traceback" not in error
    results = json.loads(file.read_text())
    assert (results["complete"], len(results["scenes"])) == (False, 1)
    assert results["sentence"].endswith("not all scenes are done.")


def test_ctrl_c_while_mitsuba_loads_a_scene_is_no_fault_of_the_scene(
    scene: Path, llvm_ad_rgb: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object, **__: object) -> None:
        raise RuntimeError("At scene.xml: failed to instantiate integrator plugin: KeyboardInterrupt")

    monkeypatch.setattr(mi, "load_file", interrupted)
    assert judged([str(scene)]) == 130


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["--all", "lambert"],
        ["lambert", "--size", "12"],
        ["lambert", "--size", "0x12"],
        ["lambert", "--grid", "0"],
        ["lambert", "gold", "--against", "a.npy"],
        ["lambert", "--against", "a.png"],
        ["lambert", "--against", "missing.npy"],
        ["lambert", "-s", "7", "--size", "4x4"],
        ["lambert", "-m", "llvm_ad_spectral", "--size", "4x4"],
        ["no_such_scene"],
    ],
)
def test_misuse_ends_with_2_and_one_line(
    arguments: list[str], llvm_ad_rgb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert judged(arguments) == 2
    lines = [line for line in capsys.readouterr().err.splitlines() if "lights no surface" not in line]
    assert lines[-1].startswith("whitted: ")
    assert "Traceback" not in "".join(lines)


def test_size_grid_and_sensor_reach_both_programs(scene: Path) -> None:
    verdict = whitted_validation.validate(scene, size=(10, 6), grid=2, executor=Here())
    assert verdict.good
    assert verdict.judgement.picture.shape == (6, 10, 3)
    with pytest.raises(Refusal, match="-s 3"):
        whitted_validation.validate(scene, sensor=3, executor=Here())


def test_a_verdict_shows_itself(scene: Path) -> None:
    verdict = whitted_validation.validate(scene, executor=Here())
    assert str(verdict).endswith("0 unexplained, 0 explained, 96 equal of 12 x 8 pixels")
    assert verdict._repr_html_().count("data:image/png") == 3  # A, B and the error


def test_importing_the_package_is_light() -> None:
    code = "import sys, whitted_validation; print({'numpy', 'mitsuba'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "set()"
