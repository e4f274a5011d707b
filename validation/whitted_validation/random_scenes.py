"""Random scenes of everything that the picture's definition knows, and their verdicts.

    python -m whitted_validation.random_scenes [--count 200] [--first 0] [--keep DIR]

judges scenes of consecutive seeds, prints each pixel that is far off with its reason, and how often each feature
occurred, counts what is far off, and ends with 1 if a pixel is unexplained. A scene with such a pixel is cut down to
the smallest that has one, which is printed. Every second scene is built of contacts: bodies that touch, stand on the
floor or lie within each other.
"""

from __future__ import annotations

import random
import shutil
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from whitted_validation import scene_files
from whitted_validation.bounds import Means
from whitted_validation.refusal import Refusal
from whitted_validation.shrink import shrunk
from whitted_validation.validation import processes, validate
from whitted_validation.verdict import Judgement, Status

SOLIDS = ("sphere", "rectangle", "disk", "cylinder", "cube", "obj", "ply", "polygon")
MESHES = {"obj": ("icosahedron", "octahedron", "tetrahedron", "dodecahedron", "cube"), "ply": ("vase",)}
TEXTURES = ("tile", "planet")
FAR_OFF = 1e-4  # an error that an eye may see; a pixel that far off is printed, whatever its verdict
ULP = 2.0**-23  # spacing of float32 above 1
ROUND = ("sphere", "cylinder")  # no unequal scale, no shear
# What a scene of balls and triangles alone lacks; rectangles and cubes are triangles.
OTHERS = ("cylinder", "disk", "polygon", "instance")


@dataclass
class Builder:
    """Writes one scene, and counts what is in it."""

    rng: random.Random
    contacts: bool
    parts: list[str] = field(default_factory=list)
    features: Counter[str] = field(default_factory=Counter)
    textured: bool = True

    def build(self, width: int, height: int) -> str:
        """Return the text of the scene."""
        rng = self.rng
        self.features["contacts" if self.contacts else "apart"] += 1
        self._lights()
        self._floor()
        if self.contacts:
            self._contacts()
        for _ in range(rng.randint(2, 4)):
            self._solid(rng.choice(SOLIDS), self._placement)
        if rng.random() < 0.4:
            self._instances()
        return (
            f'<scene version="3.0.0">{self._integrator()}{self._sensor(width, height)}{"".join(self.parts)}</scene>\n'
        )

    # ------------------------------------------------------------------------------------------- words
    def _pick(self, *choices: str) -> str:
        choice = self.rng.choice(choices)
        self.features[choice] += 1
        return choice

    def _number(self, low: float, high: float) -> str:
        return f"{self.rng.uniform(low, high):.4f}"

    def _triple(self, low: float, high: float) -> str:
        return ", ".join(self._number(low, high) for _ in range(3))

    def _rgb(self, name: str, low: float = 0.0, high: float = 1.0) -> str:
        return f'<rgb name="{name}" value="{self._triple(low, high)}"/>'

    def _count(self) -> int:
        return len(self.parts)

    # ------------------------------------------------------------------------------------------- parts
    def _integrator(self) -> str:
        depth = self.rng.choice((1, 2, 3, 5, 8, 8, -1))
        self.features["unlimited depth" if depth < 0 else "limited depth"] += 1
        falloff = '<string name="falloff" value="none"/>' if self._pick("falloff", "no falloff") == "no falloff" else ""
        epsilon = ""
        if self.rng.random() < 0.2:
            self.features["epsilon"] += 1
            epsilon = '<float name="epsilon" value="0.01"/>'
        ambient = self._rgb("ambient", 0.0, 0.5)
        inside = f'<integer name="max_depth" value="{depth}"/>{ambient}{falloff}{epsilon}'
        return f'<integrator type="whitted">{inside}</integrator>'

    def _sensor(self, width: int, height: int) -> str:
        kind = self._pick("perspective", "perspective", "orthographic")
        rng = self.rng
        origin = f"{rng.uniform(-5, 5):.3f}, {rng.uniform(1.5, 6):.3f}, {rng.uniform(-9, -6):.3f}"
        look = f'<lookat origin="{origin}" target="{self._number(-0.5, 0.5)}, 0.7, 0" up="0, 1, 0"/>'
        fov = f'<float name="fov" value="{self._number(25, 55)}"/>' if kind == "perspective" else '<scale value="3.2"/>'
        inside = f'{fov}<transform name="to_world">{look}</transform>'
        if kind == "orthographic":
            inside = f'<transform name="to_world">{fov}{look}</transform>'
        return (
            f'<sensor type="{kind}">{inside}<film type="hdrfilm"><integer name="width" value="{width}"/>'
            f'<integer name="height" value="{height}"/><rfilter type="box"/></film></sensor>'
        )

    def _lights(self) -> None:
        rng = self.rng
        for i in range(rng.randint(1, 3)):
            kind = self._pick("point", "directional", "spot")
            place = f"{rng.uniform(-5, 5):.3f}, {rng.uniform(3, 7):.3f}, {rng.uniform(-6, 4):.3f}"
            if kind == "directional":
                inside = f'<vector name="direction" value="{self._number(-1, 1)}, -1, {self._number(-1, 1)}"/>'
                inside += self._rgb("irradiance", 0.1, 0.7)
            elif kind == "point":
                inside = f'<point name="position" value="{place}"/>{self._rgb("intensity", 1, 15)}'
            else:
                cutoff = rng.uniform(8, 40)
                inside = (
                    f'{self._rgb("intensity", 1, 20)}<float name="cutoff_angle" value="{cutoff:.3f}"/>'
                    f'<float name="beam_width" value="{cutoff * rng.uniform(0.2, 0.95):.3f}"/>'
                    f'<transform name="to_world"><lookat origin="{place}" target="{self._triple(-0.5, 0.5)}" '
                    'up="0, 0, 1"/></transform>'
                )
            self.parts.append(f'<emitter type="{kind}" id="light_{i}">{inside}</emitter>')
        if rng.random() < 0.6:
            self.features["constant"] += 1
            self.parts.append(f'<emitter type="constant" id="sky">{self._rgb("radiance", 0.05, 0.6)}</emitter>')

    def _texture(self, name: str) -> str:
        kind = self._pick("checkerboard", "bitmap")
        to_uv = f'<transform name="to_uv"><scale x="{self._number(1, 6)}" y="{self._number(1, 6)}"/></transform>'
        if kind == "checkerboard":
            colours = self._rgb("color0") + self._rgb("color1")
            return f'<texture type="checkerboard" name="{name}">{colours}{to_uv}</texture>'
        filter_type = self._pick("bilinear", "nearest")
        wrap = self._pick("repeat", "mirror", "clamp")
        file = self.rng.choice(TEXTURES)
        return (
            f'<texture type="bitmap" name="{name}"><string name="filename" value="textures/{file}.png"/>'
            f'<string name="filter_type" value="{filter_type}"/><string name="wrap_mode" value="{wrap}"/>'
            f"{to_uv}</texture>"
        )

    def _reflectance(self, name: str, high: float) -> str:
        if self.textured and self.rng.random() < 0.3:
            return self._texture(name)
        self.features["constant colour"] += 1
        return self._rgb(name, 0.0, high)

    def _one_sided(self) -> str:
        kind = self._pick("blinnphong", "blinnphong", "diffuse", "conductor")
        if kind == "diffuse":
            return f'<bsdf type="diffuse">{self._reflectance("reflectance", 1.0)}</bsdf>'
        if kind == "conductor":
            tint = self._rgb("specular_reflectance")
            return f'<bsdf type="conductor"><string name="material" value="none"/>{tint}</bsdf>'
        inside = self._reflectance("diffuse_reflectance", 0.8)
        if self.rng.random() < 0.7:
            exponent = 10 ** self.rng.uniform(0, 3)
            inside += (
                self._reflectance("specular_reflectance", 0.8) + f'<float name="exponent" value="{exponent:.3f}"/>'
            )
        if self.rng.random() < 0.5:
            inside += self._reflectance("mirror_reflectance", 0.8)
        return f'<bsdf type="blinnphong">{inside}</bsdf>'

    def _look(self) -> str:
        """Return what a shape wears: a bsdf, two of them, none, or a lamp."""
        chance = self.rng.random()
        if chance < 0.12:
            self.features["no bsdf"] += 1
            return ""
        if chance < 0.24:
            self.features["area"] += 1
            return f'<emitter type="area">{self._rgb("radiance", 0.1, 1.0)}</emitter>'
        if chance < 0.5:
            self.features["twosided"] += 1
            both = self._one_sided() + (self._one_sided() if self.rng.random() < 0.5 else "")
            return f'<bsdf type="twosided">{both}</bsdf>'
        return self._one_sided()

    def _placement(self, kind: str) -> str:
        """Return a transform that brings a unit shape somewhere."""
        rng = self.rng
        steps = []
        size = rng.uniform(0.3, 0.9)
        if kind in ROUND or self._pick("equal scale", "unequal scale", "matrix") == "equal scale":
            mirrored = rng.random() < 0.25
            self.features["mirrored"] += mirrored
            steps.append(f'<scale x="{-size if mirrored else size:.4f}" y="{size:.4f}" z="{size:.4f}"/>')
        elif rng.random() < 0.5:
            steps.append(f'<scale x="{self._number(0.2, 1)}" y="{self._number(0.2, 1)}" z="{self._number(0.2, 1)}"/>')
        else:
            rows = [[size if i == j else rng.uniform(-0.2, 0.2) * (j < 3) for j in range(4)] for i in range(3)]
            numbers = " ".join(f"{x:.4f}" for row in rows for x in row)
            steps.append(f'<matrix value="{numbers} 0 0 0 1"/>')
        if rng.random() < 0.8:
            self.features["rotate"] += 1
            axis = rng.choice(("x", "y", "z"))
            steps.append(f'<rotate {axis}="1" angle="{self._number(-180, 180)}"/>')
        self.features["translate"] += 1
        steps.append(f'<translate x="{self._number(-2.5, 2.5)}" y="{self._number(0.3, 2)}" z="{self._number(-2, 2)}"/>')
        return f'<transform name="to_world">{"".join(steps)}</transform>'

    def _solid(self, kind: str, place: Callable[[str], str], **others: str) -> None:
        self.features[kind] += 1
        self.parts.append(self._shape(kind, f"{kind}_{self._count()}", place(kind), others.get("look")))

    def _shape(self, kind: str, name: str, transform: str, look: str | None = None) -> str:
        inside = ""
        self.textured = kind != "polygon"  # it has no coordinates
        if kind in MESHES:
            inside = f'<string name="filename" value="meshes/{self.rng.choice(MESHES[kind])}.{kind}"/>'
            if self.rng.random() < 0.4:
                self.features["face_normals"] += 1
                inside += '<boolean name="face_normals" value="true"/>'
        if kind == "polygon":
            inside = f'<string name="vertices" value="{self._rings()}"/>'
        if self.rng.random() < 0.2:
            self.features["flip_normals"] += 1
            inside += '<boolean name="flip_normals" value="true"/>'
        return f'<shape type="{kind}" id="{name}">{inside}{transform}{self._look() if look is None else look}</shape>'

    def _rings(self) -> str:
        """Return a star with a hole in it, a bow-tie, or a plain outline."""
        kind = self._pick("polygon with a hole", "bow-tie polygon", "convex polygon")
        if kind == "bow-tie polygon":
            return "-1,-1,0 1,1,0 1,-1,0 -1,1,0"
        outline = "-1,-0.8,0 0,-0.4,0 1,-0.9,0 0.7,0.1,0 0.9,1,0 -0.1,0.6,0 -1,0.9,0"
        if kind == "convex polygon":
            return "-1,-0.6,0 0.2,-1,0 1,0.1,0 0.3,0.9,0 -0.8,0.7,0"
        return f"{outline}; -0.3,-0.2,0 0.3,-0.2,0 0.1,0.3,0"

    def _floor(self) -> None:
        if self.contacts or self.rng.random() < 0.8:
            self.features["rectangle"] += 1
            transform = '<transform name="to_world"><rotate x="1" angle="-90"/><scale value="6"/></transform>'
            self.parts.append(self._shape("rectangle", "floor", transform, self._one_sided()))

    def _instances(self) -> None:
        rng = self.rng
        kinds = [rng.choice(("sphere", "cylinder", "cube", "disk", "rectangle", "obj")) for _ in range(2)]
        inner = "".join(
            self._shape(kind, f"inner_{i}", self._placement(kind), self._one_sided()) for i, kind in enumerate(kinds)
        )
        self.parts.append(f'<shape type="shapegroup" id="group">{inner}</shape>')
        for i in range(rng.randint(1, 2)):
            self.features["instance"] += 1
            self.parts.append(
                f'<shape type="instance" id="instance_{i}"><ref id="group"/>{self._placement("instance")}</shape>'
            )

    def _contacts(self) -> None:
        """Bodies that touch: on the floor, at each other, and one within another."""
        rng = self.rng
        kind = self._pick("balls touch", "body stands on floor", "nested bodies")
        x, z, r = (rng.choice((-1.5, -0.5, 0.75, 1.25)), rng.choice((-0.5, 0.25, 1.0)), rng.choice((0.5, 0.75, 1.0)))
        if kind == "body stands on floor":
            solid = rng.choice(("cube", "cylinder", "sphere"))
            up = {"cube": r, "cylinder": 0.0, "sphere": r}[solid]
            turn = '<rotate x="1" angle="-90"/>' if solid == "cylinder" else ""
            steps = f'<scale value="{r}"/>{turn}<translate x="{x}" y="{up}" z="{z}"/>'
            self._solid(solid, lambda _: f'<transform name="to_world">{steps}</transform>')
            return
        radii = (r, r / 2)
        places = ((x, r), (x + 1.5 * r, r) if kind == "balls touch" else (x, r))
        for radius, (px, py) in zip(radii, places, strict=True):
            steps = f'<scale value="{radius}"/><translate x="{px}" y="{py}" z="{z}"/>'
            self._solid("sphere", lambda _, steps=steps: f'<transform name="to_world">{steps}</transform>')  # type: ignore[misc]


def write(folder: Path, seed: int, width: int = 40, height: int = 30) -> tuple[Path, Counter[str]]:
    """Write the scene of a seed and the files that it needs; return the file and what is in it."""
    builder = Builder(random.Random(seed), contacts=seed % 2 == 1)
    text = builder.build(width, height)
    for name in ("meshes", "textures"):
        if not (folder / name).exists():
            shutil.copytree(scene_files.SCENES / name, folder / name)
    file = folder / f"random_{seed}.xml"
    file.write_text(text)
    return file, builder.features


def cut_down(file: Path, executor: Executor | None = None, variant: str | None = None) -> Path:
    """Write, beside a scene with unexplained pixels, the smallest that still has one; return its file."""
    small = file.with_name(f"{file.stem}_small.xml")
    trial = file.with_name(f"{file.stem}_trial.xml")

    def fails(text: str) -> bool:
        trial.write_text(text)
        try:
            return not validate(trial, executor=executor, variant=variant).good
        except Refusal:
            return False  # what is left is no scene, or none that can be judged

    def keep(text: str) -> None:
        small.write_text(text)

    try:
        keep(shrunk(file.read_text(), fails, keep))
    finally:
        trial.unlink(missing_ok=True)
    return small


def _far_off(judgement: Judgement) -> Iterator[str]:
    """Say of each pixel that is far off why it may be."""
    reasons = {(each.x, each.y): ", ".join(each.reasons) for each in judgement.differences}
    off = np.abs(judgement.picture - judgement.bounds.colour).max(axis=2)
    for y, x in np.argwhere(off > FAR_OFF).tolist():
        what = Status(int(judgement.status[y, x])).name.lower()
        colour, bound = judgement.bounds.colour[y, x].max(), judgement.bounds.bound[y, x].max()
        why = reasons.get((x, y), f"within its bound {bound:.1e} of a colour of {colour:.2g}")
        yield f"pixel ({x}, {y}) is off by {off[y, x]:.1e}, {what}: {why}"


@click.command()
@click.option("--count", default=200, help="Number of scenes.")
@click.option("--first", default=0, help="Seed of the first.")
@click.option("--keep", metavar="DIR", help="Write the scenes here.")
def main(count: int, first: int, keep: str | None) -> None:
    """Judge random scenes."""
    features: Counter[str] = Counter()
    totals: Counter[str] = Counter()
    errors: list[NDArray[np.float32]] = []
    balls_and_triangles: list[bool] = []
    bad = []
    with tempfile.TemporaryDirectory() as temporary, processes() as workers:
        folder = Path(keep or temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for seed in range(first, first + count):
            file, here = write(folder, seed)
            features.update(here)
            verdict = validate(file, executor=workers)
            judgement = verdict.judgement
            errors.append(np.abs(judgement.picture - judgement.bounds.colour).max(axis=2).astype(np.float32).ravel())
            balls_and_triangles.append(not any(here[other] for other in OTHERS))
            click.echo("".join(f"seed {seed}: {line}\n" for line in _far_off(judgement)), nl=False)
            totals.update({status.name.lower(): judgement.count(status) for status in Status})
            totals.update({f"by {means.name.lower()}": int((judgement.bounds.means == means).sum()) for means in Means})
            if not verdict.good:
                bad.append(seed)
                click.echo(verdict.summary)
                for difference in judgement.differences[:3]:
                    click.echo(f"  {difference}")
                small = cut_down(file, workers)
                click.echo(f"the smallest scene with an unexplained pixel{f', {small}' if keep else ''}:")
                click.echo(small.read_text())
    for name, times in sorted(features.items()):
        click.echo(f"{name:<24}{times}")
    off = np.array(errors)
    for what, part in (("all scenes", off), ("scenes of balls and triangles alone", off[balls_and_triangles])):
        far = int((part > FAR_OFF).sum())
        click.echo(
            f"{what}: {far} of {part.size} pixels off by more than {FAR_OFF:g}, "
            f"{1e5 * far / max(part.size, 1):.2g} per 100,000"
        )
    wrong = off[off > 0]  # not black or sky to the last bit
    click.echo(
        f"median error {np.median(off) / ULP:.2g} ulp of 1.0; of the {wrong.size / off.size:.0%} of pixels that are "
        f"off at all {np.median(wrong) / ULP if wrong.size else 0:.2g}"
    )
    click.echo(f"{count} scenes, pixels: {dict(totals)}; scenes with unexplained pixels: {bad or 'none'}")
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
