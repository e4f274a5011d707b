"""A judge that cannot fail is worthless: every fault on this list must end in unexplained pixels.

Faults are put into the plugin, the scene, the reference and the judge, one at a time. At most 5 % of the
pixels that a fault spoils may be called explained.
"""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

import whitted_reference
from whitted_reference import lights as reference_lights
from whitted_reference.camera import Camera
from whitted_reference.shapes import Sphere
from whitted_reference.trace import Tracer
from whitted_validation import bounds, noise, rounding, validation, verdict
from whitted_validation.cli import run
from whitted_validation.validation import Here
from whitted_validation.verdict import Judgement, Status, judge

mi.set_variant("scalar_rgb")  # the plugin's modules name Mitsuba's types

from mitsuba_whitted import camera, precise  # noqa: E402
from mitsuba_whitted import lights as plugin_lights  # noqa: E402
from mitsuba_whitted.materials import Materials  # noqa: E402
from mitsuba_whitted.stage import Stage  # noqa: E402
from mitsuba_whitted.surfaces import Surfaces  # noqa: E402

pytestmark = [pytest.mark.slow]

WIDTH, HEIGHT = 44, 33
MOST_EXPLAINED = 0.05

# One side of a steep tent with the normals of a round hill: the sun comes from behind it, and there is no
# other side to stand in the way.
HILL = """v -1 0 -1
v 1 0 -1
v 1 0 1
v -1 0 1
v 0 2 0
vn -0.8 0.2 -0.56
vn 0.8 0.2 -0.56
vn 0.8 0.2 0.56
vn -0.8 0.2 0.56
vn 0 1 0
f 4//4 5//5 1//1
"""

SCENE = """
<scene version="3.0.0">
  <integrator type="whitted"><integer name="max_depth" value="4"/><rgb name="ambient" value="0.3, 0.32, 0.35"/>
  </integrator>
  <sensor type="perspective" id="camera"><float name="fov" value="42"/>
    <transform name="to_world"><lookat origin="0, 3.2, -8" target="0, 0.9, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="WIDTH"/><integer name="height" value="HEIGHT"/>
      <rfilter type="box"/></film></sensor>
  <emitter type="constant" id="sky"><rgb name="radiance" value="0.2, 0.3, 0.5"/></emitter>
  <emitter type="point" id="lamp"><point name="position" value="-3, 5, -4"/>
    <rgb name="intensity" value="22, 21, 18"/></emitter>
  <emitter type="directional" id="sun"><vector name="direction" value="-0.6, -0.9, 0.5"/>
    <rgb name="irradiance" value="0.5, 0.45, 0.4"/></emitter>
  <emitter type="spot" id="torch"><rgb name="intensity" value="30, 30, 34"/><float name="cutoff_angle" value="24"/>
    <float name="beam_width" value="12"/><transform name="to_world"><lookat origin="3, 6, -3" target="1, 0, 0"
    up="0, 0, 1"/></transform></emitter>
  <shape type="rectangle" id="floor">
    <transform name="to_world"><rotate x="1" angle="-90"/><scale value="7"/></transform>
    <bsdf type="blinnphong"><texture type="checkerboard" name="diffuse_reflectance">
      <rgb name="color0" value="0.2, 0.25, 0.3"/><rgb name="color1" value="0.6, 0.6, 0.5"/>
      <transform name="to_uv"><scale x="6" y="6"/></transform></texture>
      <rgb name="mirror_reflectance" value="0.2"/></bsdf></shape>
  <shape type="rectangle" id="lid"><transform name="to_world"><rotate x="1" angle="90"/><scale value="3"/>
    <translate y="5.5" z="-4" x="-3"/></transform></shape>
  <shape type="sphere" id="chrome"><point name="center" x="-1.6" y="1" z="0.5"/>
    <bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.05"/><rgb name="specular_reflectance" value="0.4"/>
      <rgb name="mirror_reflectance" value="0.7, 0.72, 0.75"/><float name="exponent" value="60"/></bsdf></shape>
  <shape type="sphere" id="plum"><point name="center" x="0.4" y="1" z="0.5"/>
    <bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.4, 0.1, 0.25"/>
      <rgb name="specular_reflectance" value="0.5"/><float name="exponent" value="25"/></bsdf></shape>
  <shape type="obj" id="hill"><string name="filename" value="hill.obj"/><transform name="to_world">
    <translate x="2.4" z="-1.2"/></transform>
    <bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.3, 0.5, 0.2"/></bsdf></shape>
  <shape type="disk" id="leaf"><transform name="to_world"><rotate x="1" angle="60"/>
    <translate x="-3.4" y="2.4" z="1"/></transform>
    <bsdf type="twosided"><bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.5, 0.6, 0.1"/></bsdf>
    <bsdf type="diffuse"/></bsdf>
    </shape>
</scene>
""".replace("WIDTH", str(WIDTH)).replace("HEIGHT", str(HEIGHT))


def draw(folder: Path, text: str = SCENE, hill: str = HILL) -> np.ndarray:
    """Draw a scene with the plugin, faults and all."""
    (folder / "hill.obj").write_text(hill)
    (folder / "scene.xml").write_text(text)
    scene = mi.load_file(str(folder / "scene.xml"), optimize=False)
    return np.array(mi.render(scene, spp=1), np.float64)


def forget() -> None:
    """Drop tracers that were made without, or with, a fault."""
    bounds._tools.cache_clear()
    verdict._witnesses.cache_clear()


class Truth:
    """The scene without faults, and what the reference says of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.picture = draw(folder)
        self.scene = whitted_reference.load(folder / "scene.xml")
        forget()
        self.bounds = bounds.measure(self.scene, Here(), cache=validation.cache_folder())

    def judge(self, picture: np.ndarray) -> Judgement:
        """Judge a picture that should be this one."""
        return judge(self.scene, self.bounds, picture, Here())

    def is_caught(self) -> bool:
        """Draw the scene and judge it by the command."""
        return command_catches(self.folder)

    def catches(self, picture: np.ndarray, folder: Path) -> bool:
        """Judge a picture that should be this one by the command; it is put into `folder`."""
        return command_catches(self.folder, picture, folder)


def command_catches(scene_folder: Path, picture: np.ndarray | None = None, folder: Path = Path()) -> bool:
    """Run `whitted validate` on a scene, or a picture of it: exit code 1, and few pixels explained away."""
    options = []
    if picture is not None:
        np.save(folder / "other.npy", picture)
        options = ["--against", str(folder / "other.npy")]
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = run(["validate", str(scene_folder / "scene.xml"), "-m", "llvm_ad_rgb", *options])
    mi.set_log_level(mi.LogLevel.Error)
    counts = re.search(r"(\d+) unexplained, (\d+) explained", said.getvalue())
    assert counts, said.getvalue()
    unexplained, explained = map(int, counts.groups())
    print(f"exit code {code}, {unexplained} unexplained, {explained} explained")
    return code == 1 and unexplained > 0 and explained <= MOST_EXPLAINED * (unexplained + explained)


@contextlib.contextmanager
def here() -> Iterator[Here]:
    """Offer, in place of processes, this one, which has the faults."""
    yield Here()


@pytest.fixture(scope="module")
def truths() -> list[Truth]:
    return []


@pytest.fixture
def truth(
    llvm_ad_rgb: str,
    truths: list[Truth],
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Truth]:
    """Work it out once for all tests; with fresh tracers before and after."""
    mi.set_log_level(mi.LogLevel.Error)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))
    monkeypatch.setattr(validation, "processes", here)
    if not truths:
        truths.append(Truth(tmp_path_factory.mktemp("truth")))
    forget()
    yield truths[0]
    forget()


def test_the_scene_without_faults_is_good(truth: Truth) -> None:
    assert run(["validate", str(truth.folder / "scene.xml"), "-m", "llvm_ad_rgb"]) == 0
    judgement = truth.judge(truth.picture)
    assert judgement.good
    assert judgement.count(Status.EQUAL) > 0.99 * WIDTH * HEIGHT


# ---------------------------------------------------------------------------------------------- the plugin
Patch = Callable[[pytest.MonkeyPatch], None]


def replaced(owner: Any, name: str, make: Callable[[Any], Any]) -> Patch:
    """Replace a function by what `make` builds from it."""
    return lambda patch: patch.setattr(owner, name, make(getattr(owner, name)))


def sampled(change: Callable[[Any, Any], Any]) -> Patch:
    """Change what a light sends: change(sample, kind)."""

    def make(old: Any) -> Any:
        return lambda self, *args: change(old(self, *args), self.kind)

    return replaced(plugin_lights.Lights, "_sample", make)


def hit(change: Callable[[Any], Any]) -> Patch:
    """Change what is known of a hit."""
    return replaced(Surfaces, "hit", lambda old: lambda *args: change(old(*args)))


def phong(n: Any, h: Any, exponent: Any) -> Any:
    """Give Phong's (r.v)^p: the angle between r and v is twice that between n and h."""
    cosine = dr.dot(n, h)
    return dr.power(dr.maximum(2 * cosine * cosine - 1, 0), exponent)


def take(change: Callable[[Stage], None]) -> Patch:
    """Change the integrator's numbers."""

    def make(old: Any) -> Any:
        def changed(self: Stage, settings: Any) -> None:
            old(self, settings)
            change(self)

        return changed

    return replaced(Stage, "_take", make)


def deeper(stage: Stage) -> None:
    stage.max_depth = stage.max_depth + 1


def brighter(stage: Stage) -> None:
    stage.ambient = stage.ambient * 1.001


PLUGIN: dict[str, Patch] = {
    "exponent one percent up": replaced(precise, "specular_power", lambda f: lambda n, h, p: f(n, h, 1.01 * p)),
    "reflected vector for half vector": replaced(precise, "specular_power", lambda _: phong),
    "highlight a thousandth brighter": replaced(precise, "specular_power", lambda f: lambda *a: 1.001 * f(*a)),
    "no shadow rays": replaced(Surfaces, "blocked", lambda _: lambda *a: mi.Bool(False)),
    "no shadow from the sun": replaced(
        Surfaces, "blocked", lambda f: lambda self, ray, *a: f(self, ray, *a) & (ray.end < dr.inf)
    ),
    "no shadow from the lamps": replaced(
        Surfaces, "blocked", lambda f: lambda self, ray, *a: f(self, ray, *a) & (ray.end == dr.inf)
    ),
    "rays start a hundredth off": replaced(precise, "ray_offset", lambda f: lambda n, *a: (0.01 * n, mi.Float(0.01))),
    "shadow rays go on behind the lamp": sampled(lambda light, _: light._replace(end=mi.Float(dr.inf))),
    "shadow rays end at once": sampled(lambda light, _: light._replace(end=0.1 * light.distance)),
    "light falls off with the distance": sampled(
        lambda light, kind: light if kind == "directional" else light._replace(colour=light.colour * light.distance)
    ),
    "spot light a thousandth brighter": sampled(
        lambda light, kind: light._replace(colour=light.colour * 1.001) if kind == "spot" else light
    ),
    "spot light without its ramp": replaced(
        plugin_lights, "_READERS", lambda old: old | {"SpotLight": ("spot", without_ramp(old["SpotLight"][1]))}
    ),
    "one mirror more": take(deeper),
    "ambient a thousandth brighter": take(brighter),
    "no look at the geometric normal": hit(lambda h: h._replace(n_g=+h.n)),
    "flat shading": hit(lambda h: h._replace(n=h.n_g)),
    "hit points a thousandth off": hit(lambda h: h._replace(p=mi.Point3d(h.p + 1e-3 * mi.Vector3d(h.n)))),
    "lights a hundred thousandth brighter": sampled(lambda light, _: light._replace(colour=light.colour * 1.00001)),
    "backs look like fronts": replaced(
        Materials, "row_of", lambda f: lambda self, shape, behind: f(self, shape, mi.Bool(False))
    ),
    "texture upside down": replaced(
        Surfaces, "_texture_coordinates", lambda f: lambda *a: mi.Point2d(f(*a).y, f(*a).x + 0.01)
    ),
    "beta and gamma exchanged": replaced(precise, "barycentric", lambda f: lambda *a: f(*a)[::-1]),
    "spheres a thousandth greater": replaced(
        precise, "sphere_normal", lambda f: lambda w, d, r, t: f(w, d, 1.001 * r, t)
    ),
    "pixel centre a hundredth off": replaced(camera.Camera, "rays", lambda f: lambda self, x, y: f(self, x + 0.01, y)),
}


def without_ramp(read: Any) -> Any:
    def changed(*args: Any) -> Any:
        row, colour = read(*args)
        return [*row[:-2], row[-3], 0.0], colour  # the beam is as wide as the cone

    return changed


@pytest.mark.parametrize("fault", PLUGIN)
def test_a_fault_of_the_plugin_is_caught(truth: Truth, fault: str, monkeypatch: pytest.MonkeyPatch) -> None:
    PLUGIN[fault](monkeypatch)
    assert truth.is_caught()


# ----------------------------------------------------------------------------------------------- the scene
SCENES: dict[str, tuple[str, str]] = {
    "k_s of the plum": (
        '<rgb name="specular_reflectance" value="0.5"/>',
        '<rgb name="specular_reflectance" value="0.501"/>',
    ),
    "k_m of the floor": (
        '<rgb name="mirror_reflectance" value="0.2"/>',
        '<rgb name="mirror_reflectance" value="0.201"/>',
    ),
    "k_d of the hill": ("0.3, 0.5, 0.2", "0.301, 0.5, 0.2"),
    # The scene is about 14 wide.
    "lamp moved by a thousandth of the scene": ('value="-3, 5, -4"', 'value="-2.986, 5, -4"'),
    "sun turned": ('value="-0.6, -0.9, 0.5"', 'value="-0.6, -0.9, 0.501"'),
    "no falloff": (
        '<rgb name="ambient" value="0.3, 0.32, 0.35"/>',
        '<rgb name="ambient" value="0.3, 0.32, 0.35"/><string name="falloff" value="none"/>',
    ),
    "field of view": ('name="fov" value="42"', 'name="fov" value="42.02"'),
    "crop off by one": (
        '<rfilter type="box"/>',
        f'<rfilter type="box"/><integer name="crop_width" value="{WIDTH}"/><integer name="crop_offset_x" value="1"/>',
    ),
    "ball moved": ('x="0.4" y="1" z="0.5"', 'x="0.401" y="1" z="0.5"'),
    "exponent": ('name="exponent" value="25"', 'name="exponent" value="25.25"'),
    "cone": ('name="cutoff_angle" value="24"', 'name="cutoff_angle" value="24.1"'),
    "textbook's epsilon": (
        '<integer name="max_depth" value="4"/>',
        '<integer name="max_depth" value="4"/><float name="epsilon" value="0.1"/>',
    ),
}


@pytest.mark.parametrize("fault", SCENES)
def test_another_scene_is_caught(truth: Truth, fault: str, tmp_path: Path) -> None:
    before, after = SCENES[fault]
    assert SCENE.count(before) == 1
    text = SCENE.replace(before, after)
    if "crop" in fault:  # a wider film of which all but the first column is drawn
        text = text.replace(f'name="width" value="{WIDTH}"', f'name="width" value="{WIDTH + 1}"')
    assert truth.catches(draw(tmp_path, text), tmp_path)


def test_a_triangle_turned_over_is_caught(truth: Truth, tmp_path: Path) -> None:
    """Its winding decides where n_g points only if there are no normals, so both hills go without."""
    bare = "\n".join(line for line in HILL.splitlines() if line[:2] == "v ")
    faces = ["f 1 5 2", "f 4 5 1"]
    flat = SCENE.replace('value="hill.obj"/>', 'value="hill.obj"/><boolean name="face_normals" value="true"/>')
    other = tmp_path / "other"
    other.mkdir()
    turned = draw(other, flat, "\n".join([bare, "f 1 2 5", *faces[1:], ""]))
    draw(tmp_path, flat, "\n".join([bare, *faces, ""]))
    assert run(["validate", str(tmp_path / "scene.xml"), "-m", "llvm_ad_rgb"]) == 0
    assert command_catches(tmp_path, turned, other)


# ------------------------------------------------------------------------------------------- the reference
def moved_ray(old: Any) -> Any:
    def ray(self: Camera, x: Any, y: Any, *rest: Any) -> Any:
        return old(self, x + 0.01, y, *rest)

    return ray


REFERENCE: dict[str, Patch] = {
    "exponent one percent up": replaced(
        Tracer,
        "highlight",
        lambda f: lambda self, n, d, l, p: f(self, n, d, l, 1.01 * p),  # noqa: E741
    ),
    "nothing blocks": replaced(Tracer, "blocker", lambda _: lambda *a: None),
    "pixel centre a hundredth off": replaced(Camera, "ray", moved_ray),
    "spheres shade as if they were flatter": replaced(
        Sphere, "normals", lambda f: lambda self, e, d, t, p: f(self, e, d, t, (p[0], p[1] + 1e-3, p[2]))
    ),
    "cone without a ramp": replaced(
        reference_lights.Spot, "share", lambda _: lambda self, theta: 1.0 if theta < self.cutoff else 0.0
    ),
    "lamps a thousandth darker": replaced(
        reference_lights.Point,
        "arrive",
        lambda f: lambda self, *p: (*f(self, *p)[:4], tuple(0.999 * c for c in f(self, *p)[4])),
    ),
}


@pytest.mark.parametrize("fault", REFERENCE)
def test_a_fault_of_the_reference_is_caught(
    truth: Truth, fault: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    REFERENCE[fault](monkeypatch)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))  # what was traced without the fault is kept elsewhere
    assert truth.is_caught()


# ----------------------------------------------------------------------------------------------- the judge
def test_a_judge_without_bounds_is_caught(truth: Truth, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    replaced(rounding.Rounding, "bound", lambda f: lambda self, tree: f(self, tree)._replace(colour=np.zeros(3)))(
        monkeypatch
    )
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert truth.is_caught()


# -------------------------------------------------------------------------------------- painted pictures
def edges(values: np.ndarray) -> np.ndarray:
    """Mark pixels whose left or upper neighbour has another value."""
    marked = np.zeros(values.shape, bool)
    marked[:, 1:] |= values[:, 1:] != values[:, :-1]
    marked[1:] |= values[1:] != values[:-1]
    return marked


def seen(truth: Truth, what: Callable[[Any], Any]) -> np.ndarray:
    """Ask the reference something about the camera ray of every pixel."""
    recorder = rounding.Follower(truth.scene)
    answers = [[hash(what(recorder.record(x, y).root)) for x in range(WIDTH)] for y in range(HEIGHT)]
    return np.array(answers)


def test_magenta_silhouettes_are_caught(truth: Truth, tmp_path: Path) -> None:
    picture = truth.picture.copy()
    picture[edges(seen(truth, lambda root: root.shape))] = (1.0, 0.0, 1.0)
    assert truth.catches(picture, tmp_path)


def test_darker_shadow_edges_are_caught(truth: Truth, tmp_path: Path) -> None:
    picture = truth.picture.copy()
    picture[edges(seen(truth, lambda root: tuple(light.blocked_by for light in root.lights)))] *= 0.9
    assert truth.catches(picture, tmp_path)


def test_a_pixel_that_is_not_a_number_is_caught(truth: Truth, tmp_path: Path) -> None:
    picture = truth.picture.copy()
    picture[5, 7, 1] = np.nan
    assert truth.catches(picture, tmp_path)


def test_draws_do_not_depend_on_anything_but_the_pixel(truth: Truth) -> None:
    shaken = noise.Shaken(truth.scene)
    tree = rounding.Follower(truth.scene).record(20, 15)
    first = noise.sampled_bound(shaken, tree, 20, 15)
    noise.sampled_bound(shaken, tree, 3, 4)
    assert (noise.sampled_bound(shaken, tree, 20, 15).bound == first.bound).all()
