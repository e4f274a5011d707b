"""The `blinnphong` BSDF: its formula, its sampling, its sides, its derivatives."""

import math

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

U = 2.0**-24  # unit roundoff of float32
EXPONENTS = [0.0, 1.0, 10.0, 100.0, 1e3, 1e4]
DEGREES = [0.0, 45.0, 80.0, 89.5]
COMPONENTS = ["diffuse", "glossy", "mirror"]


def blinnphong(**parameters):
    return mi.load_dict({"type": "blinnphong", "id": "paint", **parameters})


def context(component=None, flags=None):
    ctx = mi.BSDFContext()
    if component is not None:
        ctx.component = COMPONENTS.index(component)
    if flags is not None:
        ctx.type_mask = int(flags)
    return ctx


def towards(degrees, azimuth=0.3):
    """Turn a unit vector away from the normal."""
    theta = math.radians(degrees)
    return [math.sin(theta) * math.cos(azimuth), math.sin(theta) * math.sin(azimuth), math.cos(theta)]


def hemisphere(count, seed=0):
    """Directions above the horizon, a fifth of them grazing, another fifth close to the normal."""
    rng = np.random.default_rng(seed)
    z = np.concatenate(
        [
            rng.uniform(0, 1, count - 2 * (count // 5)),
            10 ** rng.uniform(-6, -2, count // 5),
            1 - 10 ** rng.uniform(-6, -2, count // 5),
        ]
    )
    rng.shuffle(z)
    phi = rng.uniform(0, 2 * np.pi, count)
    r = np.sqrt(1 - z * z)
    return np.float32(np.stack([r * np.cos(phi), r * np.sin(phi), z], axis=1))


def seen_from(wi, uv=(0.5, 0.5)):
    si = dr.zeros(mi.SurfaceInteraction3f)
    si.wi = mi.Vector3f(wi)
    si.uv = mi.Point2f(uv)
    return si


def float32(values):
    """Make an array of what a BSDF returned: in scalar variants Python's own numbers are not yet rounded."""
    return np.array(values, dtype=np.float32)


def evaluate(bsdf, wi, wo, ctx=None):
    """Value (n, channels) and density (n,) for n pairs of directions, in any variant."""
    ctx = ctx or context()
    if not dr.is_jit_v(mi.Float):
        pairs = [
            bsdf.eval_pdf(ctx, seen_from(i), mi.Vector3f(o)) for i, o in zip(wi.tolist(), wo.tolist(), strict=True)
        ]
        return np.array([v for v, _ in pairs]), np.array([p for _, p in pairs])
    value, pdf = bsdf.eval_pdf(ctx, seen_from(np.ascontiguousarray(wi.T)), mi.Vector3f(np.ascontiguousarray(wo.T)))
    return np.array(value).T, np.array(pdf)


def cos_half(wi, wo):
    """n.h in float64, and 1 - n.h without cancellation."""
    s = wi.astype(float) + wo.astype(float)
    s /= np.linalg.norm(s, axis=-1, keepdims=True)
    tangent2 = s[..., 0] ** 2 + s[..., 1] ** 2
    return s[..., 2], tangent2 / (1 + s[..., 2])


def power_limit(exponent):
    """Bound the absolute error of (n.h)^p in float32.

    h has 6 roundings (a sum, half of three in the squared norm, root, reciprocal, product, difference), so
    that the chord e is off by 6 u and y = |e|^2 / 2 by 6 u sqrt(2 y). The power changes by at most
    p exp(-p y) 6 u sqrt(2 y), which is largest, 6 u sqrt(p / e), at y = 1 / 2p. With t = p y, logarithm and
    product add 7 u t exp(-t) <= 7 u / e, the exponential 3 u, the square at most 2 u: 8 u together.
    """
    return U * (6 * math.sqrt(exponent / math.e) + 8)


@pytest.mark.parametrize("exponent", [*EXPONENTS, 1e6])
def test_eval_is_the_textbooks_formula(any_variant, exponent):
    count = 300 if any_variant.startswith("scalar") else 30_000
    wi, wo = hemisphere(count, 1), hemisphere(count, 2)
    # half of the pairs near the mirror direction, where a narrow highlight is
    wo[::2] = wi[::2] * np.float32([-1, -1, 1]) + np.random.default_rng(3).normal(
        0, 1 / math.sqrt(exponent + 1), (len(wo[::2]), 3)
    ).astype(np.float32)
    wo[:, 2] = np.abs(wo[:, 2])
    wo = np.float32(wo / np.linalg.norm(wo.astype(float), axis=1, keepdims=True))
    k_d, k_s = 0.25, 0.5
    value, _ = evaluate(blinnphong(diffuse_reflectance=k_d, specular_reflectance=k_s, exponent=exponent), wi, wo)
    power = np.exp(exponent * np.log1p(-cos_half(wi, wo)[1]))
    expected = k_d * wo[:, 2].astype(float) + k_s * power
    assert (power > 0.1).sum() > count / 100  # the highlight was met
    limit = k_s * power_limit(exponent) + 2 * U  # and products and a sum no larger than 1
    assert np.abs(value - expected[:, None]).max() <= limit
    assert value.max() <= k_d + k_s


def test_exponent_zero_gives_the_full_highlight_wherever_the_light_is_seen(any_variant):
    wi, wo = hemisphere(200, 4), hemisphere(200, 5)
    value, _ = evaluate(blinnphong(diffuse_reflectance=0.0, specular_reflectance=1.0, exponent=0.0), wi, wo)
    assert (value == 1).all()


def test_the_highlight_is_never_brighter_than_its_coefficient(llvm_ad_rgb):
    wi = hemisphere(100_000, 6)
    wo = wi * np.float32([-1, -1, 1])
    for exponent in (1.0, 1e3, 1e7):
        value, _ = evaluate(blinnphong(diffuse_reflectance=0.0, specular_reflectance=1.0, exponent=exponent), wi, wo)
        assert value.max() <= 1
        assert value.min() >= 1 - power_limit(exponent)


def test_colours_are_those_of_the_channels_and_grey_is_their_luminance(llvm_ad_rgb, llvm_ad_mono):
    colours = {"diffuse_reflectance": [0.1, 0.2, 0.3], "specular_reflectance": [0.9, 0.5, 0.0]}
    materials = {name: {"type": "rgb", "value": value} for name, value in colours.items()}
    wi, wo = hemisphere(50, 7), hemisphere(50, 8)
    grey, _ = evaluate(blinnphong(**materials), wi, wo)
    mi.set_variant("llvm_ad_rgb")
    colour, _ = evaluate(blinnphong(**materials), wi, wo)
    luminance = mi.luminance(mi.Color3f(np.ascontiguousarray(colour.T)))
    # three products and two sums of numbers below 1, before and after
    np.testing.assert_allclose(grey[:, 0], np.array(luminance), rtol=0, atol=10 * U)
    assert not np.allclose(colour[:, 0], colour[:, 2])


def test_below_the_horizon_there_is_nothing(any_variant):
    bsdf = blinnphong(specular_reflectance=0.5, mirror_reflectance=0.5, exponent=0.0)
    up, down, level = [0, 0.6, 0.8], [0, 0.6, -0.8], [0, 1, 0]
    for wi, wo in [(up, down), (down, up), (down, down), (up, level), (level, up)]:
        value, pdf = bsdf.eval_pdf(context(), seen_from(wi), mi.Vector3f(wo))
        assert not float32(value).any()
        assert not float32(pdf).any()
    for wi in (down, level):
        for sample1 in (0.0, 0.3, 0.6, 0.99):
            bs, weight = bsdf.sample(context(), seen_from(wi), sample1, mi.Point2f(0.3, 0.4))
            assert not float32(weight).any()
            assert not float32(bs.pdf).any()
    value, pdf = bsdf.eval_pdf(context(), seen_from(up), mi.Vector3f(up), False)
    assert not float32(value).any()
    assert not float32(pdf).any()


def test_two_grazing_directions_may_be_opposite_within_rounding(any_variant):
    bsdf = blinnphong(specular_reflectance=1.0, exponent=0.0)
    si, wo = seen_from([1, 0, 1e-25]), mi.Vector3f(-1, 0, 1e-25)
    value, pdf = bsdf.eval_pdf(context(), si, wo)
    # |wi + wo|^2 = 4e-50 is no float32, so that h is lost and the term 0; scalar variants add up in float64
    assert set(np.ravel(value)) == {1.0 if any_variant == "scalar_rgb" else 0.0}
    assert np.isfinite(np.ravel(pdf)).all()


def test_eval_and_pdf_are_those_of_eval_pdf_to_the_bit(any_variant):
    bsdf = blinnphong(specular_reflectance=0.3, mirror_reflectance=0.2, exponent=20.0)
    for wi, wo in zip(hemisphere(10, 9).tolist(), hemisphere(10, 10).tolist(), strict=True):
        for ctx in (context(), *map(context, COMPONENTS)):
            si, wo = seen_from(wi), mi.Vector3f(wo)
            value, pdf, bs, weight = bsdf.eval_pdf_sample(ctx, si, wo, 0.7, mi.Point2f(0.2, 0.9))
            bs_alone, weight_alone = bsdf.sample(ctx, si, 0.7, mi.Point2f(0.2, 0.9))
            for a, b in [
                (value, bsdf.eval(ctx, si, wo)),
                (pdf, bsdf.pdf(ctx, si, wo)),
                (value, bsdf.eval_pdf(ctx, si, wo)[0]),
                (pdf, bsdf.eval_pdf(ctx, si, wo)[1]),
                (bs.wo, bs_alone.wo),
                (weight, weight_alone),
            ]:
                np.testing.assert_array_equal(float32(a), float32(b))


# --- sampling ---

CHI2_TESTS = len(DEGREES) * (len(EXPONENTS) + 2)


def accept(chi2):
    assert chi2.run(significance_level=0.01, test_count=CHI2_TESTS, quiet=True), chi2.messages


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize(
    ("component", "exponent"), [("diffuse", 0.0), (None, 10.0)], ids=["diffuse", "all smooth ones"]
)
def test_samples_have_the_density_that_pdf_says(llvm_ad_rgb, degrees, component, exponent):
    material = {"type": "blinnphong", "specular_reflectance": 0.9, "exponent": exponent}
    sample, pdf = mi.chi2.BSDFAdapter("blinnphong", material, towards(degrees), ctx=context(component))
    accept(
        mi.chi2.ChiSquareTest(
            mi.chi2.SphericalDomain(), sample, pdf, sample_dim=3, sample_count=200_000, res=51, ires=16
        )
    )


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("exponent", EXPONENTS)
def test_samples_of_the_highlight_have_the_density_that_pdf_says(llvm_ad_rgb, degrees, exponent):
    """Count in coordinates (c^(p+1), phi) of h with c = n.h, where no highlight is too narrow."""
    bsdf = blinnphong(specular_reflectance=1.0, exponent=exponent)
    ctx, wi = context("glossy"), mi.Vector3f(towards(degrees))

    def sample(numbers):
        bs, weight = bsdf.sample(ctx, seen_from(wi), numbers[0], mi.Point2f(numbers[1], numbers[2]))
        h = dr.normalize(wi + bs.wo)
        y = 0.5 * dr.squared_norm(mi.Vector3f(0, 0, 1) - h)
        log_c = dr.select(y < 1e-3, -y * (1 + y * (0.5 + y / 3)), dr.log(1 - y))
        where = mi.Vector2f(dr.exp((exponent + 1) * log_c), dr.atan2(h.y, h.x))
        return dr.select(weight.x > 0, where, mi.Vector2f(0.5, 0)), dr.select(weight.x > 0, mi.Float(1), 0)

    def density(where):
        log_c = dr.log(where.x) / (exponent + 1)
        c = dr.exp(log_c)
        sin = dr.sqrt(-2 * dr.sinh(log_c) * c)  # sqrt(1 - c^2)
        h = mi.Vector3f(sin * dr.cos(where.y), sin * dr.sin(where.y), c)
        cos = dr.dot(wi, h)
        jacobian = 4 * cos / ((exponent + 1) * dr.exp(exponent * log_c))  # of wo over (c^(p+1), phi)
        return dr.select(cos > 0, bsdf.pdf(ctx, seen_from(wi), 2 * cos * h - wi) * jacobian, 0)

    domain = mi.chi2.PlanarDomain(mi.ScalarBoundingBox2f([0, -math.pi], [1, math.pi]))
    accept(mi.chi2.ChiSquareTest(domain, sample, density, sample_dim=3, sample_count=200_000, res=51, ires=16))


def draw(bsdf, wi, ctx=None, count=100_000, seed=0):
    rng = np.random.default_rng(seed)
    numbers = rng.integers(0, 2**24, (3, count)) / 2**24
    numbers[:, :8] = [[0, 1 - U] * 4, [0, 0, 1 - U, 1 - U] * 2, [0] * 4 + [1 - U] * 4]
    x, y, z = (mi.Float(np.float32(n)) for n in numbers)
    return bsdf.sample(ctx or context(), seen_from(wi), x, mi.Point2f(y, z))


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("exponent", [0.0, 32.0, 1e4, 1e7])
def test_weight_times_density_is_the_value_and_every_sample_is_a_unit_vector(llvm_ad_rgb, degrees, exponent):
    bsdf = blinnphong(specular_reflectance=0.5, mirror_reflectance=0.25, exponent=exponent)
    wi = towards(degrees)
    bs, weight = draw(bsdf, wi)
    value, pdf = bsdf.eval_pdf(context(), seen_from(wi), bs.wo)
    mirror = np.array(bs.sampled_component) == COMPONENTS.index("mirror")
    smooth = ~mirror
    assert np.isfinite(np.array(weight)).all()
    assert np.all(np.array(bs.eta) == 1)
    # h and wo carry some 10 roundings each, from numbers below 2
    np.testing.assert_allclose(np.array(dr.norm(bs.wo)), 1, rtol=0, atol=20 * U)

    np.testing.assert_array_equal(np.array(bs.pdf)[smooth], np.array(pdf)[smooth])
    product = np.array(weight * bs.pdf)  # a reciprocal and two products: 3 u
    np.testing.assert_allclose(product[:, smooth], np.array(value)[:, smooth], rtol=3 * U, atol=0)

    np.testing.assert_allclose(product[:, mirror], 0.25, rtol=3 * U, atol=0)
    x, y, z = np.float32(wi)
    np.testing.assert_array_equal(np.array(bs.wo)[:, mirror].T, np.tile([-x, -y, z], (mirror.sum(), 1)))


def test_each_component_is_sampled_as_often_as_its_probability_says(llvm_ad_rgb):
    k_d, k_s, k_m, p = 0.5, 0.75, 1.0, 14.0
    bsdf = blinnphong(diffuse_reflectance=k_d, specular_reflectance=k_s, mirror_reflectance=k_m, exponent=p)
    bs, _ = draw(bsdf, towards(30))
    shares = np.array([math.pi * k_d, 8 * math.pi / (p + 2) * k_s, k_m])
    counts = np.bincount(np.array(bs.sampled_component), minlength=3)
    expected = 100_000 * shares / shares.sum()
    # Binomial: six standard deviations, passed by chance three times in 10^9, and the eight extreme samples.
    assert (np.abs(counts - expected) <= 6 * np.sqrt(expected) + 8).all()


MANY = 1_000_000


def off_its_mean(weights):
    """Bound how far the mean of `draw(count=MANY)` may be off: six standard deviations, and what float32 adds.

    A weight carries 40 u: probability 6, exponent and constant 2, |wi + wo| 4, their products and quotients 5, value
    4, weight 2; and |wi + wo|, at least sqrt 2 above the horizon, feels the 16 u of the direction (h 10, reflection
    6). The highlight's power is the same in value and density. Random numbers are the lower ends of cells of 2^-24,
    three times, and eight of them are extreme.
    """
    most = np.abs(weights).max()
    return 6 * weights.std() / math.sqrt(MANY) + (40 + 3) * U * most + 8 / MANY * (weights.max() - weights.min())


def mean_weight(bsdf, wi, ctx):
    """Mean of the weights, and how far it may be off."""
    _, weight = draw(bsdf, wi, ctx, count=MANY)
    weights = np.array(weight)[0].astype(float)
    return weights.mean(), off_its_mean(weights)


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_under_a_white_sky_each_term_reflects_what_the_manual_says(llvm_ad_rgb, exponent):
    bsdf = blinnphong(diffuse_reflectance=0.25, specular_reflectance=0.5, mirror_reflectance=0.125, exponent=exponent)
    albedos = {
        "diffuse": 0.25 * math.pi,
        "glossy": 0.5 * 8 * math.pi * (1 - 2 ** (-(exponent + 2) / 2)) / (exponent + 2),
        "mirror": 0.125,
    }
    for component, albedo in albedos.items():
        mean, deviation = mean_weight(bsdf, [0, 0, 1], context(component))
        assert abs(mean - albedo) <= deviation, component
    mean, deviation = mean_weight(bsdf, [0, 0, 1], context())
    assert abs(mean - sum(albedos.values())) <= deviation


# --- components ---


def test_components_and_types_switch_terms_off_and_add_up(any_variant):
    bsdf = blinnphong(specular_reflectance=0.5, mirror_reflectance=0.25, exponent=5.0)
    flags = mi.BSDFFlags
    kinds = [flags.DiffuseReflection, flags.GlossyReflection, flags.DeltaReflection]
    assert bsdf.component_count() == 3
    for index, kind in enumerate(kinds):
        assert bsdf.flags(index) == int(kind | flags.FrontSide)
    assert bsdf.flags() == int(kinds[0] | kinds[1] | kinds[2] | flags.FrontSide)

    si, wo = seen_from([0, 0.6, 0.8]), mi.Vector3f(0, 0, 1)
    whole = np.array(bsdf.eval(context(), si, wo))
    terms = [np.array(bsdf.eval(context(name), si, wo)) for name in COMPONENTS]
    np.testing.assert_array_equal(terms[0] + terms[1], whole)
    assert not terms[2].any()
    for term, name, kind in zip(terms, COMPONENTS, kinds, strict=True):
        np.testing.assert_array_equal(np.array(bsdf.eval(context(flags=kind), si, wo)), term)
        for sample1 in (0.0, 0.5, 0.999):
            for ctx in (context(name), context(flags=kind)):
                bs, weight = bsdf.sample(ctx, si, sample1, mi.Point2f(0.1, 0.3))
                assert np.ravel(bs.sampled_component) == COMPONENTS.index(name)
                assert np.ravel(bs.sampled_type) == int(kind)
                assert np.all(np.array(weight) > 0)
                if name != "mirror":
                    np.testing.assert_array_equal(float32(bs.pdf), float32(bsdf.pdf(ctx, si, bs.wo)))


def test_a_black_component_is_never_sampled_and_an_all_black_material_fails(llvm_ad_rgb):
    bs, _ = draw(blinnphong(mirror_reflectance=0.3), towards(20))
    assert set(np.array(bs.sampled_component)) == {0, 2}
    black = blinnphong(diffuse_reflectance=0.0)
    bs, weight = draw(black, towards(20))
    value, pdf = black.eval_pdf(context(), seen_from(towards(20)), mi.Vector3f(0, 0, 1))
    for nothing in (weight, bs.pdf, value, pdf):
        assert not float32(nothing).any()


def test_the_diffuse_term_is_reciprocal_and_the_highlight_is_in_eval(llvm_ad_rgb):
    bsdf = blinnphong(specular_reflectance=0.5, exponent=7.0)
    wi, wo = hemisphere(1000, 11), hemisphere(1000, 12)
    there, back = (evaluate(bsdf, a, b, context("glossy"))[0] for a, b in ((wi, wo), (wo, wi)))
    np.testing.assert_array_equal(there, back)
    there, back = (evaluate(bsdf, a, b, context("diffuse"))[0] / b[:, 2:] for a, b in ((wi, wo), (wo, wi)))
    np.testing.assert_array_equal(there, back)


def test_the_diffuse_albedo_is_pi_times_the_diffuse_coefficient(any_variant):
    albedo = blinnphong(diffuse_reflectance=0.25).eval_diffuse_reflectance(seen_from([0, 0, 1]))
    np.testing.assert_array_equal(np.array(albedo), np.float32(np.pi) * np.float32(0.25))


# --- textures, edits, derivatives ---


def board(a, b):
    return {"type": "checkerboard", "color0": a, "color1": b}


def test_every_parameter_may_be_a_texture(any_variant):
    bsdf = blinnphong(
        diffuse_reflectance=board(0.25, 0.75),
        specular_reflectance=board(0.5, 0.125),
        mirror_reflectance=board(0.0, 1.0),
        exponent=board(1.0, 2.0),
    )
    assert all(bsdf.flags(i) & int(mi.BSDFFlags.SpatiallyVarying) for i in range(3))
    wo = mi.Vector3f(0, 0, 1)
    for uv, k_d, k_s, k_m, p in [((0.1, 0.1), 0.25, 0.5, 0, 1.0), ((0.1, 0.6), 0.75, 0.125, 1, 2.0)]:
        si = seen_from([0, 0.6, 0.8], uv)
        value = np.array(bsdf.eval(context(), si, wo))
        uniform = blinnphong(diffuse_reflectance=k_d, specular_reflectance=k_s, exponent=p)
        np.testing.assert_array_equal(value, np.array(uniform.eval(context(), si, wo)))
        bs, _ = bsdf.sample(context(), si, 0.0, mi.Point2f(0.5, 0.5))
        assert np.ravel(bs.sampled_component) == (2 if k_m else 0)


def test_an_exponent_from_a_texture_is_clamped(llvm_ad_rgb):
    si, wo = seen_from(towards(1)), mi.Vector3f(towards(1.01))
    for given, used in ((-3.0, 0.0), (1e9, 1e7)):
        clamped, plain = (blinnphong(specular_reflectance=1.0, exponent=e) for e in (board(given, given), used))
        for a, b in zip(clamped.eval_pdf(context(), si, wo), plain.eval_pdf(context(), si, wo), strict=True):
            np.testing.assert_array_equal(np.array(a), np.array(b))


def test_parameters_are_exposed_under_their_names_and_edits_count(any_variant):
    bsdf = blinnphong()
    parameters = mi.traverse(bsdf)
    names = ["diffuse_reflectance", "specular_reflectance", "mirror_reflectance", "exponent"]
    assert [key for key, _ in parameters] == [f"{name}.value" for name in names]  # ambient is diffuse
    edits = {
        "diffuse_reflectance": 0.125,
        "specular_reflectance": 0.75,
        "mirror_reflectance": 0.5,
        "exponent": 3.0,
    }
    for name, value in edits.items():
        parameters[f"{name}.value"] = value
    parameters.update()
    fresh = blinnphong(**edits)
    si, wo = seen_from([0, 0.6, 0.8]), mi.Vector3f(0, 0, 1)
    for a, b in zip(bsdf.eval_pdf(context(), si, wo), fresh.eval_pdf(context(), si, wo), strict=True):
        np.testing.assert_array_equal(np.array(a), np.array(b))
    assert str(bsdf) == str(fresh)


def test_the_ambient_texture_is_the_diffuse_one_unless_given(any_variant):
    bsdf = blinnphong(diffuse_reflectance=0.25)
    assert bsdf.ambient_reflectance is bsdf.diffuse_reflectance
    bsdf = blinnphong(diffuse_reflectance=0.25, ambient_reflectance=0.75)
    assert "ambient_reflectance.value" in mi.traverse(bsdf)
    si = seen_from([0, 0, 1])
    assert np.all(np.array(bsdf.ambient_reflectance.eval(si)) == 0.75)
    assert np.ravel(bsdf.eval_attribute_1("ambient_reflectance", si)) == 0.75
    assert np.ravel(bsdf.eval_attribute_1("exponent", si)) == 32
    assert np.all(bsdf.has_attribute("mirror_reflectance"))
    assert not np.any(bsdf.has_attribute("shininess"))


def test_derivatives_of_eval_are_the_difference_quotients_of_the_formula(llvm_ad_rgb):
    wi, wo = hemisphere(2000, 13), hemisphere(2000, 14)
    wo[:3] = [[-0.6, 0, -0.8], -wi[1], [1, 0, 0]]  # below, opposite and level: no NaN from there
    given = {"diffuse_reflectance": 0.25, "specular_reflectance": 0.5, "exponent": 20.0}
    bsdf = blinnphong(**given)
    parameters = mi.traverse(bsdf)
    above = wo[:, 2] > 0

    def formula(k_d, k_s, p):
        power = np.exp(p * np.log1p(-cos_half(wi[above], wo[above])[1]))
        return k_d * wo[above, 2].astype(float) + k_s * power

    for position, name in enumerate(given):
        key = f"{name}.value"
        dr.enable_grad(parameters[key])
        parameters.update()
        value = bsdf.eval(context(), seen_from(np.ascontiguousarray(wi.T)), mi.Vector3f(np.ascontiguousarray(wo.T)))
        dr.forward(parameters[key])
        derivative = np.array(dr.grad(value))[0]
        step = 1e-4 * np.array([position == i for i in range(3)])
        quotient = (formula(*(np.array([*given.values()]) + step)) - formula(*([*given.values()] - step))) / 2e-4
        # error of the quotient: step^2 / 6 times a third derivative below 1; of float32: that of the power,
        # whose logarithm, at most 1/(e p), multiplies it
        assert np.abs(derivative[above] - quotient).max() <= 1e-8 + power_limit(20.0), name
        assert not derivative[~above].any()
        dr.disable_grad(parameters[key])
        parameters.update()


def test_derivatives_of_sampled_light_are_those_of_its_mean(llvm_ad_rgb):
    p = 10.0
    given = {
        "diffuse_reflectance": 0.25,
        "specular_reflectance": 0.5,
        "mirror_reflectance": 0.25,
        "exponent": p,
    }
    half = 2 ** (-(p + 2) / 2)
    albedo = 8 * math.pi * (1 - half) / (p + 2)  # of the highlight with k_s = 1
    slope = 8 * math.pi * (half * math.log(2) / 2 / (p + 2) - (1 - half) / (p + 2) ** 2)  # its derivative by p
    expected = [math.pi, albedo, 1, 0.5 * slope]
    for name, derivative in zip(given, expected, strict=True):
        bsdf = blinnphong(**given)
        parameters = mi.traverse(bsdf)
        dr.enable_grad(parameters[f"{name}.value"])
        parameters.update()
        _, weight = draw(bsdf, [0, 0, 1], count=MANY)
        dr.forward(parameters[f"{name}.value"])
        grad = np.array(dr.grad(weight))[0].astype(float)
        # The logarithm of n.h, which the derivative by p has besides, is below 1 and known to 9 u (`power_limit`).
        assert abs(grad.mean() - derivative) <= off_its_mean(grad) + 9 * U * np.abs(grad).max(), name
