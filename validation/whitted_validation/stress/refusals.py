"""Input that is no scene: what is not finite, flat or empty is refused by both programs, each with one line."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

import whitted_reference
from whitted_validation.refusal import Refusal
from whitted_validation.request import Request
from whitted_validation.stress.acne import HEAD
from whitted_validation.stress.case import Case, Outcome
from whitted_validation.stress.geometry import single
from whitted_validation.stress.trial import Trial

BALL = '<shape type="sphere" id="culprit">{}</shape>'
FLOOR = '<shape type="rectangle" id="culprit"><transform name="to_world">{}</transform></shape>'
LAMP = '<emitter type="point" id="culprit">{}</emitter><shape type="sphere" id="ball"/>'
DYED = (
    '<shape type="sphere" id="ball"><bsdf type="blinnphong" id="culprit"><rgb name="diffuse_reflectance" value="{}"/>'
    "</bsdf></shape>"
)
MESH = '<shape type="obj" id="culprit"><string name="filename" value="culprit.obj"/></shape>'
TRIANGLE = "v 0 0 {}\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"

REFUSED = {
    "radius 0": BALL.format('<float name="radius" value="0"/>'),
    "radius NaN": BALL.format('<float name="radius" value="nan"/>'),
    "radius beyond float32": BALL.format('<float name="radius" value="1e39"/>'),
    "radius below float32": BALL.format('<float name="radius" value="1e-46"/>'),
    "centre infinite": BALL.format('<point name="center" value="inf, 0, 0"/>'),
    "to_world flat": FLOOR.format('<scale x="1" y="0" z="1"/>'),
    "to_world NaN": FLOOR.format('<translate x="nan"/>'),
    "to_world flat after rounding": FLOOR.format('<matrix value="1 1 0 0 1 1.000000000001 0 0 0 0 1 0 0 0 0 1"/>'),
    "lamp nowhere": LAMP.format('<point name="position" value="nan, 0, 0"/>'),
    "lamp infinitely bright": LAMP.format('<float name="intensity" value="inf"/>'),
    "lamp beyond float32": LAMP.format('<float name="intensity" value="1e39"/>'),
    "lamp negative": LAMP.format('<float name="intensity" value="-1"/>'),
    "colour NaN": DYED.format("nan, 0, 0"),
    "colour above 1": DYED.format("1.5, 0, 0"),
    "vertex NaN": MESH,
    "vertex beyond float32": MESH,
    "polygon on a line": '<shape type="polygon" id="culprit"><string name="vertices" value="0,0,0 1,1,1 2,2,2"/>'
    "</shape>",
    "spot of no width": '<emitter type="spot" id="culprit"><float name="cutoff_angle" value="0"/></emitter>',
}


def cases() -> Iterator[Case]:
    """List them."""
    for name in REFUSED:
        statement = "both programs refuse it with one line that names the culprit or its place in the file"
        yield Case("refused input", name, statement, partial(_refused, name=name), ours_only=True)
    statement = "a triangle without area is never hit, and no colour becomes NaN"
    yield Case("refused input", "triangle of no area", statement, _no_area, ours_only=True)


def _refused(trial: Trial, name: str) -> Outcome:
    vertex = {"vertex NaN": "nan", "vertex beyond float32": "1e39"}.get(name)
    if vertex is not None:
        (trial.folder / "culprit.obj").write_text(TRIANGLE.format(vertex), encoding="utf-8")
    file = trial.write(f"{HEAD}{REFUSED[name]}</scene>")
    said = {"plugin": "", "reference": ""}
    try:
        Request(str(file), None, {}, [], None, 0).load()
    except Refusal as refusal:
        said["plugin"] = str(refusal)
    try:
        whitted_reference.Tracer(whitted_reference.load(file))
    except whitted_reference.SceneError as error:
        said["reference"] = str(error)
    where = f"{file.name}:{HEAD.count(chr(10)) + 1}"
    good = all("\n" not in line and ("culprit" in line or where in line) for line in said.values())
    told = {who: line.replace(str(trial.folder), "") for who, line in said.items()}
    silent = [who for who, line in said.items() if not line]
    return Outcome(good, "0" if good else f"{' and '.join(silent) or 'a name'} missing", told)


def _no_area(trial: Trial) -> Outcome:
    """Lay the line of the triangle across the rays; behind it is a floor."""
    (trial.folder / "culprit.obj").write_text("v -1 0 1\nv 1 0 1\nv 0.5 0 1\nf 1 2 3\n", encoding="utf-8")
    scene = trial.load(
        trial.write(
            f"""{HEAD}{MESH}<shape type="rectangle" id="floor"><ref id="white"/></shape>
            <emitter type="directional"><vector name="direction" value="0, 0, -1"/></emitter></scene>"""
        )
    )
    rng, count = trial.random(), trial.count(200_000)
    o = single(np.column_stack([rng.uniform(-0.9, 0.9, count), np.zeros(count), np.full(count, 2.0)]))
    d = np.broadcast_to(np.array([0.0, 0.0, -1.0]), o.shape)
    wrong = int((trial.look(scene, o, d)[:, 0] != 1.0).sum())
    return Outcome(wrong == 0, f"{wrong}", {"pixels that are not the floor's": wrong, "of": count})
