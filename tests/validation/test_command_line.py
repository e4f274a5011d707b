"""The command line does what it says, seen from outside: files, exit codes, and what is printed where."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

MAIN = "from whitted_validation.cli import main\nmain()"

SCENE = """<scene version="3.0.0">
  <default name="shine" value="30"/>
  <integrator type="whitted" id="integrator">
    <rgb name="ambient" value="0.25"/>
  </integrator>
  <sensor type="perspective" id="camera">
    <float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0,2,-6" target="0,0,0" up="0,1,0"/></transform>
    <sampler type="independent" id="sampler"><integer name="sample_count" value="4"/></sampler>
    <film type="hdrfilm" id="film">
      <integer name="width" value="12"/>
      <integer name="height" value="9"/>
      <rfilter type="box" id="filter"/>
    </film>
  </sensor>
  <emitter type="point" id="lamp">
    <point name="position" value="3,5,-4"/>
    <rgb name="intensity" value="30"/>
  </emitter>
  <shape type="sphere" id="ball">
    <bsdf type="blinnphong" id="paint">
      <rgb name="diffuse_reflectance" value="0.5,0.25,0.125"/>
      <rgb name="specular_reflectance" value="0.5"/>
      <rgb name="mirror_reflectance" value="0.5"/>
      <float name="exponent" value="$shine"/>
    </bsdf>
  </shape>
  <shape type="rectangle" id="floor">
    <transform name="to_world">
      <rotate x="1" angle="-90"/>
      <scale value="4"/>
      <translate y="-1"/>
    </transform>
  </shape>
</scene>
"""


def whitted(*arguments: str | Path, cwd: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command that must succeed."""
    command = [sys.executable, "-c", MAIN, *map(str, arguments)]
    variables = {**os.environ, **environment}
    result = subprocess.run(command, cwd=cwd, env=variables, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stderr
    return result


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Make a folder with a small scene in it."""
    (tmp_path / "scene.xml").write_text(SCENE)
    return tmp_path


def draw(folder: Path, *arguments: str) -> np.ndarray:
    """Render the scene to numbers."""
    whitted("render", "scene.xml", "-o", "picture.npy", *arguments, cwd=folder)
    picture: np.ndarray = np.load(folder / "picture.npy")
    return picture


def test_the_default_variant_is_announced_in_one_line_on_stderr(folder: Path) -> None:
    result = whitted("render", "scene.xml", cwd=folder)
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert result.stderr.startswith("whitted: variant ")


def test_a_variant_that_was_asked_for_is_not_announced(folder: Path) -> None:
    assert whitted("render", "scene.xml", "-m", "llvm_ad_rgb", cwd=folder).stderr == ""


def test_without_a_usable_libllvm_scalar_rgb_draws_and_the_line_says_so(folder: Path) -> None:
    result = whitted("render", "scene.xml", cwd=folder, DRJIT_LIBLLVM_PATH="/no/libLLVM.so")
    lines = [line for line in result.stderr.splitlines() if "terrible performance" not in line]
    assert len(lines) == 1
    assert lines[0].startswith("whitted: variant scalar_rgb, slow: no usable libLLVM (/no/libLLVM.so, set by")
    assert (folder / "scene.exr").is_file()


@pytest.mark.skipif(sys.platform == "win32", reason="has no pseudo-terminals")
def test_progress_on_a_terminal_changes_no_byte(folder: Path) -> None:
    import pty

    larger = SCENE.replace('"width" value="12"', '"width" value="40"').replace(
        '"height" value="9"', '"height" value="30"'
    )
    (folder / "scene.xml").write_text(larger)
    quiet = draw(folder, "--grid", "64")  # 4.9 million samples: several bands where somebody watches
    ours, theirs = pty.openpty()
    command = [sys.executable, "-c", MAIN, "render", "scene.xml", "-o", "watched.npy", "--grid", "64"]
    with subprocess.Popen(command, cwd=folder, stderr=theirs) as process:
        os.close(theirs)
        shown = b""
        with contextlib.suppress(OSError):  # a closed terminal ends with an error
            while part := os.read(ours, 4096):
                shown += part
    os.close(ours)
    assert process.returncode == 0
    assert b"watched.npy" in shown
    assert b"100%" in shown
    assert np.load(folder / "watched.npy").tobytes() == quiet.tobytes()


@pytest.mark.skipif(sys.platform == "win32", reason="has no SIGINT for a single process")
@pytest.mark.parametrize("seconds", [0.0, 0.03, 1.0])  # while the kernel is recorded, compiled, run
def test_an_interrupted_command_ends_at_once_and_leaves_nothing(folder: Path, seconds: float) -> None:
    endless = SCENE.replace('"width" value="12"', '"width" value="4096"')
    endless = endless.replace('"height" value="9"', '"height" value="4096"')
    (folder / "scene.xml").write_text(endless)
    command = [sys.executable, "-c", MAIN, "render", "scene.xml", "--grid", "64"]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr
        assert process.stderr.readline().startswith("whitted: variant")
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        try:
            _, rest = process.communicate(timeout=60)  # the picture would take hours
        finally:
            process.kill()
    assert (process.returncode, rest.splitlines()[-1]) == (130, "whitted: interrupted")
    assert [path.name for path in folder.iterdir()] == ["scene.xml"]


def test_the_picture_goes_beside_the_scene_by_default_as_in_mitsuba(folder: Path) -> None:
    (folder / "below").mkdir()
    (folder / "scene.xml").rename(folder / "below" / "scene.xml")
    whitted("render", "below/scene.xml", cwd=folder)
    assert sorted(path.name for path in folder.rglob("*")) == ["below", "scene.exr", "scene.xml"]


def test_a_shipped_scene_is_drawn_into_the_current_folder(tmp_path: Path) -> None:
    whitted("render", "empty", cwd=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["empty.exr"]


def test_exr_and_npy_hold_the_same_float32_numbers(folder: Path, scalar_rgb: str) -> None:
    import mitsuba as mi

    numbers = draw(folder)
    whitted("render", "scene.xml", "-o", "picture.exr", cwd=folder)
    bitmap = mi.Bitmap(str(folder / "picture.exr"))
    assert bitmap.component_format() == mi.Struct.Type.Float32
    assert numbers.dtype == np.float32
    assert np.array(bitmap).tobytes() == numbers.tobytes()


def test_png_is_srgb_of_the_exposed_picture(folder: Path, scalar_rgb: str) -> None:
    import mitsuba as mi

    exposed = np.clip(draw(folder).astype(np.float64) * 4, 0, 1)
    srgb = np.where(exposed <= 0.0031308, 12.92 * exposed, 1.055 * exposed ** (1 / 2.4) - 0.055)
    whitted("render", "scene.xml", "-o", "picture.png", "--exposure", "2", cwd=folder)
    bitmap = mi.Bitmap(str(folder / "picture.png"))
    assert (bitmap.component_format(), bitmap.srgb_gamma()) == (mi.Struct.Type.UInt8, True)
    # The nearest of 256 steps, and a handful of roundings of float64 on the way there.
    assert np.abs(np.array(bitmap).astype(np.float64) - 255 * srgb).max() <= 0.5 + 255 * 2.0**-48


def test_an_existing_picture_is_replaced(folder: Path) -> None:
    (folder / "picture.npy").write_text("old")
    assert draw(folder).shape == (9, 12, 3)
    assert sorted(path.name for path in folder.iterdir()) == ["picture.npy", "scene.xml"]


def test_the_same_command_writes_the_same_bytes(folder: Path) -> None:
    written = []
    for name in ("exr", "png", "npy"):
        for _ in range(2):
            whitted("render", "scene.xml", "-o", f"picture.{name}", cwd=folder)
            written.append((folder / f"picture.{name}").read_bytes())
        assert written[-1] == written[-2], name


def test_the_number_of_threads_changes_no_byte(folder: Path) -> None:
    assert draw(folder, "-t", "1").tobytes() == draw(folder, "-t", "2").tobytes()


def test_threads_are_as_many_as_asked_for(folder: Path) -> None:
    code = (
        "from whitted_validation.cli import run\nimport drjit as dr\n"
        "run(['render', 'scene.xml', '-m', 'llvm_ad_rgb', '-t', '3'])\nprint(dr.thread_count())"
    )
    result = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True)
    assert result.stdout == "3\n", result.stderr


def test_grid_defaults_to_the_sample_count(folder: Path) -> None:
    assert draw(folder).tobytes() == draw(folder, "--grid", "2").tobytes()
    assert draw(folder).tobytes() != draw(folder, "--grid", "1").tobytes()


def test_define_sets_a_parameter_in_both_spellings(folder: Path) -> None:
    sharp = draw(folder, "-Dshine=900")
    assert sharp.tobytes() == draw(folder, "-D", "shine=900").tobytes()
    assert sharp.tobytes() == draw(folder, "--define", "shine=900").tobytes()
    assert sharp.tobytes() != draw(folder).tobytes()


def test_terms_add_up_to_the_whole(folder: Path) -> None:
    """Without mirrors the picture is a sum: u = 2**-24 for each of three additions, and one in each part."""
    whole = draw(folder, "--no-mirrors").astype(np.float64)
    parts = [draw(folder, "--no-mirrors", "--only", term) for term in ("ambient", "diffuse", "specular")]
    total = np.sum(parts, axis=0, dtype=np.float64)
    assert all(part.max() > 0 for part in parts)
    # 4 samples of 3 terms: each sum of positive numbers is off by at most its number of additions times u.
    additions = 3 + 4
    assert np.all(np.abs(total - whole) <= 2 * additions * 2.0**-24 * whole)


def test_only_and_no_switch_parts_off(folder: Path) -> None:
    lit = draw(folder)
    assert (draw(folder, "--no-shadows") >= lit).all()
    assert (draw(folder, "--no-shadows") > lit).any()
    assert (draw(folder, "--no-mirrors") < lit).any()
    assert draw(folder, "--only", "ambient,diffuse,specular").tobytes() == lit.tobytes()


def test_files_under_an_extra_folder_are_allowed(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "shared").mkdir()
    (tmp_path / "shared" / "light.xml").write_text(
        '<emitter type="point" version="3.0.0" id="second"><rgb name="intensity" value="9"/></emitter>'
    )
    included = SCENE.replace("</scene>", '<include filename="light.xml"/></scene>')
    (tmp_path / "mine" / "scene.xml").write_text(included)
    whitted("render", "mine/scene.xml", "-a", "shared;mine", cwd=tmp_path)
    assert (tmp_path / "mine" / "scene.exr").is_file()


def test_nothing_is_taken_from_the_current_folder(tmp_path: Path) -> None:
    """Mitsuba looks there first; then one scene would be two pictures."""
    (tmp_path / "mine").mkdir()
    triangle = "v -9 -9 {z}\nv 9 -9 {z}\nv 0 9 {z}\nf 3 2 1\n"
    (tmp_path / "triangle.obj").write_text(triangle.format(z=-3))
    (tmp_path / "mine" / "triangle.obj").write_text(triangle.format(z=3))
    mesh = '<shape type="obj" id="triangle"><string name="filename" value="triangle.obj"/></shape></scene>'
    (tmp_path / "mine" / "scene.xml").write_text(SCENE.replace("</scene>", mesh))
    whitted("render", "mine/scene.xml", "-o", "above.npy", cwd=tmp_path)
    whitted("render", "scene.xml", "-o", "inside.npy", cwd=tmp_path / "mine")
    assert (tmp_path / "above.npy").read_bytes() == (tmp_path / "mine" / "inside.npy").read_bytes()


def test_another_integrator_is_replaced_with_a_message(folder: Path) -> None:
    whole = draw(folder, "--only", "diffuse,specular")
    begin, end = SCENE.index("  <integrator"), SCENE.index("  <sensor")
    (folder / "scene.xml").write_text(SCENE[:begin] + '<integrator type="path" id="i"/>' + SCENE[end:])
    result = whitted("render", "scene.xml", "-m", "llvm_ad_rgb", "-o", "path.npy", cwd=folder)
    assert result.stderr == ("whitted: scene.xml: has the integrator `path`; drawn by whitted with its defaults\n")
    assert np.load(folder / "path.npy").tobytes() == whole.tobytes()


@pytest.mark.parametrize(
    ("axis", "warned"),
    [
        ('x="1"', False),
        ('x="0.6" z="-0.8"', False),
        ('value="0.57735027"', False),
        ('x="1" y="1"', True),
        ('value="2"', True),
    ],
)
def test_a_rotation_axis_that_is_no_unit_vector_is_warned_of(folder: Path, axis: str, warned: bool) -> None:
    (folder / "scene.xml").write_text(SCENE.replace('<rotate x="1" angle', f"<rotate {axis} angle"))
    lines = whitted("render", "scene.xml", "-m", "llvm_ad_rgb", cwd=folder).stderr.splitlines()
    assert [line.split(": ")[1:3] for line in lines] == [["scene.xml:30", "<rotate>"]] * warned


def test_stats_count_pixels_and_rays(folder: Path) -> None:
    lines = whitted("render", "scene.xml", "--grid", "3", "--stats", cwd=folder).stdout.splitlines()
    table = {line[:14].strip(): line[14:].split()[0] for line in lines}
    assert list(table) == ["pixels", "camera rays", "mirror rays", "shadow rays", "kernel time", "total time"]
    assert table["pixels"] == str(12 * 9)
    assert table["camera rays"] == str(12 * 9 * 9)
    assert 0 < int(table["mirror rays"]) < 12 * 9 * 9
    assert 12 * 9 * 9 // 2 < int(table["shadow rays"]) < 2 * 12 * 9 * 9
    assert 0 < float(table["kernel time"]) < float(table["total time"])


def test_both_programs_encode_a_png_alike(folder: Path, scalar_rgb: str) -> None:
    import mitsuba as mi

    from whitted_validation import picture_files

    for ending in ("npy", "png"):
        whitted("render", "scene.xml", "--reference", "-o", f"reference.{ending}", cwd=folder)
    picture_files.write(folder / "ours.png", np.load(folder / "reference.npy"))
    ours, theirs = (np.array(mi.Bitmap(str(folder / f"{name}.png"))) for name in ("ours", "reference"))
    assert ours.tobytes() == theirs.tobytes()


def test_the_reference_draws_the_same_picture_without_mitsuba(folder: Path) -> None:
    code = (
        "import sys\nfrom whitted_validation.cli import run\n"
        "assert run(['render', 'scene.xml', '--reference', '--grid', '1', '-o', 'reference.npy']) == 0\n"
        "assert not {'mitsuba', 'drjit', 'numpy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], cwd=folder, check=True)
    reference = np.load(folder / "reference.npy")
    assert reference.shape == (9, 12, 3)
    assert reference.dtype == np.float64
    np.save(folder / "single.npy", reference.astype(np.float32))  # as a picture that is to be judged
    told = whitted("validate", "scene.xml", "--against", "single.npy", cwd=folder).stdout
    assert "0 unexplained, 0 explained, 108 equal" in told


def test_plan_says_what_the_kernel_holds(folder: Path) -> None:
    present, absent = whitted("plan", "scene.xml", cwd=folder).stdout.split("left out:")
    assert "1 point" in present
    assert "sphere" in present
    assert "instances" in absent


def test_scenes_are_listed_with_their_purpose(tmp_path: Path) -> None:
    lines = whitted("scenes", cwd=tmp_path).stdout.splitlines()
    assert len(lines) > 10
    assert all(len(line.split(maxsplit=1)) == 2 for line in lines)


def test_copied_scenes_can_be_drawn(tmp_path: Path) -> None:
    copied = whitted("scenes", "--copy", "mine", cwd=tmp_path).stdout.split()
    assert "mine/empty.xml" in copied
    whitted("render", "mine/empty.xml", cwd=tmp_path)


def test_scenes_are_never_copied_over_anything(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "empty.xml").write_text("dear to me")
    command = [sys.executable, "-c", MAIN, "scenes", "--copy", "mine"]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (2, "whitted: mine: is not empty; name a new folder\n")
    assert (tmp_path / "mine" / "empty.xml").read_text() == "dear to me"


def test_doctor_names_the_libllvm_and_tries_the_variants(tmp_path: Path) -> None:
    text = whitted("doctor", cwd=tmp_path).stdout
    for part in ("mitsuba 3.9", "drjit", "libLLVM", "scalar_rgb     works", "llvm_ad_rgb    works"):
        assert part in text


def test_doctor_does_not_try_a_libllvm_that_would_abort(tmp_path: Path) -> None:
    text = whitted("doctor", cwd=tmp_path, DRJIT_LIBLLVM_PATH="/no/libLLVM.so").stdout
    for part in (
        "problem: no usable libLLVM",
        "pip install",
        "scalar_rgb     works",
        "llvm_ad_rgb    not tried",
    ):
        assert part in text


def test_shipped_scenes_pass_the_look_before_mitsuba() -> None:
    from whitted_validation.scene_check import check
    from whitted_validation.scene_files import shipped

    for scene in shipped():
        assert check(scene).objects
