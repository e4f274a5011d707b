"""The plugins are there whenever Mitsuba and the package were imported, in either order, in every variant."""

from __future__ import annotations

import subprocess
import sys

import pytest

VARIANTS = ["scalar_rgb", "llvm_ad_rgb", "llvm_ad_mono"]

SCENE = """
scene = lambda: mi.load_dict({
    "type": "scene",
    "integrator": {"type": "whitted"},
    "camera": {"type": "perspective", "film": {
        "type": "hdrfilm", "width": 3, "height": 2, "pixel_format": "luminance", "filter": {"type": "box"}}},
    "light": {"type": "point", "position": [0, 0, 0], "intensity": 9.0},
    "triangle": {"type": "polygon", "vertices": "-9,-9,3 9,-9,3 0,9,3", "flip_normals": True,
                 "bsdf": {"type": "blinnphong", "diffuse_reflectance": 0.5}},
})
bytes_of = lambda scene: np.array(mi.render(scene, spp=1)).tobytes()
"""


def python(code: str) -> subprocess.CompletedProcess[str]:
    """Run a piece of Python on its own, so that nothing is registered before it."""
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)


def done(code: str) -> str:
    """Run a piece of Python that must succeed and say nothing on stderr."""
    result = python(code)
    assert (result.returncode, result.stderr) == (0, "")
    return result.stdout


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("first", ["package", "variant"])
def test_import_may_come_before_or_after_set_variant(first: str, variant: str) -> None:
    package = "import mitsuba_whitted\nimport mitsuba as mi\n"
    choice = f"import mitsuba as mi\nmi.set_variant({variant!r})\n"
    order = package + choice if first == "package" else choice + package
    assert done(order + 'print(type(mi.load_dict({"type": "whitted"})).__name__)').endswith("Whitted\n")


def test_importing_needs_and_sets_no_variant() -> None:
    assert done("import mitsuba_whitted, mitsuba as mi\nprint(mi.variant())") == "None\n"


def test_old_scenes_render_the_same_bytes_after_other_variants() -> None:
    done(f"""
import mitsuba_whitted, mitsuba as mi, numpy as np
{SCENE}
held, drawn = {{}}, {{}}
for variant in {VARIANTS}:
    mi.set_variant(variant)
    held[variant] = scene()
    drawn[variant] = bytes_of(held[variant])
    assert np.frombuffer(drawn[variant], np.float32).max() > 0
for variant in {VARIANTS[::-1] + VARIANTS}:
    mi.set_variant(variant)
    assert bytes_of(held[variant]) == drawn[variant], variant
    assert bytes_of(scene()) == drawn[variant], variant
""")


def test_a_variant_that_comes_back_keeps_its_classes() -> None:
    done("""
import mitsuba_whitted, mitsuba as mi
mi.set_variant("scalar_rgb")
before = type(mi.load_dict({"type": "whitted"}))
mi.set_variant("llvm_ad_rgb")
assert type(mi.load_dict({"type": "whitted"})) is not before
mi.set_variant("scalar_rgb")
assert type(mi.load_dict({"type": "whitted"})) is before
""")


def test_registering_again_and_reloading_change_nothing() -> None:
    """Mitsuba 3.10 reloads the module of an entry point at each change of variant."""
    done("""
import importlib, mitsuba_whitted, mitsuba as mi
mi.set_variant("scalar_rgb")
before = type(mi.load_dict({"type": "whitted"}))
mitsuba_whitted.register()
importlib.reload(mitsuba_whitted)
mi.set_variant("llvm_ad_rgb")
mi.set_variant("scalar_rgb")
assert type(mi.load_dict({"type": "whitted"})) is before
""")


@pytest.mark.parametrize("plugin", ["whitted", "blinnphong", "polygon"])
@pytest.mark.parametrize("variant", ["scalar_spectral", "llvm_ad_mono_polarized"])
def test_spectra_and_polarisation_are_refused_by_name(variant: str, plugin: str) -> None:
    result = python(f"""
import mitsuba_whitted, mitsuba as mi
mi.set_variant({variant!r})
mi.load_dict({{"type": {plugin!r}, "id": "mine"}})
""")
    assert result.returncode == 1
    assert f"{plugin} `mine`: draws in the rgb and mono variants, not in {variant}" in result.stderr


def test_other_plugins_still_load_in_a_spectral_variant() -> None:
    code = 'import mitsuba_whitted, mitsuba as mi\nmi.set_variant("scalar_spectral")\n'
    done(code + 'mi.load_dict({"type": "path"})')


def test_the_entry_point_of_mitsuba_names_the_package() -> None:
    from importlib.metadata import entry_points

    (entry,) = entry_points(group="mitsuba", name="whitted")
    assert entry.value == "mitsuba_whitted"
