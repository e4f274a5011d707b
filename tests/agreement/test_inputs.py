"""Both programs compute from the same numbers: every input of the reference, bit for bit what Mitsuba shows.

What is computed once and for all in double precision (tangents, angles, unit normals) is no input and is
compared within the roundings that single precision makes of it.
"""

from __future__ import annotations

import math
import random
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import mitsuba as mi
import pytest

from whitted_reference import Tracer, float32, load, scene
from whitted_reference.transforms import Affine
from whitted_validation import scene_files

RANDOM_SCENES = 200


# ------------------------------------------------------------------------------------ numbers of Mitsuba
def numbers(value: object) -> list[float]:
    """Flatten what `mi.traverse` shows into a list of floats."""
    if isinstance(value, bool | int | float):
        return [float(value)]
    if hasattr(value, "array"):
        value = value.array  # a tensor
    try:
        return [x for item in value for x in numbers(item)]  # type: ignore[attr-defined]
    except TypeError:
        return [float(value)]  # type: ignore[arg-type]


def same(mine: object, theirs: object, what: str) -> None:
    left, right = numbers(mine), numbers(theirs)
    assert left == right, f"{what}: {left} and {right}"


def same_matrix(mine: Affine, theirs: mi.ScalarTransform4f, what: str) -> None:
    for i in range(3):
        same(mine.matrix[i], [theirs.matrix[i, j] for j in range(4)], f"{what} M row {i}")


def same_affine(mine: Affine, theirs: mi.ScalarTransform4f, what: str) -> None:
    same_matrix(mine, theirs, what)
    for i in range(3):
        same(mine.normal[i], [theirs.inverse_transpose[i, j] for j in range(3)], f"{what} M^-T row {i}")


# ------------------------------------------------------------------------------------------- comparisons
def compare(path: Path) -> int:
    """Compare all inputs of one scene; return how many shapes were compared."""
    mine = load(path)
    theirs = mi.load_file(str(path), optimize=False)
    for sensor, other in zip(mine.sensors, theirs.sensors(), strict=True):
        compare_sensor(sensor, other)
    lights = [emitter for emitter in theirs.emitters() if "Area" not in emitter.class_name()]
    backgrounds = [light for light in lights if light.class_name() == "ConstantBackgroundEmitter"]
    lights = [light for light in lights if light not in backgrounds]
    by_id = {light.id(): light for light in lights}
    assert len(by_id) == len(mine.lights)
    for light in mine.lights:
        compare_light(light, by_id[light.id])
    if backgrounds:
        same(mine.background, colour(mi.traverse(backgrounds[0]), "radiance"), "background")
    shapes = {shape.id(): shape for shape in theirs.shapes()}
    assert len(shapes) == len(mine.shapes)
    for shape in mine.shapes:
        compare_shape(shape, shapes[shape.id if isinstance(shape, scene.Instance) else shape.look.id], mine)
    return len(mine.shapes)


def colour(parameters: mi.SceneParameters, name: str) -> list[float]:
    value = numbers(parameters[f"{name}.value"])
    return value * (3 // len(value))


def compare_sensor(sensor: scene.Sensor, other: mi.Sensor) -> None:
    p = mi.traverse(other)
    same_affine(sensor.to_world, p["to_world"], "sensor")
    film = sensor.film
    same((film.width, film.height), p["film.size"], "film size")
    same((film.crop_width, film.crop_height), p["film.crop_size"], "crop size")
    same((film.crop_x, film.crop_y), p["film.crop_offset"], "crop offset")
    same((sensor.near, sensor.far), (p["near_clip"], p["far_clip"]), "clipping planes")
    if sensor.x_fov is not None:
        same(sensor.x_fov, p["x_fov"], "x_fov")
        same(sensor.principal, (p["principal_point_offset_x"], p["principal_point_offset_y"]), "principal point")
    assert sensor.sample_count == other.sampler().sample_count()


def compare_light(light: scene.Light, other: mi.Emitter) -> None:
    p = mi.traverse(other)
    if isinstance(light, scene.PointLight):
        same(light.position, p["position"], light.id)
        same(light.intensity, colour(p, "intensity"), light.id)
    elif isinstance(light, scene.SpotLight):
        same_affine(light.to_world, p["to_world"], light.id)
        same(light.intensity, colour(p, "intensity"), light.id)
        same(light.cutoff_angle, math.radians(p["cutoff_angle"]), light.id)
        same(light.beam_width, math.radians(p["beam_width"]), light.id)
    else:
        matrix = p["to_world"].matrix
        same(light.direction, [matrix[i, 2] for i in range(3)], light.id)
        same(light.irradiance, colour(p, "irradiance"), light.id)


def compare_shape(shape: scene.Shape, other: mi.Shape, whole: scene.Scene) -> None:
    if isinstance(shape, scene.Instance):
        same_affine(shape.to_world, mi.traverse(other)["to_world"], shape.id)
        return
    name = shape.look.id
    compare_material(shape.look.material, other.bsdf(), name)
    if shape.look.emission is not None:
        same(shape.look.emission, colour(mi.traverse(other.emitter()), "radiance"), name)
    p = mi.traverse(other)
    if isinstance(shape, scene.Mesh):
        compare_mesh(shape, p, whole)
    elif isinstance(shape, scene.Polygon):
        corners = {corner for ring in shape.rings for corner in ring}
        flat = numbers(p["vertex_positions"])
        assert corners <= {tuple(flat[i : i + 3]) for i in range(0, len(flat), 3)}, name
    elif isinstance(shape, scene.Disk) and shape.flip:
        # Mitsuba flips by a scale of z in single precision; its M^-T then passes through a reciprocal that
        # depends on the processor, but the direction of M^-T z is the same and it is normalised.
        matrix = tuple((a, b, -c, t) for a, b, c, t in shape.to_world.matrix)
        same_matrix(replace(shape.to_world, matrix=matrix), p["to_world"], name)
    elif isinstance(shape, scene.Sphere | scene.Cylinder):
        same_matrix(shape.to_world, p["to_world"], name)  # M^-T is not used
    else:
        same_affine(shape.to_world, p["to_world"], name)
    if isinstance(shape, scene.Sphere):
        # Not shown, but the box is centre -+ radius, rounded.
        same([float32.nearest(c - shape.radius) for c in shape.centre], other.bbox().min, name)
        same([float32.nearest(c + shape.radius) for c in shape.centre], other.bbox().max, name)


def compare_mesh(mesh: scene.Mesh, p: mi.SceneParameters, whole: scene.Scene) -> None:
    name = mesh.look.id
    assert [i for face in mesh.faces for i in face] == [int(i) for i in p["faces"]], name
    same(mesh.vertices, p["vertex_positions"], f"{name} vertices")
    same(mesh.uvs or [], p["vertex_texcoords"], f"{name} uv")
    theirs = numbers(p["vertex_normals"])
    if mesh.normals is None and not mesh.smooth:
        assert theirs == []
        return
    # Ours are in double precision. Mitsuba's M^-T n, norm, root and product round about ten times in
    # single precision. Where normals are made of the faces', each of some ten faces adds about as much,
    # and more where its sides or the faces' normals cancel.
    limits = [10 * 2.0**-24] * len(mesh.vertices)
    if mesh.normals is None:
        limits = [100 * 2.0**-24 * factor for factor in cancellation(mesh)]
    primitives = [q for q in Tracer(whole).primitives if q.surface.id == name]
    for primitive, face in zip(primitives, [f for f in mesh.faces if is_solid(mesh, f)], strict=True):
        for n, i in zip(primitive.vertex_normals, face, strict=True):
            sign = -1 if mesh.flip else 1
            assert all(abs(sign * a - b) <= limits[i] for a, b in zip(n, theirs[3 * i : 3 * i + 3], strict=True)), name


def cancellation(mesh: scene.Mesh) -> list[float]:
    """Return per vertex how many times greater the parts of its normal are than their sum."""
    sums = [[0.0, 0.0, 0.0] for _ in mesh.vertices]
    parts = [0.0] * len(mesh.vertices)
    for face in mesh.faces:
        a, b, c = (mesh.vertices[i] for i in face)
        u, v = [x - y for x, y in zip(b, a, strict=True)], [x - y for x, y in zip(c, a, strict=True)]
        n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]
        size = math.hypot(*n)
        if size == 0.0:
            continue
        thin = math.hypot(*u) * math.hypot(*v) / size
        for k, i in enumerate(face):
            p, q, r = (mesh.vertices[face[(k + step) % 3]] for step in range(3))
            s, t = [x - y for x, y in zip(q, p, strict=True)], [x - y for x, y in zip(r, p, strict=True)]
            cosine = sum(x * y for x, y in zip(s, t, strict=True)) / (math.hypot(*s) * math.hypot(*t))
            angle = math.acos(max(-1.0, min(1.0, cosine)))
            parts[i] += angle * thin
            sums[i] = [x + y / size * angle for x, y in zip(sums[i], n, strict=True)]
    return [part / math.hypot(*total) if any(total) else 1.0 for part, total in zip(parts, sums, strict=True)]


def is_solid(mesh: scene.Mesh, face: tuple[int, int, int]) -> bool:
    a, b, c = (mesh.vertices[i] for i in face)
    u, v = [x - y for x, y in zip(b, a, strict=True)], [x - y for x, y in zip(c, a, strict=True)]
    return any(u[i] * v[j] != u[j] * v[i] for i, j in ((0, 1), (1, 2), (2, 0)))


def compare_material(material: scene.Material, other: mi.BSDF, name: str) -> None:
    p = mi.traverse(other)
    if isinstance(material, scene.TwoSided):
        compare_one_side(material.front, p, "brdf_0.", name)
        # Mitsuba shows one material that serves both sides only once.
        if material.behind is not material.front:
            compare_one_side(material.behind, p, "brdf_1.", name)
    else:
        compare_one_side(material, p, "", name)


def compare_one_side(material: scene.OneSided, p: mi.SceneParameters, prefix: str, name: str) -> None:
    if isinstance(material, scene.Diffuse):
        pairs = {"reflectance": material.reflectance}
    elif isinstance(material, scene.Conductor):
        pairs = {"specular_reflectance": material.mirror}
    else:
        pairs = {"diffuse_reflectance": material.diffuse, "specular_reflectance": material.specular,
                 "mirror_reflectance": material.mirror, "exponent": material.exponent}  # fmt: skip
        if any(key.startswith(f"{prefix}ambient_reflectance") for key in p.keys()):  # noqa: SIM118
            pairs["ambient_reflectance"] = material.ambient
    for key, texture in pairs.items():
        compare_texture(texture, p, prefix + key, f"{name} {prefix}{key}")


def compare_texture(texture: scene.Texture, p: mi.SceneParameters, key: str, what: str) -> None:
    if isinstance(texture, scene.Checkerboard):
        compare_texture(texture.color0, p, f"{key}.color0", what)
        compare_texture(texture.color1, p, f"{key}.color1", what)
    elif isinstance(texture, scene.Bitmap):
        same(list(texture.texels), p[f"{key}.data"], what)
    else:
        same(texture, colour(p, key), what)
        return
    matrix = p[f"{key}.to_uv"].matrix
    same(texture.to_uv, [[matrix[i, j] for j in range(3)] for i in range(2)], f"{what} to_uv")


# ------------------------------------------------------------------------------------------ shipped scenes
@pytest.mark.parametrize("path", scene_files.shipped(), ids=lambda path: path.stem)
def test_inputs_of_the_shipped_scenes_are_bit_equal(scalar_rgb, path):
    compare(path)


# ------------------------------------------------------------------------------------------- random scenes
class Maker:
    """Writes random scenes of everything that the picture defines."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.rng = random.Random(seed)
        self.folder = folder
        self.count = 0

    def number(self, low: float = -5.0, high: float = 5.0) -> str:
        """Write a number of few or many digits."""
        digits = self.rng.choice([1, 3, 7, 12])
        return f"{self.rng.uniform(low, high):.{digits}g}"

    def triple(self, low: float = -5.0, high: float = 5.0) -> str:
        """Write three."""
        return ", ".join(self.number(low, high) for _ in range(3))

    def name(self, kind: str) -> str:
        """Return a fresh id."""
        self.count += 1
        return f"{kind}_{self.count}"

    def axis(self) -> str:
        """Write a unit vector."""
        v = [self.rng.gauss(0, 1) for _ in range(3)]
        length = math.hypot(*v)
        return ",".join(repr(x / length) for x in v)

    def steps(self, similar: bool = False) -> str:
        """Write some transform elements; `similar` ones keep spheres round."""
        out = []
        for _ in range(self.rng.randrange(5)):
            kind = self.rng.choice(["translate", "rotate", "turn", "scale", "matrix", "lookat"])
            if kind == "translate":
                out.append(f'<translate value="{self.triple()}"/>')
            elif kind == "rotate":
                out.append(f'<rotate {self.rng.choice("xyz")}="1" angle="{self.number(-360, 360)}"/>')
            elif kind == "turn":
                out.append(f'<rotate value="{self.axis()}" angle="{self.number(-360, 360)}"/>')
            elif kind == "scale" and similar:
                out.append(f'<scale value="{self.rng.choice(["", "-"])}{self.number(0.2, 4)}"/>')
            elif kind == "scale":
                out.append(f'<scale value="{", ".join(self.number(0.2, 4) for _ in range(3))}"/>')
            elif kind == "lookat":
                out.append(f'<lookat origin="{self.triple()}" target="{self.triple()}" up="{self.triple()}"/>')
            elif not similar:
                rows = [[self.number(-1, 1) for _ in range(3)] for _ in range(3)]
                for i in range(3):
                    rows[i][i] = self.number(3, 4)
                if self.rng.random() < 0.5:
                    out.append(f'<matrix value="{" ".join(x for row in rows for x in row)}"/>')
                else:
                    text = " ".join(x for row in rows for x in (*row, self.number()))
                    out.append(f'<matrix value="{text} 0 0 0 1"/>')
        return "".join(out)

    def transform(self, similar: bool = False) -> str:
        """Write a to_world."""
        return f'<transform name="to_world">{self.steps(similar)}</transform>'

    def colour(self, name: str, high: float = 1.0) -> str:
        """Write a colour as rgb or float."""
        if self.rng.random() < 0.3:
            return f'<float name="{name}" value="{self.number(0, high)}"/>'
        return f'<rgb name="{name}" value="{self.triple(0, high)}"/>'

    def texture(self, name: str) -> str:
        """Write a colour or a checkerboard."""
        if self.rng.random() < 0.7:
            return self.colour(name)
        return f"""<texture type="checkerboard" name="{name}">{self.colour("color0")}{self.colour("color1")}
          <transform name="to_uv"><scale x="{self.number(1, 9)}" y="{self.number(1, 9)}"/>
          <rotate z="1" angle="{self.number(-90, 90)}"/></transform></texture>"""

    def one_sided(self) -> str:
        """Write a one-sided bsdf."""
        kind = self.rng.choice(["blinnphong", "diffuse", "conductor"])
        if kind == "diffuse":
            return f'<bsdf type="diffuse">{self.texture("reflectance")}</bsdf>'
        if kind == "conductor":
            return f'<bsdf type="conductor">{self.texture("specular_reflectance")}</bsdf>'
        names = [f"{n}_reflectance" for n in ("diffuse", "specular", "mirror", "ambient") if self.rng.random() < 0.7]
        exponent = f'<float name="exponent" value="{self.number(0, 1000)}"/>'
        return f'<bsdf type="blinnphong">{"".join(map(self.texture, names))}{exponent}</bsdf>'

    def material(self) -> str:
        """Write a bsdf."""
        if self.rng.random() < 0.7:
            return self.one_sided()
        return f'<bsdf type="twosided">{"".join(self.one_sided() for _ in range(self.rng.choice([1, 2])))}</bsdf>'

    def shape(self, kind: str) -> str:
        """Write a shape of one kind."""
        similar = kind in ("sphere", "cylinder")
        material = '<bsdf type="diffuse"/>' if kind == "polygon" else self.material()  # a polygon has no uv
        inner = [self.transform(similar), material]
        if self.rng.random() < 0.3:
            inner.append('<boolean name="flip_normals" value="true"/>')
        if self.rng.random() < 0.1:
            inner.append(f'<emitter type="area">{self.colour("radiance", 9)}</emitter>')
        if kind == "sphere" and self.rng.random() < 0.7:
            inner.append(f'<point name="center" value="{self.triple()}"/>')
            inner.append(f'<float name="radius" value="{self.number(0.1, 3)}"/>')
        if kind == "cylinder":
            inner.append(f'<point name="p0" value="{self.triple()}"/><point name="p1" value="{self.triple()}"/>')
            inner.append(f'<float name="radius" value="{self.number(0.1, 3)}"/>')
        if kind == "polygon":
            inner.append('<string name="vertices" value="0,0,0 3,0,0 3,2,0 0,2,0; 1,0.5,0 2,0.5,0 1.5,1,0"/>')
        if kind in ("ply", "obj"):
            inner.append(f'<string name="filename" value="{self.mesh(kind)}"/>')
            if self.rng.random() < 0.3:
                inner.append('<boolean name="face_normals" value="true"/>')
        return f'<shape type="{kind}" id="{self.name(kind)}">{"".join(inner)}</shape>'

    def mesh(self, kind: str) -> str:
        """Write a small random mesh file and return its name."""
        count = 8
        vertices = [[float(self.number()) for _ in range(3)] for _ in range(count)]
        # No triangle twice: back to back, their normals would cancel and leave nothing but rounding.
        chosen = self.rng.sample(list(combinations(range(count), 3)), 10)
        faces = [self.rng.sample(face, 3) for face in chosen]
        normals = self.rng.random() < 0.5
        name = f"{self.name('mesh')}.{kind}"
        lines: list[str] = []
        if kind == "ply":
            lines = ["ply", "format ascii 1.0", f"element vertex {count}"]
            lines += [f"property float {axis}" for axis in ("x", "y", "z", *(("nx", "ny", "nz") if normals else ()))]
            lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
            for vertex in vertices:
                extra = [self.number(0.1, 1) for _ in range(3)] if normals else []
                lines.append(" ".join([*map(repr, vertex), *extra]))
            lines += ["3 " + " ".join(map(str, face)) for face in faces]
        else:
            lines = ["v " + " ".join(map(repr, vertex)) for vertex in vertices]
            lines += [f"vt {self.number(0, 1)} {self.number(0, 1)}" for _ in range(4)]
            if normals:
                lines += [f"vn {self.number(0.1, 1)} {self.number(0.1, 1)} {self.number(0.1, 1)}" for _ in range(4)]
            for face in faces:
                corners = []
                for i in face:
                    vt, vn = self.rng.randrange(1, 5), self.rng.randrange(1, 5)
                    corners.append(f"{i + 1}/{vt}/{vn}" if normals else f"{i + 1}/{vt}")
                lines.append("f " + " ".join(corners))
        (self.folder / name).write_text("\n".join(lines) + "\n")
        return name

    def light(self, kind: str) -> str:
        """Write an emitter of one kind."""
        name = self.name(kind)
        if kind == "point":
            place = f'<point name="position" value="{self.triple()}"/>' if self.rng.random() < 0.5 else self.transform()
            return f'<emitter type="point" id="{name}">{place}{self.colour("intensity", 99)}</emitter>'
        if kind == "spot":
            angle = f'<float name="cutoff_angle" value="{self.number(20, 60)}"/>' if self.rng.random() < 0.7 else ""
            beam = f'<float name="beam_width" value="{self.number(1, 19)}"/>' if self.rng.random() < 0.5 else ""
            return f"""<emitter type="spot" id="{name}">{angle}{beam}{self.transform(similar=True)}
              {self.colour("intensity", 99)}</emitter>"""
        place = f'<vector name="direction" value="{self.triple()}"/>' if self.rng.random() < 0.6 else self.transform()
        return f'<emitter type="directional" id="{name}">{place}{self.colour("irradiance", 9)}</emitter>'

    def sensor(self) -> str:
        """Write a camera with its film."""
        width, height = self.rng.randrange(2, 900), self.rng.randrange(2, 900)
        x, y = self.rng.randrange(width), self.rng.randrange(height)
        crop = [("crop_offset_x", x), ("crop_offset_y", y), ("crop_width", self.rng.randrange(1, width - x + 1)),
                ("crop_height", self.rng.randrange(1, height - y + 1))]  # fmt: skip
        film = "".join(f'<integer name="{name}" value="{value}"/>' for name, value in crop)
        film = f"""<film type="hdrfilm"><integer name="width" value="{width}"/><integer name="height" value="{height}"/>
          {film if self.rng.random() < 0.5 else ""}<rfilter type="box"/></film>
          <sampler type="independent"><integer name="sample_count" value="{self.rng.randrange(1, 20)}"/></sampler>"""
        near, far = self.number(0.01, 1), self.number(10, 99)
        clip = f'<float name="near_clip" value="{near}"/><float name="far_clip" value="{far}"/>'
        if self.rng.random() < 0.25:
            return f'<sensor type="orthographic">{clip}{self.transform()}{film}</sensor>'
        place = f"""<transform name="to_world"><rotate value="{self.axis()}" angle="{self.number(-180, 180)}"/>
          <lookat origin="{self.triple()}" target="{self.triple()}" up="{self.triple()}"/></transform>"""
        axis = self.rng.choice(["x", "y", "diagonal", "smaller", "larger"])
        fov = f'<float name="fov" value="{self.number(5, 60)}"/><string name="fov_axis" value="{axis}"/>'
        if self.rng.random() < 0.3:
            fov = f'<string name="focal_length" value="{self.number(30, 90)}mm"/>' if self.rng.random() < 0.7 else ""
        shift = f'<float name="principal_point_offset_x" value="{self.number(-1, 1)}"/>'
        return f'<sensor type="perspective">{fov}{clip}{place}{shift}{film}</sensor>'

    def scene(self) -> Path:
        """Write a scene of every kind and return its file."""
        shapes = [
            self.shape(kind) for kind in ("sphere", "rectangle", "disk", "cylinder", "cube", "polygon", "ply", "obj")
        ]
        group = '<shape type="shapegroup" id="group"><shape type="sphere" id="inner"/></shape>'
        instance = f'<shape type="instance" id="{self.name("instance")}"><ref id="group"/>{self.transform()}</shape>'
        lights = [self.light(kind) for kind in ("point", "spot", "directional")]
        sky = f'<emitter type="constant">{self.colour("radiance", 9)}</emitter>'
        parts = [*shapes, group, instance, *lights, sky]
        self.rng.shuffle(parts)
        path = self.folder / "scene.xml"
        body = "\n".join(parts)
        path.write_text(f'<scene version="3.0.0"><integrator type="whitted"/>{self.sensor()}\n{body}\n</scene>')
        return path


@pytest.mark.parametrize("block", range(10))
def test_inputs_of_random_scenes_are_bit_equal(scalar_rgb, tmp_path, block):
    for seed in range(block * RANDOM_SCENES // 10, (block + 1) * RANDOM_SCENES // 10):
        path = Maker(seed, tmp_path).scene()
        assert compare(path) == 9, f"seed {seed}"
