"""Bad input through the real command line: one line on stderr, exit code 2, nothing written.

Every case is a process of its own, as for a user. They share a pool of processes, started together.
"""

from __future__ import annotations

import os
import struct
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from whitted_validation.refusal import no_such_sensor

SCENE = """<scene version="3.0.0">
  <integrator type="whitted" id="integrator"/>
  <sensor type="perspective" id="camera">
    <film type="hdrfilm" id="film">
      <integer name="width" value="4"/>
      <integer name="height" value="3"/>
      <rfilter type="box" id="filter"/>
    </film>
  </sensor>
  <emitter type="point" id="lamp">
    <rgb name="intensity" value="1"/>
  </emitter>
  <shape type="sphere" id="ball">
    <float name="radius" value="1"/>
    <bsdf type="blinnphong" id="paint">
      <rgb name="diffuse_reflectance" value="0.5"/>
    </bsdf>
  </shape>
  <!-- more -->
</scene>
"""

NAN = b"\x00\x00\xc0\x7f"


def ply(properties: str, vertices: bytes) -> bytes:
    """Write a triangle as a binary file, in which NaN is four bytes like any other."""
    lines = "".join(f"property float {name}\n" for name in properties.split())
    header = f"ply\nformat binary_little_endian 1.0\nelement vertex 3\n{lines}"
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    return (header + faces).encode() + vertices + struct.pack("<B3i", 3, 0, 1, 2)


CORNERS = [struct.pack("<3f", 0, 0, 0), struct.pack("<3f", 1, 0, 0), struct.pack("<3f", 0, 1, 0)]
NAN_PLY = ply("x y z", b"".join(CORNERS)[:-4] + NAN)
NAN_NORMAL_PLY = ply("x y z nx ny nz", b"".join(corner + NAN * 3 for corner in CORNERS))


@dataclass
class Case:
    """A command that must be refused, and what its one line must say."""

    says: tuple[str, ...]
    edit: tuple[str, str] | None = None
    text: str | bytes | None = None
    arguments: list[str] = field(default_factory=list)
    files: dict[str, bytes] = field(default_factory=dict)
    environment: dict[str, str] = field(default_factory=dict)
    scene: str = "scene.xml"
    start: subprocess.CompletedProcess[str] | None = None

    def prepare(self, folder: Path) -> list[str]:
        """Write the files of the case; return its command line."""
        text = SCENE if self.text is None else self.text
        if self.edit:
            old, new = self.edit
            assert old in SCENE
            text = SCENE.replace(old, new, 1)
        (folder / "scene.xml").write_bytes(text if isinstance(text, bytes) else text.encode())
        for name, content in self.files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_bytes(content)
        code = "from whitted_validation.cli import main\nmain()"
        output = [] if "-o" in self.arguments else ["-o", "picture.exr"]
        return [sys.executable, "-c", code, "render", self.scene, *output, *self.arguments]


def more(xml: str) -> tuple[str, str]:
    """Add an element at the end of the scene, on line 19."""
    return "<!-- more -->", xml


def shape(xml: str) -> tuple[str, str]:
    """Add a shape with the id `wrong` that holds `xml`."""
    return more(f'<shape type="sphere" id="wrong">{xml}</shape>')


LINE = "scene.xml:19: "
RADIUS = 'name="radius" value="1"'
DIFFUSE = 'name="diffuse_reflectance" value="0.5"'
DEFAULTS = "".join(f'<default name="b{i + 1}" value="{f"$b{i}" * 10}"/>' for i in range(12))
LIBLLVM = {major: f"/usr/lib/x86_64-linux-gnu/libLLVM-{major}.so.1" for major in (14, 15, 16)}

CASES = {
    # a file that is not there, or no scene
    "missing file": Case(("no.xml", "no such file"), scene="no.xml"),
    "unknown shipped scene": Case(("no_such_scene", "shipped are"), scene="no_such_scene"),
    "folder": Case(("is a folder",), scene="."),
    "empty file": Case(("scene.xml:1", "no element found"), text=""),
    "no text": Case(("scene.xml:1", "broken XML"), text=b"\x89PNG\r\n\x1a\n\x00\x00"),
    "other root": Case(
        ("scene.xml:1: <bsdf", "outermost element must be <scene>"),
        text='<bsdf type="diffuse" version="3.0.0"/>',
    ),
    "no version": Case(("scene.xml", "missing version"), edit=(' version="3.0.0"', "")),
    # XML that is broken or an attack
    "unclosed element": Case(("scene.xml:20", "mismatched tag"), edit=more("<shape>")),
    "bad encoding": Case(("scene.xml:1", "broken XML"), text=b"<scene version='3.0.0'>\xff\xfe</scene>"),
    "ten thousand levels": Case(
        ("scene.xml:1", "<shape", "nested deeper than 64"),
        text='<scene version="3.0.0">' + '<shape type="shapegroup">' * 10_000 + "</shape>" * 10_000 + "</scene>",
    ),
    "entity bomb": Case(
        ("scene.xml:1", "<!DOCTYPE>", "not allowed"),
        text='<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;">]><scene version="3.0">&b;</scene>',
    ),
    "external entity": Case(
        ("<!DOCTYPE>",),
        text='<!DOCTYPE x [<!ENTITY a SYSTEM "/etc/passwd">]><scene version="3.0.0">&a;</scene>',
    ),
    "substitution bomb": Case(
        (LINE, "<default", "grows beyond"), edit=more(f'<default name="b0" value="0123456789"/>{DEFAULTS}')
    ),
    "include of itself": Case(
        ("scene.xml", "includes go deeper than 15"), edit=more('<include filename="scene.xml"/>')
    ),
    # what does not exist
    "unknown element": Case((LINE, "<shpae>"), edit=more('<shpae type="sphere"/>')),
    "unknown shape": Case(
        (LINE, '<shape type="sphre" id="wrong">', "not found"), edit=more('<shape type="sphre" id="wrong"/>')
    ),
    "unknown bsdf": Case(
        (LINE, '<bsdf type="blinphong" id="b">', "not found"), edit=shape('<bsdf type="blinphong" id="b"/>')
    ),
    "misspelt parameter": Case(
        (LINE, 'id="wrong"', 'name="radus"', "does not take"), edit=shape('<float name="radus" value="1"/>')
    ),
    "misspelt parameter of ours": Case(
        ("scene.xml:15", 'id="paint"', 'name="difuse_reflectance"'),
        edit=("diffuse_reflectance", "difuse_reflectance"),
    ),
    "misspelt parameter of the integrator": Case(
        ("scene.xml:2", 'id="integrator"', 'name="max_dept"'),
        edit=('id="integrator"/>', 'id="integrator"><integer name="max_dept" value="1"/></integrator>'),
    ),
    "material that whitted cannot draw": Case(
        ("glass", "SmoothDielectric", "allowed are"), edit=shape('<bsdf type="dielectric" id="glass"/>')
    ),
    "misspelt parameter in an included file": Case(
        ("more.xml:2: ", 'id="wrong"', 'name="radus"'),
        edit=more('<include filename="more.xml"/>'),
        files={
            "more.xml": b'<scene version="3.0.0">\n'
            b'<shape type="sphere" id="wrong"><float name="radus" value="1"/></shape></scene>'
        },
    ),
    "unknown element in an included file": Case(
        ("more.xml:2: ", "<shpae>"),
        edit=more('<include filename="more.xml"/>'),
        files={"more.xml": b'<scene version="3.0.0">\n<shpae/></scene>'},
    ),
    "unresolved reference": Case((LINE, 'id="wrong"', '"nobody"'), edit=shape('<ref id="nobody"/>')),
    "undefined parameter": Case(
        (LINE, 'name="radius"', "undefined parameter $r"), edit=shape('<float name="radius" value="$r"/>')
    ),
    "unused definition": Case(("scene.xml", "$nobody=1"), arguments=["-Dnobody=1"]),
    # wrong values
    "wrong type": Case(
        (LINE, 'id="wrong"', "radius", "expected float"), edit=shape('<string name="radius" value="1"/>')
    ),
    "no number": Case(
        (LINE, '<float name="radius">', "wide is not a number"),
        edit=shape('<float name="radius" value="wide"/>'),
    ),
    "reflectance above 1": Case(
        ("scene.xml:15", 'id="paint"', "1.5", "0 to 1"), edit=(DIFFUSE, DIFFUSE.replace("0.5", "1.5"))
    ),
    "negative exponent": Case(
        (LINE, 'id="b"', "exponent", "-1", "0 to"),
        edit=shape('<bsdf type="blinnphong" id="b"><float name="exponent" value="-1"/></bsdf>'),
    ),
    "max_depth below -1": Case(
        ("scene.xml:2", "max_depth", "-2"),
        edit=('id="integrator"/>', 'id="integrator"><integer name="max_depth" value="-2"/></integrator>'),
    ),
    "unknown falloff": Case(
        ("scene.xml:2", "falloff", "cubic"),
        edit=('id="integrator"/>', 'id="integrator"><string name="falloff" value="cubic"/></integrator>'),
    ),
    "negative light": Case(
        ("scene.xml:11", 'name="intensity"', "-1", "not be negative"),
        edit=('"intensity" value="1"', '"intensity" value="-1"'),
    ),
    "zero radius": Case(
        ("scene.xml:14", 'name="radius"', "0 must be above 0"), edit=(RADIUS, 'name="radius" value="0"')
    ),
    "radius that float32 rounds to zero": Case(
        ("scene.xml:14", "1e-50 must be above 0"), edit=(RADIUS, 'name="radius" value="1e-50"')
    ),
    "singular transform": Case(
        ("wrong.to_world", "singular"),
        edit=shape('<transform name="to_world"><scale x="1" y="1" z="0"/></transform>'),
    ),
    "polygon of two vertices": Case(
        (LINE, "polygon", "wrong"),
        edit=more('<shape type="polygon" id="wrong"><string name="vertices" value="0,0,0 1,0,0"/></shape>'),
    ),
    # not finite
    "NaN radius": Case(("scene.xml:14", 'name="radius"', "nan", "finite"), edit=(RADIUS, 'name="radius" value="nan"')),
    "infinite colour": Case(
        ("scene.xml:16", "inf", "finite"), edit=(DIFFUSE, 'name="diffuse_reflectance" value="inf"')
    ),
    "position beyond float32": Case(
        (LINE, "<translate>", "1e39", "finite"),
        edit=shape('<transform name="to_world"><translate x="1e39"/></transform>'),
    ),
    "NaN by definition": Case(
        ("scene.xml:14", "nan"), edit=(RADIUS, 'name="radius" value="$r"'), arguments=["-Dr=nan"]
    ),
    "NaN vertex in a ply": Case(
        (LINE, 'id="wrong"', "nan.ply", "invalid vertex position"),
        edit=more('<shape type="ply" id="wrong"><string name="filename" value="nan.ply"/></shape>'),
        files={"nan.ply": NAN_PLY},
    ),
    "NaN normal in a ply": Case(
        ("wrong", "normal", "finite"),
        edit=more('<shape type="ply" id="wrong"><string name="filename" value="nan.ply"/></shape>'),
        files={"nan.ply": NAN_NORMAL_PLY},
    ),
    "NaN vertex in an obj": Case(
        ("wrong",),
        edit=more('<shape type="obj" id="wrong"><string name="filename" value="nan.obj"/></shape>'),
        files={"nan.obj": b"v 0 0 0\nv 1 0 0\nv 0 nan 0\nf 1 2 3\n"},
    ),
    "infinite product of transforms": Case(
        ("wrong", "finite"),
        edit=shape('<transform name="to_world"><scale value="1e20"/><scale value="1e20"/></transform>'),
    ),
    # files
    "missing mesh": Case(
        (LINE, 'name="filename"', "no such file: no.obj"),
        edit=more('<shape type="obj" id="wrong"><string name="filename" value="no.obj"/></shape>'),
    ),
    "broken mesh": Case(
        (LINE, 'id="wrong"', "broken.ply"),
        edit=more('<shape type="ply" id="wrong"><string name="filename" value="broken.ply"/></shape>'),
        files={"broken.ply": b"ply\nformat ascii 1.0\nelement vertex 3\n"},
    ),
    "mesh cut short": Case(
        (LINE, 'id="wrong"', "cut.ply"),
        edit=more('<shape type="ply" id="wrong"><string name="filename" value="cut.ply"/></shape>'),
        files={"cut.ply": NAN_PLY[:-20]},
    ),
    "absolute file outside": Case(
        (LINE, "/etc/passwd", "outside the scene's folder", "-a"),
        edit=more('<shape type="ply" id="wrong"><string name="filename" value="/etc/passwd"/></shape>'),
    ),
    "include outside": Case(
        (LINE, "<include>", "outside"), edit=more('<include filename="../../../../../../../../etc/passwd"/>')
    ),
    "path outside": Case((LINE, "<path>", "outside"), edit=more('<path value="/etc"/>')),
    # the film and the sensor
    "film of no width": Case(
        ("scene.xml:5", 'name="width"', "0 must be 1.."), edit=('"width" value="4"', '"width" value="0"')
    ),
    "film of negative height": Case(
        ("scene.xml:6", 'name="height"', "-3"), edit=('"height" value="3"', '"height" value="-3"')
    ),
    "absurdly wide film": Case(
        ("scene.xml:5", "1000000000000"), edit=('"width" value="4"', '"width" value="1000000000000"')
    ),
    "absurdly large film": Case(
        ("scene.xml:4", '<film type="hdrfilm" id="film">', "200000 x 200000", "at most 268435456"),
        edit=(
            '"width" value="4"/>\n      <integer name="height" value="3"',
            '"width" value="200000"/>\n      <integer name="height" value="200000"',
        ),
    ),
    "a million samples": Case(
        ("scene.xml:4", 'name="sample_count"', "1000000 must be 1..4096"),
        edit=(
            "<film",
            '<sampler type="independent"><integer name="sample_count" value="1000000"/></sampler><film',
        ),
    ),
    "crop outside the film": Case(
        ("scene.xml:4", 'id="film"', "crop"),
        edit=('"width" value="4"/>', '"width" value="4"/><integer name="crop_offset_x" value="9"/>'),
    ),
    "field of view of 200 degrees": Case(
        ("scene.xml:3", 'id="camera"', "[0, 180]"),
        edit=('id="camera">', 'id="camera"><float name="fov" value="200"/>'),
    ),
    "no such sensor": Case(("-s 3", "its only sensor is 0"), arguments=["-s", "3"]),
    # the command line
    "output in no folder": Case(
        ("nowhere/picture.exr", "No such file or directory"), arguments=["-o", "nowhere/picture.exr"]
    ),
    "output below a file": Case(
        ("scene.xml/picture.exr", "Not a directory"), arguments=["-o", "scene.xml/picture.exr"]
    ),
    "output is a folder": Case(("is a folder",), arguments=["-o", "folder.exr"], files={"folder.exr/inside": b""}),
    "unknown picture format": Case(("picture.gif", ".exr, .png, .npy"), arguments=["-o", "picture.gif"]),
    "exposure of an exr": Case(("--exposure", ".png"), arguments=["--exposure", "1"]),
    "exposure that is no number": Case(
        ("--exposure nan", "-126..126"), arguments=["-o", "picture.png", "--exposure", "nan"]
    ),
    "unknown variant": Case(("-m quick_rgb", "no such variant", "llvm_ad_rgb"), arguments=["-m", "quick_rgb"]),
    "spectral variant": Case(("-m scalar_spectral", "rgb and mono"), arguments=["-m", "scalar_spectral"]),
    "definition without value": Case(("-D", "nobody", "key=value"), arguments=["-D", "nobody"]),
    "unknown term": Case(("--only", "glossy", "ambient, diffuse, specular"), arguments=["--only", "glossy"]),
    "grid of zero": Case(("--grid", "0"), arguments=["--grid", "0"]),
    "no threads": Case(("-t", "0"), arguments=["-t", "0"]),
    "extra folder that is none": Case(("-a", "nowhere"), arguments=["-a", "nowhere"]),
    "reference in a variant": Case(("--reference", "-m"), arguments=["--reference", "-m", "scalar_rgb"]),
    "what the reference does not define": Case(
        ("not judged", "dielectric"),
        arguments=["--reference"],
        edit=shape('<bsdf type="dielectric" id="glass"/>'),
    ),
    "unknown option": Case(("--fast",), arguments=["--fast"]),
    # libLLVM
    "libLLVM that is not there": Case(
        ("no usable libLLVM", "/no/libLLVM.so", "DRJIT_LIBLLVM_PATH", "scalar_rgb"),
        arguments=["-m", "llvm_ad_rgb"],
        environment={"DRJIT_LIBLLVM_PATH": "/no/libLLVM.so"},
    ),
    **{
        f"libLLVM {major}": Case(
            ("-m llvm_ad_rgb", path, "scalar_rgb"),
            arguments=["-m", "llvm_ad_rgb"],
            environment={"DRJIT_LIBLLVM_PATH": path},
        )
        for major, path in LIBLLVM.items()
        if Path(path).is_file()
    },
}


@dataclass
class Outcome:
    """What became of a case."""

    code: int
    stdout: str
    stderr: str
    before: list[str]
    after: list[str]


def listing(folder: Path) -> list[str]:
    """Everything in a folder, by name, size and time."""
    return sorted(f"{path} {path.stat().st_size} {path.stat().st_mtime_ns}" for path in folder.rglob("*"))


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Future[Outcome]]]:
    """Start all cases at once, as many together as there are processors."""

    def run(name: str) -> Outcome:
        case, folder = CASES[name], tmp_path_factory.mktemp("case")
        command = case.prepare(folder)
        before = listing(folder)
        result = subprocess.run(
            command,
            cwd=folder,
            env={**os.environ, **case.environment},
            capture_output=True,
            text=True,
            timeout=120,
        )
        return Outcome(result.returncode, result.stdout, result.stderr, before, listing(folder))

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield {name: pool.submit(run, name) for name in CASES}


@pytest.mark.parametrize("name", CASES)
def test_bad_input_gets_one_line_and_exit_code_2(name: str, outcomes: dict[str, Future[Outcome]]) -> None:
    outcome = outcomes[name].result()
    assert outcome.code == 2, outcome.stderr
    assert outcome.stdout == ""
    assert outcome.stderr.count("\n") == 1, outcome.stderr
    assert outcome.stderr.startswith("whitted: ")
    assert "Traceback" not in outcome.stderr
    for part in CASES[name].says:
        assert part in outcome.stderr
    assert outcome.after == outcome.before


def test_there_are_as_many_cases_as_promised() -> None:
    assert len(CASES) >= 40


@pytest.mark.parametrize(
    ("count", "said"), [(0, "it has no sensor"), (1, "its only sensor is 0"), (3, "its sensors are 0 to 2")]
)
def test_a_wrong_sensor_is_told_which_there_are(count: int, said: str) -> None:
    assert str(no_such_sensor(Path("a.xml"), count, 7)) == f"a.xml: there is no -s 7; {said}"
