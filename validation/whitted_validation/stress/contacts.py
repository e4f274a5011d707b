"""Bodies that touch, drawn by every policy at three scales: where the failures can be seen."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from whitted_validation.stress.case import Case, Outcome
from whitted_validation.stress.pictures import FAR_OFF, compared, drawn, is_explained, judged, verdict
from whitted_validation.stress.placing import placed
from whitted_validation.stress.trial import Trial

FULL_SIZE, QUICK_SIZE = (96, 72), (40, 30)

SHOWN_SIZE = (240, 180)  # large enough to see acne

SCENE = """<scene version="3.0.0"><integrator type="whitted"><rgb name="ambient" value="0.1, 0.1, 0.13"/></integrator>
<sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0.2, 1.3, -4"
target="0.1, 0.35, 0" up="0, 1, 0"/></transform><film type="hdrfilm"><integer name="width" value="WIDTH"/>
<integer name="height" value="HEIGHT"/><rfilter type="box"/></film></sensor>
<emitter type="point" id="lamp"><point name="position" value="-3, 4, 2"/><rgb name="intensity" value="26, 25, 22"/>
</emitter>
<bsdf type="blinnphong" id="plaster"><rgb name="diffuse_reflectance" value="0.8"/></bsdf>
<bsdf type="twosided" id="card"><bsdf type="blinnphong"><rgb name="diffuse_reflectance" value="0.2, 0.5, 0.8"/></bsdf>
</bsdf>
<bsdf type="blinnphong" id="steel"><rgb name="diffuse_reflectance" value="0.25"/>
<rgb name="mirror_reflectance" value="0.5"/><rgb name="specular_reflectance" value="0.5"/></bsdf>
<shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/></transform>
<ref id="plaster"/></shape>
<shape type="sphere" id="ball"><point name="center" value="-0.75, 0.5, 0"/><float name="radius" value="0.5"/>
<ref id="steel"/></shape>
<shape type="obj" id="solid"><string name="filename" value="meshes/icosahedron.obj"/><boolean name="face_normals"
value="true"/><transform name="to_world"><scale value="0.15"/><rotate y="1" angle="20"/><translate x="0.35" y="0.24"
z="-0.6"/></transform><ref id="steel"/></shape>
<shape type="rectangle" id="leaning"><transform name="to_world"><scale value="0.35"/><rotate x="1" angle="75"/>
<translate x="-0.3" y="0.09" z="-1.3"/></transform><ref id="card"/></shape>
<shape type="rectangle" id="wall"><transform name="to_world"><scale x="0.5" y="0.4"/><rotate y="1" angle="-65"/>
<translate x="1" y="0.4" z="0"/></transform><ref id="card"/></shape></scene>
"""


def cases() -> Iterator[Case]:
    """List them."""
    statement = f"no pixel is unexplained (shown: those off by more than {FAR_OFF:g}; pictures: what fails, and ours)"
    for scale in (1e-3, 1.0, 1e3):
        yield Case("bodies that touch", f"picture, scale {scale:g}", statement, partial(_drawn, scale=scale))


def _drawn(trial: Trial, scale: float) -> Outcome:
    width, height = QUICK_SIZE if trial.quick else FULL_SIZE
    text = SCENE.replace("WIDTH", str(width)).replace("HEIGHT", str(height))
    text = placed(text, scale)
    picture, bounds, exact = compared(trial, text)
    values = verdict(trial, picture, bounds, exact)
    outcome = judged(values, is_explained(values))
    if outcome.holds and not trial.policy.is_ours:
        return outcome
    caption = f"{trial.policy.name}, scale {scale:g}: {outcome.figure} of the pixels off"
    return replace(outcome, pictures={caption: drawn(trial, trial.write(text), SHOWN_SIZE)})
