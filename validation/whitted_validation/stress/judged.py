"""Small scenes with something awkward in them, judged pixel by pixel, and a remark on what must be seen there."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from whitted_validation.stress.case import Case, Outcome, limited, percent
from whitted_validation.stress.geometry import triple
from whitted_validation.stress.pictures import FAR_OFF, compared, drawn, is_explained, judged, verdict
from whitted_validation.stress.trial import Array, Trial

Check = Callable[[Array, Any], bool]  # of the picture and the reference's bounds

TOP = """<scene version="3.0.0"><integrator type="whitted"><integer name="max_depth" value="DEPTH"/></integrator>
<sensor type="perspective"><float name="fov" value="45"/><transform name="to_world"><lookat origin="EYE"
target="TARGET" up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="32"/>
<integer name="height" value="24"/><rfilter type="box"/></film></sensor>
<bsdf type="blinnphong" id="red"><rgb name="diffuse_reflectance" value="0.7, 0.2, 0.1"/>
<rgb name="specular_reflectance" value="0.5"/><float name="exponent" value="40"/></bsdf>
<bsdf type="blinnphong" id="white"><rgb name="diffuse_reflectance" value="0.8"/></bsdf>
"""
FLOOR = """<shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/>
<rotate z="1" angle="7"/></transform><ref id="white"/></shape>"""
BALL = '<shape type="sphere" id="ball"><point name="center" value="0.1, 1.2, 0.3"/><ref id="red"/></shape>'


def _lamp(position: str, intensity: float = 10.0) -> str:
    return (
        f'<emitter type="point" id="lamp_{position.replace(", ", "_")}"><point name="position" value="{position}"/>'
        f'<float name="intensity" value="{intensity!r}"/></emitter>'
    )


def _is_black(picture: Array, _: Any) -> bool:
    return bool((picture == 0).all())


def _is_finite(picture: Array, _: Any) -> bool:
    return bool(np.isfinite(picture).all())


def _overflows(picture: Array, _: Any) -> bool:
    return bool(np.isinf(picture).any() and not np.isnan(picture).any())


def _is_flagged(picture: Array, bounds: Any) -> bool:
    """Tell whether nothing is far off but where chaos is admitted."""
    far = np.abs(picture - bounds.colour).max(axis=2) > FAR_OFF
    return not bool((far & ~(bounds.chaotic | bounds.loose)).any())


def cases() -> Iterator[Case]:
    """List them."""
    inside = (
        BALL
        + '<shape type="sphere" id="speck"><point name="center" value="1.6, 0.9, 0"/>'
        + ('<float name="radius" value="0.3"/><ref id="white"/></shape>')
    )
    exactly_level = FLOOR.replace('<rotate x="1" angle="-90"/>', '<matrix value="1 0 0 0 0 0 1 0 0 -1 0 0 0 0 0 1"/>')
    exactly_level = exactly_level.replace('<rotate z="1" angle="7"/>', "")
    yield _case("lights in odd places", "in the floor", exactly_level + _lamp("0, 0, -1"),
                "a lamp in the floor's plane lights nothing of it", _is_black)  # fmt: skip
    yield _case("lights in odd places", "on the surface of a ball", FLOOR + BALL + _lamp("0.1, 2.2, 0.3"),
                "no pixel is unexplained, all are finite", _is_finite)  # fmt: skip
    yield _case("lights in odd places", "within a closed ball", inside + _lamp("0.1, 1.2, 0.3"),
                "outside all is black, highlights included", _is_black)  # fmt: skip
    yield _case("lights in odd places", "behind the floor", FLOOR + _lamp("0, -3, 0"),
                "the front is black", _is_black)  # fmt: skip
    yield _case("lights in odd places", "straight behind the eye", FLOOR + BALL + _lamp("0.3, 2.2, -6"),
                "no pixel is unexplained where h = v = l", _is_finite)  # fmt: skip
    for exponent in (-44, -36):
        tiny = FLOOR + BALL + _lamp("-2, 5, -3", float(f"1e{exponent}"))
        small = (
            "what is lost is below 2^-126, where float32 has no full numbers (shown: largest error in units of that)"
        )
        yield Case("intensities", f"lamp of 10^{exponent}", small, partial(_underflowing, body=tiny))
    for exponent in (-30, 30, 36):
        yield _case("intensities", f"lamp of 10^{exponent}", FLOOR + BALL + _lamp("-2, 5, -3", float(f"1e{exponent}")),
                    "no pixel is unexplained, all are finite", _is_finite)  # fmt: skip
    two = _lamp("-2, 3, -2", 3e38) + _lamp("2, 3, -2", 3e38)
    beyond = "where the sum is above float32's range it is infinite, and nothing is NaN"
    yield Case("intensities", "two lamps of 3 10^38, no falloff", beyond, partial(_beyond, body=FLOOR + BALL + two))
    twin = FLOOR + FLOOR.replace('id="floor"', 'id="twin"').replace('id="white"', 'id="red"') + _lamp("-2, 5, -3")
    yield Case("coplanar faces", "two floors in one plane", "the picture repeats bit for bit, and every pixel in which "
               "they differ is flagged as a tie", partial(_twice, body=twin))  # fmt: skip
    half = math.sqrt(0.5)  # balls of radius 1 about the corners of this tetrahedron would touch each other
    balls = "".join(
        f'<shape type="sphere" id="ball_{i}"><point name="center" value="{triple(half * np.array(at))}"/>'
        '<float name="radius" value="0.998"/>'
        f'<bsdf type="blinnphong"><rgb name="mirror_reflectance" value="{triple(0.9 - 0.5 * np.eye(4)[i, :3])}"/>'
        "</bsdf></shape>"
        for i, at in enumerate(((1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)))
    )
    cavity = {"depth": 32, "eye": "0.02, 0.01, -0.03", "target": "1, 0, 0"}
    sky = '<emitter type="constant"><rgb name="radiance" value="0.4, 0.6, 0.9"/></emitter>'
    yield _case("mirror chains", "picture between four balls", balls + sky + _lamp("0, 6, -1"),
                "no pixel is unexplained; what is far off is flagged", _is_flagged, **cavity)  # fmt: skip
    yield _case("narrow cones", "picture of a spot of 0.5 degrees", FLOOR + '<emitter type="spot">'
                '<rgb name="intensity" value="400"/><float name="cutoff_angle" value="0.5"/>'
                '<transform name="to_world"><lookat origin="9, 70, -30" target="0, 0, 0" up="0, 0, 1"/></transform>'
                "</emitter>",
                "no pixel is unexplained", _is_finite)  # fmt: skip


def _scene(body: str, depth: int = 2, eye: str = "0.3, 2.2, -6", target: str = "0, 0.6, 0") -> str:
    return f"{TOP.replace('DEPTH', str(depth)).replace('EYE', eye).replace('TARGET', target)}{body}</scene>"


def _case(family: str, name: str, body: str, statement: str, check: Check, **view: Any) -> Case:
    shown = f"{statement} (shown: pixels off by more than {FAR_OFF:g})"
    return Case(family, name, shown, partial(_judged, text=_scene(body, **({"depth": 5} | view)), check=check))


def _judged(trial: Trial, text: str, check: Check) -> Outcome:
    picture, bounds, exact = compared(trial, text)
    values = verdict(trial, picture, bounds, exact)
    values["as it must be seen"] = check(picture, bounds)
    values["loose"], values["chaotic"] = int(bounds.loose.sum()), int(bounds.chaotic.sum())
    good = is_explained(values) and values["as it must be seen"]
    return judged(values, good)


def _twice(trial: Trial, body: str) -> Outcome:
    text = _scene(body)
    picture, bounds, exact = compared(trial, text)
    values = verdict(trial, picture, bounds, exact, few=picture.size)
    values["differs when repeated"] = int((drawn(trial, trial.write(text), None) != picture).sum())
    good = is_explained(values) and values["differs when repeated"] == 0
    return Outcome(good, percent(values["differs when repeated"] / picture.size), values)


def _underflowing(trial: Trial, body: str) -> Outcome:
    picture, bounds, _ = compared(trial, _scene(body))
    lost = float((np.abs(picture - bounds.colour) / 2.0**-126).max())
    return limited("largest error in units of 2^-126", lost, 1.0)


def _beyond(trial: Trial, body: str) -> Outcome:
    text = _scene(body).replace("</integrator>", '<string name="falloff" value="none"/></integrator>')
    picture = drawn(trial, trial.write(text), None)
    values = {"infinite": int(np.isinf(picture).sum()), "NaN": int(np.isnan(picture).sum()), "of": picture.size}
    return Outcome(_overflows(picture, None), percent(values["NaN"] / values["of"]), values)
