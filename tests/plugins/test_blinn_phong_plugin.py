"""The `blinnphong` BSDF as others use it: in integrators of Mitsuba, in `twosided`; its manual page, its refusals."""

import math
import re

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

U = 2.0**-24  # unit roundoff of float32


def blinnphong(**parameters):
    return mi.load_dict({"type": "blinnphong", "id": "paint", **parameters})


# --- in scenes ---


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_mitsubas_own_integrators_draw_the_formula(any_variant, integrator):
    k_d, k_s, p, irradiance = 0.25, 0.5, 8.0, 2.0
    l = np.array([0.48, 0.6, 0.64])  # noqa: E741 (the formula's name), to the light
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": integrator, **({"max_depth": 2} if integrator == "path" else {})},
            "sensor": {
                "type": "orthographic",
                "to_world": mi.ScalarTransform4f().look_at([0, 0, 3], [0, 0, 0], [0, 1, 0]).scale([0.5, 0.5, 1]),
                "film": {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}},
            },
            "floor": {
                "type": "rectangle",
                "bsdf": {
                    "type": "blinnphong",
                    "diffuse_reflectance": k_d,
                    "specular_reflectance": k_s,
                    "mirror_reflectance": 0.5,
                    "exponent": p,
                },
            },
            "light": {"type": "directional", "direction": (-l).tolist(), "irradiance": irradiance},
        }
    )
    image = np.array(mi.render(scene, spp=16))
    h = l + np.array([0, 0, 1])
    h /= np.linalg.norm(h)
    expected = irradiance * (k_d * l[2] + k_s * h[2] ** p)
    # l, wi and the frame have a few roundings each: 10 u in n.l, 10 u p in the power; then the formula's own, 19 u at
    # p = 8 (`power_limit` of test_blinn_phong), and a mean of 16 samples. None is a random error: every sample of
    # every pixel is the same number.
    limit = irradiance * (10 * U * (k_d + k_s * p) + k_s * 19 * U) + 20 * U
    assert np.abs(image - expected).max() <= limit


def test_path_and_whitted_agree_on_one_light_without_mirrors(llvm_ad_rgb):
    k_d, k_s, p, width, height = 0.25, 0.5, 8.0, 24, 16

    def scene(integrator):
        look = mi.ScalarTransform4f().look_at([0, -2, 2], [0, 0, 0], [0, 0, 1])
        film = {"type": "hdrfilm", "width": width, "height": height, "rfilter": {"type": "box"}}
        material = {
            "type": "blinnphong",
            "diffuse_reflectance": k_d,
            "specular_reflectance": k_s,
            "exponent": p,
        }
        return mi.load_dict(
            {
                "type": "scene",
                "integrator": integrator,
                "sensor": {"type": "perspective", "fov": 40, "to_world": look, "film": film},
                "floor": {
                    "type": "rectangle",
                    "to_world": mi.ScalarTransform4f().scale(10),
                    "bsdf": material,
                },
                "light": {"type": "point", "position": [0.5, 1, 1.5], "intensity": 4.0},
            }
        )

    ours = np.array(mi.render(scene({"type": "whitted"}), spp=1)).reshape(-1, 3)
    path = scene({"type": "path", "max_depth": 2})  # along the same rays, through the pixels' centres
    y, x = np.mgrid[:height, :width]
    centres = mi.Point2f(np.float32((x + 0.5) / width).ravel(), np.float32((y + 0.5) / height).ravel())
    rays, _ = path.sensors()[0].sample_ray(0, 0.5, centres, 0.5)
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(0, width * height)
    theirs = np.array(path.integrator().sample(path, sampler, rays)[0]).T

    # Hit points are up to 4 from the camera and 1.5 from the light at least, with 8 roundings of their size:
    # 20 u in l, v and n.l, twice that in the power's n.h and in 1/distance^2. Each side may err by as much.
    relative = 2 * U * (20 + 40 + 40 * p)
    assert np.abs(ours - theirs).max() <= relative * theirs.max()
    assert theirs.min() > 0
    assert theirs.max() > 5 * theirs.min()


def test_the_path_integrator_sees_the_sky_in_the_mirror(llvm_ad_rgb):
    colour = [0.25, 0.5, 0.75]
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 2},
            "sensor": {
                "type": "orthographic",
                "to_world": mi.ScalarTransform4f().look_at([0, 2, 3], [0, 0, 0], [0, 1, 0]).scale([0.5, 0.5, 1]),
                "film": {"type": "hdrfilm", "width": 4, "height": 4, "rfilter": {"type": "box"}},
            },
            "mirror": {
                "type": "rectangle",
                "bsdf": {
                    "type": "blinnphong",
                    "diffuse_reflectance": 0.0,
                    "mirror_reflectance": {"type": "rgb", "value": colour},
                },
            },
            "sky": {"type": "constant", "radiance": 2.0},
        }
    )
    image = np.array(mi.render(scene, spp=16))
    # one product, division and product with a probability of 1, and a mean of 16 samples
    np.testing.assert_allclose(image, np.broadcast_to(2 * np.array(colour), image.shape), rtol=20 * U, atol=0)


def test_twosided_shows_the_same_material_or_a_second_one_behind(any_variant):
    front = {"type": "blinnphong", "diffuse_reflectance": 0.5, "specular_reflectance": 0.25, "exponent": 3.0}
    back = {"type": "blinnphong", "diffuse_reflectance": 0.125, "mirror_reflectance": 0.5}
    up, down = [0, 0.6, 0.8], [0, 0.6, -0.8]
    normal, below = mi.Vector3f(0, 0, 1), mi.Vector3f(0, 0, -1)
    ctx = mi.BSDFContext()

    def seen_from(wi):
        si = dr.zeros(mi.SurfaceInteraction3f)
        si.wi = mi.Vector3f(wi)
        return si

    def value(bsdf, wi, wo):
        return np.array(bsdf.eval(ctx, seen_from(wi), wo))

    of_front, of_back = (value(mi.load_dict(m), up, normal) for m in (front, back))
    one = mi.load_dict({"type": "twosided", "a": front})
    two = mi.load_dict({"type": "twosided", "a": front, "b": back})
    for bsdf, behind in ((one, of_front), (two, of_back)):
        np.testing.assert_array_equal(value(bsdf, up, normal), of_front)
        np.testing.assert_array_equal(value(bsdf, down, below), behind)
        assert not value(bsdf, up, below).any()
        assert not value(bsdf, down, normal).any()
    bs, weight = two.sample(ctx, seen_from(down), 0.0, mi.Point2f(0.2, 0.3))
    np.testing.assert_array_equal(np.ravel(bs.wo), np.float32([0, -0.6, -0.8]))
    assert np.all(np.array(weight) > 0)


# --- as a plugin ---


def test_the_snippets_of_the_manual_page_load_and_make_the_same_material(any_variant):
    page = type(blinnphong()).__doc__
    code = dict(re.findall(r"code-tab:: (\w+)\n(?: +:name:.*\n)?\n((?:.*\S.*\n)+)", page))
    from_xml = mi.load_string(code["xml"].replace("<bsdf ", '<bsdf version="3.0.0" ', 1))
    from_dict = mi.load_dict(eval(f"{{{code['python']}}}"))
    assert str(from_xml) == str(from_dict)
    assert str(from_xml).startswith("BlinnPhong[\n  diffuse_reflectance = ")


def test_the_manual_page_lists_every_parameter_with_its_default(any_variant):
    page = type(blinnphong()).__doc__
    listed = dict(re.findall(r"\* - (\w+)\n(?:.*\n)*?.*\(Default: ([^,)]*)", page))
    assert listed.pop("ambient_reflectance").startswith("the very texture")
    explicit = blinnphong(**{name: float(default) for name, default in listed.items()})
    assert str(explicit) == str(blinnphong())


@pytest.mark.parametrize("name", ["diffuse", "specular", "mirror", "ambient"])
@pytest.mark.parametrize("value", [-0.001, 1.001, math.nan, math.inf, -math.inf])
def test_reflectances_outside_the_unit_interval_are_refused_with_id_and_value(any_variant, name, value):
    name = f"{name}_reflectance"
    for given in (
        value,
        {"type": "rgb", "value": [0.5, value, 0.5]},
        {"type": "uniform", "value": value},
        {"type": "checkerboard", "color0": 0.5, "color1": value},
    ):
        with pytest.raises(RuntimeError, match=rf"blinnphong `paint`: {name} is .*, allowed is from 0 to 1"):
            blinnphong(**{name: given})


def test_a_bitmap_outside_the_unit_interval_is_refused(llvm_ad_rgb):
    def bitmap(brightest):
        pixels = mi.Bitmap(np.float32([[[0.5, 0.5, brightest]]]))
        return {"type": "bitmap", "bitmap": pixels, "raw": True}

    blinnphong(diffuse_reflectance=bitmap(1.0))
    for brightest in (1.5, math.nan):
        with pytest.raises(RuntimeError, match=r"blinnphong `paint`: diffuse_reflectance is .*, allowed is"):
            blinnphong(diffuse_reflectance=bitmap(brightest))


def test_a_bitmap_of_bytes_reaches_from_0_to_255(any_variant):
    pixels = mi.Bitmap(np.uint8([[[0, 128, 255]]]))
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.uv = mi.Point2f(0.5, 0.5)
    for raw in (False, True):
        bsdf = blinnphong(diffuse_reflectance={"type": "bitmap", "bitmap": pixels, "raw": raw})
        assert np.float32(bsdf.diffuse_reflectance.eval(si)).max() <= 1


@pytest.mark.parametrize("value", [-1.0, 1.0001e7, math.nan, math.inf])
def test_an_exponent_out_of_range_is_refused_with_id_and_value(any_variant, value):
    with pytest.raises(RuntimeError, match=r"blinnphong `paint`: exponent is .*, allowed is from 0 to 1e\+07"):
        blinnphong(exponent=value)


def test_an_exponent_is_no_colour(any_variant):
    with pytest.raises(RuntimeError, match=r"blinnphong `paint`: exponent is .*, allowed is a number or a texture"):
        blinnphong(exponent={"type": "rgb", "value": [1, 2, 3]})


def test_misspelt_parameters_and_wrong_types_are_refused(any_variant):
    with pytest.raises(RuntimeError, match="unreferenced property"):
        blinnphong(shininess=3.0)
    with pytest.raises(RuntimeError, match='"diffuse_reflectance" has the wrong type'):
        blinnphong(diffuse_reflectance="red")
