"""`whitted render --target-error`."""

from __future__ import annotations

import numpy as np
import pytest

from whitted_validation.cli import run


@pytest.mark.parametrize("other", [["--grid", "2"], ["--reference"]])
def test_a_target_goes_with_no_grid_and_not_with_the_reference(tmp_path, capsys, other):
    picture = tmp_path / "picture.npy"
    assert run(["render", "lambert", "--target-error", "0.01", *other, "-o", str(picture)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert not picture.exists()


@pytest.mark.parametrize("value", ["0", "-1", "soon", "nan", "inf"])
def test_a_target_is_a_positive_number(tmp_path, capsys, value):
    assert run(["render", "lambert", "--target-error", value, "-o", str(tmp_path / "picture.npy")]) == 2
    assert "--target-error" in capsys.readouterr().err


def test_a_target_is_met_and_its_rays_are_counted(tmp_path, capsys):
    exact, refined = tmp_path / "exact.npy", tmp_path / "refined.npy"
    assert run(["render", "lambert", "--grid", "16", "-o", str(exact)]) == 0
    assert run(["render", "lambert", "--target-error", "0.002", "--stats", "-o", str(refined)]) == 0
    error = np.load(refined).astype(float) - np.load(exact)
    assert 0 < np.sqrt(np.mean(error**2)) <= 0.002
    counted = dict(line.split()[0::2] for line in capsys.readouterr().out.splitlines() if " rays " in line)
    assert 513 * 513 < int(counted["camera"]) < 4 * 512 * 512


def test_a_grid_on_the_command_line_comes_before_a_target_in_the_scene(tmp_path):
    scene = tmp_path / "scene.xml"
    text = """<scene version="3.0.0"><integrator type="whitted">{}</integrator><sensor type="perspective">
      <film type="hdrfilm"><integer name="width" value="9"/><integer name="height" value="9"/>
      <rfilter type="box"/></film>
      </sensor><shape type="sphere"><point name="center" value="0,0,5"/></shape>
      <emitter type="constant"/></scene>"""
    pictures = []
    for parameter in ("", '<float name="target_error" value="0.001"/>'):
        scene.write_text(text.format(parameter))
        assert run(["render", str(scene), "--grid", "2", "-o", str(tmp_path / "picture.npy")]) == 0
        pictures.append(np.load(tmp_path / "picture.npy"))
    assert np.array_equal(*pictures)
    assert run(["render", str(scene), "-o", str(tmp_path / "picture.npy")]) == 0
    assert not np.array_equal(pictures[0], np.load(tmp_path / "picture.npy"))
