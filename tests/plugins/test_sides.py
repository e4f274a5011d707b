"""Front and back: one- and two-sided surfaces, mirrored shapes, and normals that disagree (sections 1 and 5).

Unless said otherwise a shape at z = 4 is looked at along the z axis, v = (0, 0, -1), with k_a = 1/2 and I_a = 1/8:
a front shows 1/16 exactly, a back is black.
"""

import itertools

import numpy as np
import pytest

AMBIENT = '<rgb name="ambient" value="0.125"/>'
FRONT, BACK = 0.0625, 0.0
HALF = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/></bsdf>'
QUARTER = '<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.25"/></bsdf>'
SHINY = """<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/>
  <float name="specular_reflectance" value="1"/><float name="exponent" value="0"/>
  <float name="mirror_reflectance" value="0.5"/></bsdf>"""
MIRROR = """<bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
  <float name="mirror_reflectance" value="0.5"/></bsdf>"""
SKY = '<emitter type="constant" id="sky"><float name="radiance" value="2"/></emitter>'
FLIPPED = '<boolean name="flip_normals" value="true"/>'
TURNED, LEFT_AS_IT_IS = "-1, 1, -1", "1, 1, 1"


def two_sided(*bsdfs):
    return f'<bsdf type="twosided">{"".join(bsdfs)}</bsdf>'


def shape(kind, bsdf=HALF, scale=LEFT_AS_IT_IS, z=4, parameters=""):
    return f"""<shape type="{kind}" id="it">{parameters}<transform name="to_world"><scale value="{scale}"/>
      <translate z="{z}"/></transform>{bsdf}</shape>"""


def sun(direction):
    return f"""<emitter type="directional" id="sun"><vector name="direction" value="{direction}"/>
      <float name="irradiance" value="1"/></emitter>"""


def view(origin, target):
    return f"""<sensor type="perspective"><float name="fov" value="1"/><transform name="to_world">
      <lookat origin="{origin}" target="{target}" up="0, 1, 0"/></transform>{{film}}</sensor>"""


# ---------------------------------------------------------------------------------------- which side is the front
OBJ = "v -1 -1 0\nv 1 -1 0\nv 0 2 0\n"
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
{normals}element face 1
property list uchar int vertex_indices
end_header
-1 -1 0{n}
1 -1 0{n}
0 2 0{n}
3 0 1 2
"""


def ply(n=None):
    if n is None:
        return PLY.format(normals="", n="")
    return PLY.format(normals="".join(f"property float n{axis}\n" for axis in "xyz"), n=f" {n}")


FILES = {
    "plain.obj": OBJ + "f 1 2 3\n",
    "normals.obj": OBJ + "vn 0 0 1\nf 1//1 2//1 3//1\n",
    "plain.ply": ply(),
    "normals.ply": ply("0 0 1"),
}
FACE_NORMALS = '<boolean name="face_normals" value="true"/>'


def file(name):
    return f'<string name="filename" value="{{folder}}/{name}"/>'


# What the eye sees as its scale mirrors nothing, z, x, or both. All but sphere, cube and cylinder begin with their
# normal along +z, away from the eye. M^-T n follows a mirrored z; the cross product of the edges, a mirrored x.
FOLLOWS_NORMAL = (BACK, FRONT, BACK, FRONT)
FOLLOWS_WINDING = (BACK, BACK, FRONT, FRONT)
STAYS_OUTWARD = (FRONT, FRONT, FRONT, FRONT)
TURNS_INSIDE_OUT = (FRONT, BACK, BACK, FRONT)
SCALES = ("1, 1, 1", "1, 1, -1", "-1, 1, 1", "-1, 1, -1")
SHAPES = {
    "rectangle": ("rectangle", "", FOLLOWS_NORMAL),
    "disk": ("disk", "", FOLLOWS_NORMAL),
    "mesh with normals (obj)": ("obj", file("normals.obj"), FOLLOWS_NORMAL),
    "mesh with normals (ply)": ("ply", file("normals.ply"), FOLLOWS_NORMAL),
    "mesh without normals (obj)": ("obj", file("plain.obj"), FOLLOWS_WINDING),
    "mesh without normals (ply)": ("ply", file("plain.ply"), FOLLOWS_WINDING),
    "mesh with face normals (obj)": ("obj", file("plain.obj") + FACE_NORMALS, FOLLOWS_WINDING),
    "mesh with face normals (ply)": ("ply", file("plain.ply") + FACE_NORMALS, FOLLOWS_WINDING),
    "polygon": (
        "polygon",
        '<string name="vertices" value="-1,-1,0 1,-1,0 1,1,0 -1,1,0; -.5,.5,0 .5,.5,0 0,.9,0"/>',
        FOLLOWS_WINDING,
    ),
    "sphere": ("sphere", "", TURNS_INSIDE_OUT),
    "cube": ("cube", "", STAYS_OUTWARD),
    "cylinder": (
        "cylinder",
        '<point name="p0" value="0, -1, 0"/><point name="p1" value="0, 1, 0"/>',
        STAYS_OUTWARD,
    ),
}

every_shape = pytest.mark.parametrize("name", SHAPES)


@pytest.fixture
def folder(tmp_path):
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    return tmp_path


@every_shape
@pytest.mark.parametrize("flip", [False, True])
def test_the_front_is_where_the_normal_points_however_the_shape_is_mirrored(any_rgb, see, folder, name, flip):
    kind, parameters, seen = SHAPES[name]
    parameters = parameters.format(folder=folder) + (FLIPPED if flip else "")
    for scale, colour in zip(SCALES, seen, strict=True):
        picture = see(shape(kind, scale=scale, parameters=parameters), AMBIENT)
        assert np.all(picture == (colour if not flip else FRONT - colour)), scale


@every_shape
def test_two_sided_shapes_show_either_side(llvm_ad_rgb, see, folder, name):
    kind, parameters, seen = SHAPES[name]
    parameters = parameters.format(folder=folder)
    for scale, colour in zip(SCALES, seen, strict=True):
        both = see(shape(kind, two_sided(HALF), scale, parameters=parameters), AMBIENT)
        assert np.all(both == FRONT), scale
        each = see(shape(kind, two_sided(HALF, QUARTER), scale, parameters=parameters), AMBIENT)
        assert np.all(each == (FRONT if colour else FRONT / 2)), scale


@pytest.mark.parametrize("name", ["sphere", "cube", "cylinder"])
def test_closed_shapes_are_black_inside_unless_they_are_turned_inside_out(any_rgb, see, name):
    kind, parameters, seen = SHAPES[name]
    for scale, colour in zip(SCALES, seen, strict=True):
        for flip in (False, True):
            inside = shape(kind, scale=scale, z=0, parameters=parameters + (FLIPPED if flip else ""))
            assert np.all(see(inside, AMBIENT) == (colour if flip else FRONT - colour)), (scale, flip)


def test_mirrored_instances_stay_outward(llvm_ad_rgb, see):
    for kind, scale in itertools.product(("sphere", "cube"), SCALES):
        group = f"""<shape type="shapegroup" id="group"><shape type="{kind}" id="member">{HALF}</shape></shape>
          <shape type="instance" id="it"><ref id="group"/><transform name="to_world"><scale value="{scale}"/>
          <translate z="4"/></transform></shape>"""
        assert np.all(see(group, AMBIENT) == FRONT), (kind, scale)


# ---------------------------------------------------------------------------------------------------- one-sided
def test_a_back_is_black_in_every_term(any_variant, see):
    back = shape("rectangle", SHINY)
    for light in (sun("0, 0, 1"), sun("0, 0, -1"), SKY):
        assert np.all(see(back + light, AMBIENT) == 0)
    assert np.all(see(shape("rectangle", SHINY, TURNED) + SKY, AMBIENT) == 0.0625 + 0.5 * 2)


def test_a_back_in_a_mirror_is_black(any_variant, see):
    front = shape("rectangle", MIRROR, TURNED)
    for scale, colour in ((TURNED, BACK), (LEFT_AS_IT_IS, FRONT)):
        behind = shape("rectangle", HALF, scale, z=-4).replace('"it"', '"behind"')
        assert np.all(see(front + behind + SKY, AMBIENT) == 0.5 * colour)


def test_a_shape_without_bsdf_is_diffuse_and_one_sided(any_variant, see, agree):
    # diffuse of reflectance 1/2: k_a = k_d = 1 / 2 pi
    assert np.all(see(shape("rectangle", ""), AMBIENT) == 0)
    agree(see(shape("rectangle", "", TURNED), AMBIENT), 0.125 / (2 * np.pi))
    agree(see(shape("rectangle", "", TURNED) + sun("0, 0, 1")), 1 / (2 * np.pi))


# ---------------------------------------------------------------------------------------------------- two-sided
def test_each_side_of_a_two_sided_surface_is_lit_from_its_own_side(any_variant, see):
    for scale, bsdf in itertools.product((LEFT_AS_IT_IS, TURNED), (HALF, SHINY.replace('"1"', '"0"'))):
        wall = shape("rectangle", two_sided(bsdf), scale)
        assert np.all(see(wall + sun("0, 0, 1")) == 0.5)
        assert np.all(see(wall + sun("0, 0, -1")) == 0)


def test_both_sides_of_a_two_sided_mirror_reflect(any_variant, see):
    for scale in (LEFT_AS_IT_IS, TURNED):
        assert np.all(see(shape("rectangle", two_sided(MIRROR), scale) + SKY) == 1)


def test_the_second_material_is_on_the_back(any_variant, see):
    for scale, colour in ((TURNED, 0.5), (LEFT_AS_IT_IS, 0.25)):
        assert np.all(see(shape("rectangle", two_sided(HALF, QUARTER), scale) + sun("0, 0, 1")) == colour)


def test_an_area_light_stays_one_sided_on_a_two_sided_surface(any_variant, see):
    lamp = two_sided(HALF) + '<emitter type="area"><float name="radiance" value="8"/></emitter>'
    assert np.all(see(shape("rectangle", lamp, TURNED), AMBIENT) == 8 + 0.0625)
    assert np.all(see(shape("rectangle", lamp), AMBIENT) == 0.0625)


# -------------------------------------------------------------------------- shading and geometric normal disagree
def tilted(n, bsdf, folder):
    """Make a triangle in z = 4, wound to face the camera (n_g = (0, 0, -1)), whose vertex normals are n."""
    x, y, z = (float(v) for v in n.split())
    (folder / "tilted.ply").write_text(ply(f"{-x} {y} {-z}"))  # turned with the shape, by M^-T = M
    return shape("ply", bsdf, "-8, 8, -8", parameters=f'<string name="filename" value="{folder}/tilted.ply"/>')


def test_a_tilted_normal_shades_the_surface(any_rgb, see, agree, folder):
    body = tilted("0.8 0 -0.6", HALF, folder)
    assert np.all(see(body, AMBIENT) == FRONT)
    agree(see(body + sun("0, 0, 1")), 0.5 * 0.6, condition=1 / 0.6)


@pytest.mark.parametrize(
    ("direction", "why"),
    [
        ("-0.8, 0, -0.6", "n.l = 0.28, n_g.l = -0.6"),
        ("-1, 0, 0", "n.l = 0.8, n_g.l = 0"),
        ("0.8, 0, 0.6", "n.l = -0.28, n_g.l = 0.6"),
        ("0, 0, -1", "n.l = -0.6, n_g.l = -1"),
    ],
)
def test_a_light_below_either_horizon_adds_nothing(any_rgb, see, folder, direction, why):
    shiny = SHINY.replace("mirror_reflectance", "ambient_reflectance")
    assert np.all(see(tilted("0.8 0 -0.6", shiny, folder) + sun(direction)) == 0), why


def test_a_mirror_ray_below_the_geometric_horizon_is_not_followed(any_rgb, see, folder):
    # d = (0, 0, 1). n = (0.8, 0, -0.6): r = (0.96, 0, 0.28), n_g.r < 0. n = (0.6, 0, -0.8): r = (0.96, 0, -0.28).
    assert np.all(see(tilted("0.8 0 -0.6", MIRROR, folder) + SKY) == 0)
    assert np.all(see(tilted("0.6 0 -0.8", MIRROR, folder) + SKY) == 1)


@pytest.mark.parametrize(
    ("origin", "colour", "why"),
    [
        ("-0.8, 0, 3.8", BACK, "v = (-4, 0, -1) / |.|: n.v < 0, n_g.v > 0"),
        ("0.8, 0, 4.2", BACK, "v = (4, 0, 1) / |.|: n.v > 0, n_g.v < 0"),
        ("0.8, 0, 3.8", FRONT, "v = (4, 0, -1) / |.|: both > 0"),
        ("-0.8, 0, 4.2", BACK, "v = (-4, 0, 1) / |.|: both < 0"),
    ],
)
@pytest.mark.parametrize("behind", [False, True])
def test_a_surface_is_seen_only_where_both_normals_face_the_eye(any_rgb, see, folder, origin, colour, why, behind):
    body = tilted("1 0 -0.25", two_sided(HALF) if behind else HALF, folder)
    both_away = "both < 0" in why
    seen = FRONT if behind and both_away else colour
    assert np.all(see(body, AMBIENT, sensor=view(origin, "0, 0, 4")) == seen), why


def test_the_geometric_normal_is_turned_to_the_side_of_the_shading_normal(any_rgb, see, folder):
    # The file's normals point away from the camera, the winding towards it: the front is where the normals point.
    body = tilted("0 0 1", HALF, folder)
    assert np.all(see(body, AMBIENT) == BACK)
    assert np.all(see(body, AMBIENT, sensor=view("0, 0, 8", "0, 0, 4")) == FRONT)


def test_a_ray_along_a_surface_passes_it(any_variant, see):
    edge_on = """<shape type="rectangle" id="it"><transform name="to_world"><rotate x="1" angle="90"/>
      <translate y="0.5" z="4"/></transform></shape>"""
    assert np.all(see(edge_on + SKY, size=(3, 1)) == 2)
