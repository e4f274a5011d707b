"""Floats, forty digits and intervals: each by itself, and that they agree on pictures."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable
from decimal import Decimal, localcontext
from fractions import Fraction

import pytest

from whitted_reference import Tracer, intervals
from whitted_reference.arithmetic import _PI, DECIMAL, FLOAT, INTERVAL
from whitted_reference.image import resized
from whitted_reference.intervals import Interval, Undecided
from whitted_reference.proof import TARGET, Prover

NUMBERS = [0.0, 1.0, -1.0, 0.1, -0.3, 1 / 3, 2.0**-1074, 1e-300, 1e300, 7e-17, math.pi, 2.0**53 + 2]


# --------------------------------------------------------------------------------------------- intervals
@pytest.mark.parametrize("operation", ["+", "-", "*", "/"])
def test_interval_operations_enclose_the_exact_result(operation):
    exact: Callable[[Fraction, Fraction], Fraction] = eval(f"lambda a, b: a {operation} b")
    enclosed: Callable[[Interval, Interval], Interval] = eval(f"lambda a, b: a {operation} b")
    values = [*NUMBERS, *(random.Random(1).uniform(-9, 9) for _ in range(20))]
    for a, b in itertools.product(values, values):
        if operation == "/" and b == 0.0:
            continue
        result = enclosed(INTERVAL.of(a), INTERVAL.of(b))
        truth = exact(Fraction(a), Fraction(b))
        if math.isfinite(result.low):
            assert Fraction(result.low) <= truth
        if math.isfinite(result.high):
            assert truth <= Fraction(result.high)
        # No wider than one unit in the last place, so exact floats stay points; far from the range's ends.
        if all(1e-200 < abs(x) < 1e200 for x in (a, b)):
            assert result.high <= math.nextafter(result.low, math.inf)


def test_interval_operations_enclose_what_their_members_give():
    rng = random.Random(2)
    for _ in range(300):
        a, b = (Interval(*sorted((rng.uniform(-4, 4), rng.uniform(-4, 4)))) for _ in range(2))
        x, y = rng.uniform(a.low, a.high), rng.uniform(b.low, b.high)
        p, q = Fraction(x), Fraction(y)
        cases = [(a + b, p + q), (a - b, p - q), (a * b, p * q), (a * a, p * p), (-a, -p), (abs(a), abs(p))]
        for result, truth in cases:
            assert Fraction(result.low) <= truth <= Fraction(result.high)
        assert (a * a).low >= 0.0


@pytest.mark.parametrize("name", ["sqrt", "exp", "log1p", "power", "atan2"])
def test_interval_functions_enclose_forty_digits(name):
    rng = random.Random(3)
    inner, outer = getattr(DECIMAL, name), getattr(intervals, name)
    for _ in range(200):
        x, y = rng.uniform(0.0, 9.0), rng.uniform(-9.0, 9.0)
        arguments = {
            "sqrt": (x,),
            "exp": (y,),
            "log1p": (x,),
            "power": (x, y),
            "atan2": (y, rng.uniform(-9, 9)),
        }[name]
        width = rng.choice([0.0, 1e-9, 0.1]) if name != "atan2" else 0.0
        enclosure = outer(*(Interval(a, a + width) for a in arguments))
        truth = inner(*(Decimal(a + width / 2) for a in arguments))
        assert Decimal(enclosure.low) <= truth <= Decimal(enclosure.high)


def test_overlapping_intervals_leave_comparisons_undecided():
    low, high, across = Interval(0.0, 1.0), Interval(2.0, 3.0), Interval(0.5, 2.5)
    assert low < high
    assert not high <= low
    assert low != high
    assert high != low
    assert Interval(1.0, 1.0) == 1
    for compare in (
        "low < across",
        "low <= across",
        "low > across",
        "low >= across",
        "low == across",
        "high != across",
    ):
        with pytest.raises(Undecided):
            eval(compare, {"low": low, "high": high, "across": across})
    with pytest.raises(Undecided, match="division"):
        1 / Interval(-1.0, 1.0)
    with pytest.raises(Undecided, match="floor"):
        intervals.floor(across)
    with pytest.raises(Undecided, match="atan2"):
        intervals.atan2(Interval(-1.0, 1.0), Interval(-2.0, -1.0))


# --------------------------------------------------------------------------------------------- 40 digits
def test_pi_is_machins():
    # Machin 1706: pi = 16 atan(1/5) - 4 atan(1/239), in 60 digits.
    def atan_inverse(n: int) -> Decimal:
        total, power, k = Decimal(0), Decimal(1) / n, 1
        while power > Decimal(10) ** -60:
            total += power / k if k % 4 == 1 else -power / k
            power /= n * n
            k += 2
        return total

    with localcontext() as context:
        context.prec = 60
        assert abs(16 * atan_inverse(5) - 4 * atan_inverse(239) - _PI) < Decimal(10) ** -50


def test_decimal_atan2_inverts_sine_and_cosine_to_forty_digits():
    # The series of sine and cosine in 60 digits, at angles all around.
    with localcontext() as context:
        context.prec = 60
        for i in range(-50, 51):
            angle = Decimal(i) / 16
            if abs(angle) >= _PI:
                continue
            sine, cosine, term = Decimal(0), Decimal(0), Decimal(1)
            for k in range(80):
                if k % 2:
                    sine += term if k % 4 == 1 else -term
                else:
                    cosine += term if k % 4 == 0 else -term
                term *= angle / (k + 1)
            error = abs(DECIMAL.atan2(7 * sine, 7 * cosine) - angle)
            # One unit in the 40th digit.
            assert error <= (abs(angle) or Decimal(1)) * Decimal(10) ** -39


def test_decimal_atan2_agrees_with_floats_on_the_axes():
    for y, x in itertools.product((-1.0, 0.0, 1.0), repeat=2):
        assert float(DECIMAL.atan2(Decimal(y), Decimal(x))) == math.atan2(y, x)


def test_decimal_log1p_keeps_forty_digits_of_small_numbers():
    x = Decimal("1e-20")
    series = x - x * x / 2 + x * x * x / 3
    with localcontext() as context:
        context.prec = 60
        assert abs(DECIMAL.log1p(x) - series) <= x * Decimal(10) ** -29  # 50 digits of 1 + x are 30 of x


# ----------------------------------------------------------------------------------------- whole pictures
STILL_LIFE = """
  <shape type="sphere" id="mirror"><point name="center" value="-1,1,0"/>
    <bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.1 0.2 0.1"/>
      <float name="mirror_reflectance" value="0.7"/><float name="specular_reflectance" value="0.5"/>
      <float name="exponent" value="1000"/></bsdf></shape>
  <shape type="cylinder" id="tube"><point name="p0" value="1,0,1"/><point name="p1" value="1.3,1.5,1"/>
    <float name="radius" value="0.5"/><bsdf type="twosided"><bsdf type="blinnphong"/></bsdf></shape>
  <shape type="cube" id="box"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="30"/>
    <translate x="0.3" y="0.4" z="2"/></transform></shape>
  <shape type="disk" id="disk"><transform name="to_world"><scale x="0.5" y="0.8"/><rotate x="1" angle="20"/>
    <translate x="2" y="1" z="0"/></transform></shape>
  <shape type="polygon" id="star"><string name="vertices"
    value="0,2,0 0.3,1.2,0 1,1,0 0.3,0.8,0 0,0,0 -0.3,0.8,0 -1,1,0 -0.3,1.2,0; -0.1,0.9,0 0.1,0.9,0 0,1.1,0"/>
    <transform name="to_world"><translate x="-2" y="0.2" z="1.5"/></transform></shape>
  <shape type="ply" id="bumpy"><string name="filename" value="bumpy.ply"/><transform name="to_world">
    <scale value="0.6"/><translate x="0.5" y="0.7" z="-2"/></transform></shape>
  <shape type="shapegroup" id="group"><shape type="sphere"><bsdf type="diffuse"/></shape></shape>
  <shape type="instance" id="egg"><ref id="group"/><transform name="to_world"><scale x="0.2" y="0.5" z="0.3"/>
    <rotate z="1" angle="25"/><translate x="-0.5" y="0.5" z="2.5"/></transform></shape>
  <shape type="rectangle" id="floor"><transform name="to_world"><scale value="6"/><rotate x="1" angle="-90"/>
    </transform><bsdf type="diffuse"><texture type="checkerboard" name="reflectance"><transform name="to_uv">
    <scale value="5"/></transform></texture></bsdf></shape>
  <emitter type="spot" id="spot"><float name="intensity" value="80"/><transform name="to_world">
    <lookat origin="3,5,6" target="0,0,0" up="0,1,0"/></transform></emitter>
  <emitter type="point" id="lamp"><point name="position" value="-3,4,2"/>
    <float name="intensity" value="20"/></emitter>
  <emitter type="directional" id="sun"><vector name="direction" value="1,-3,-1"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.2 0.3 0.5"/></emitter>"""
SENSOR = """<sensor type="perspective">
  <float name="fov" value="45"/><transform name="to_world">
  <lookat origin="0.2,2.5,7" target="0,0.7,0" up="0,1,0"/></transform><film type="hdrfilm">
  <integer name="width" value="24"/><integer name="height" value="16"/><rfilter type="box"/>
  </film></sensor>"""
AMBIENT = '<rgb name="ambient" value="0.1"/>'


@pytest.fixture
def still_life(load_scene, ply, bumpy):
    return load_scene(STILL_LIFE, AMBIENT, SENSOR, files={"bumpy.ply": ply(*bumpy)})


def test_floats_agree_with_forty_digits_and_lie_in_the_intervals(still_life):
    """Every shape, light and texture at once; the file's scenes are done by the agreement tests."""
    prover = Prover(resized(still_life, 8, 5))
    certificates = [prover.pixel(x, y) for y in range(5) for x in range(8)]
    for certificate in certificates:
        assert certificate.flag is not None or certificate.apart <= TARGET
    # Most pixels must be certain, else the claim above is empty.
    assert sum(c.flag is None for c in certificates) >= 0.9 * len(certificates)


def test_pixel_that_looks_exactly_along_an_edge_is_flagged_though_all_arithmetics_agree(load_scene):
    # An upright triangle whose edge stands where the one pixel looks, d = M z normalised: the sign of the
    # edge function is that of 0, which intervals around rounded numbers cannot tell.
    sensor = """<sensor type="perspective"><float name="fov" value="45"/><transform name="to_world">
      <rotate y="1" angle="20"/></transform><film type="hdrfilm"><integer name="width" value="1"/>
      <integer name="height" value="1"/><rfilter type="box"/></film></sensor>"""
    x, _, z = load_scene("", AMBIENT, sensor).sensors[0].to_world.column(2)
    corners = f"v {2 * x!r} 1 {2 * z!r}\nv {2 * x!r} -1 {2 * z!r}\nv 9 0 {2 * z!r}\nf 1 2 3\n"
    body = '<shape type="obj"><string name="filename" value="t.obj"/></shape>'
    certificate = Prover(load_scene(body, AMBIENT, sensor, files={"t.obj": corners})).pixel(0, 0)
    assert certificate.flag is not None
    assert certificate.flag.startswith("undecided")


def test_ties_are_flagged(load_scene):
    body = """<shape type="rectangle" id="{}"><transform name="to_world"><scale x="99" y="99"/></transform>
      <bsdf type="diffuse"/></shape>"""
    certificate = Prover(load_scene(body.format("one") + body.format("two"), AMBIENT, SENSOR)).pixel(0, 0)
    assert certificate.flag == "tie of one and two"


def test_hierarchy_draws_the_same_picture_bit_for_bit(still_life):
    with_boxes, without = Tracer(still_life), Tracer(still_life, hierarchy=False)
    assert type(with_boxes._world) is not type(without._world)
    for y in range(16):
        for x in range(24):
            assert with_boxes.pixel(x, y, 2) == without.pixel(x, y, 2)
    assert with_boxes.ties == without.ties


def test_hierarchy_encloses_the_same_colours_in_intervals(still_life):
    scene = resized(still_life, 5, 4)
    with_boxes, without = Tracer(scene, INTERVAL), Tracer(scene, INTERVAL, hierarchy=False)
    for y in range(4):
        for x in range(5):
            one, other = with_boxes.pixel(x, y), without.pixel(x, y)
            assert [(c.low, c.high) for c in one] == [(c.low, c.high) for c in other]


def test_hierarchy_agrees_in_forty_digits(still_life):
    scene = resized(still_life, 4, 3)
    with_boxes, without = Tracer(scene, DECIMAL), Tracer(scene, DECIMAL, hierarchy=False)
    for y in range(3):
        for x in range(4):
            assert with_boxes.pixel(x, y) == without.pixel(x, y)


def test_float_tracer_returns_floats(still_life):
    assert all(type(c) is float for c in Tracer(still_life, FLOAT).pixel(0, 0))
