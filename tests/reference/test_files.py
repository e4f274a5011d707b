"""Mesh and picture files: every variant that is read, every damage that is refused, and what is written."""

from __future__ import annotations

import random
import struct
import zlib
from array import array

import pytest

from whitted_reference import SceneError, load, render, save
from whitted_reference.float32 import nearest
from whitted_reference.image import Picture
from whitted_reference.mesh_files import parse_binary32, read_obj, read_ply
from whitted_reference.picture_files import npy_bytes, png_bytes
from whitted_reference.png import encode_png, read_png

ROWS = [(0.1, -2.5, 3.25, 0.0, 0.6, 0.8, 0.25, 0.5), (1e-3, 4.0, 5.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        (7.0, 8.0, 9.0, 0.0, 1.0, 0.0, 0.75, 0.125)]  # fmt: skip
NAMES = ("x", "y", "z", "nx", "ny", "nz", "u", "v")


def write(path, content: str | bytes):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


# --------------------------------------------------------------------------------------------------- PLY
def binary_ply(order: str, real: str = "f", index: str = "vertex_indices") -> bytes:
    kind = {"f": "float", "d": "double"}[real]
    form = {"<": "little", ">": "big"}[order]
    head = ["ply", f"format binary_{form}_endian 1.0", "comment made by hand", "element vertex 3"]
    head += [f"property {kind} {name}" for name in NAMES] + ["property uchar red"]
    head += ["element face 1", f"property list uchar int {index}", "end_header", ""]
    body = b"".join(struct.pack(f"{order}8{real}B", *row, 9) for row in ROWS) + struct.pack(f"{order}B3i", 3, 2, 1, 0)
    return "\n".join(head).encode() + body


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("real", ["f", "d"])
@pytest.mark.parametrize("index", ["vertex_indices", "vertex_index"])
def test_binary_ply_of_either_byte_order_is_read(tmp_path, order, real, index):
    mesh = read_ply(write(tmp_path / "m.ply", binary_ply(order, real, index)))
    rounded = [tuple(map(nearest, row)) for row in ROWS]
    assert mesh.vertices == [row[:3] for row in rounded]
    assert mesh.normals == [row[3:6] for row in rounded]
    assert mesh.uvs == [row[6:] for row in rounded]
    assert mesh.faces == [(2, 1, 0)]


def test_ascii_ply_holds_the_same_numbers(tmp_path, ply):
    one = read_ply(write(tmp_path / "a.ply", ply(ROWS, [(2, 1, 0)], NAMES)))
    other = read_ply(write(tmp_path / "b.ply", binary_ply("<")))
    assert one == other


@pytest.mark.parametrize("names", [("s", "t"), ("texture_u", "texture_v")])
def test_ply_uv_may_be_called_otherwise(tmp_path, ply, names):
    text = ply([row[:3] + row[6:] for row in ROWS], [(0, 1, 2)], ("x", "y", "z", *names))
    assert read_ply(write(tmp_path / "m.ply", text)).uvs == [(0.25, 0.5), (0.0, 1.0), (0.75, 0.125)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ply\n", "plx\n", "no PLY header"),
        ("format ascii 1.0\n", "", "no format line"),
        ("property float x", "property colour x", "header line `property colour x` is not understood"),
        ("property float z\n", "", "element `vertex` needs the properties x, y, z"),
        ("vertex_indices", "corners", "needs the list vertex_index or vertex_indices"),
        ("3 0 1 2", "4 0 1 2 0", "a face has 4 vertices"),
        ("3 0 1 2", "3 0 1 3", "a face refers to a vertex outside 0..2"),
        ("3 0 1 2", "3 0 1", "the file ends too early"),
        ("3 0 1 2", "3 0 1 2 7", "tokens left over"),
        ("0.1", "nan", "vertex 0 is not finite"),
    ],
)
def test_damaged_ply_is_refused(tmp_path, ply, old, new, message):
    text = ply([row[:3] for row in ROWS], [(0, 1, 2)])
    assert old in text
    with pytest.raises(SceneError) as error:
        read_ply(write(tmp_path / "m.ply", text.replace(old, new)))
    assert str(error.value).startswith("m.ply: bad PLY file: ")
    assert message in str(error.value)


def test_ply_positions_must_be_real_numbers(tmp_path, ply):
    text = ply([(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)]).replace("property float x", "property int x")
    with pytest.raises(SceneError, match="vertex property `x` must be float or double"):
        read_ply(write(tmp_path / "m.ply", text))


def test_truncated_binary_ply_is_refused(tmp_path):
    for cut in (1, 13, 40):
        with pytest.raises(SceneError, match="bad PLY file"):
            read_ply(write(tmp_path / "m.ply", binary_ply("<")[:-cut]))
    with pytest.raises(SceneError, match="bytes left over"):
        read_ply(write(tmp_path / "m.ply", binary_ply("<") + b"!"))


def test_decimals_are_rounded_to_single_precision_once():
    # Just above the middle between 1 and 1 + 2^-23: double precision rounds it to the middle, from where
    # ties-to-even would fall down to 1.
    above = "1.00000005960464477539062500000001"
    assert nearest(float(above)) == 1.0
    assert parse_binary32(above) == 1.0 + 2.0**-23
    assert parse_binary32("1.000000059604644775390625") == 1.0
    assert parse_binary32("-" + above) == -1.0 - 2.0**-23
    assert parse_binary32("1.17881393432617187499999999") == nearest(1.1788139343261717)
    assert parse_binary32("0.1") == nearest(0.1)


# --------------------------------------------------------------------------------------------------- OBJ
def test_obj_fans_polygons_and_welds_equal_corners(tmp_path):
    text = """# a quadrilateral and a triangle that shares an edge with equal v/vt/vn
      v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 2 0\nvt 0 0\nvt 1 0\nvn 0 0 1\no thing\n
      f 1/1/1 2/2/1 3/2/1 4/1/1\nf 4/1/1 3/2/1 5/1/1\n"""
    mesh = read_obj(write(tmp_path / "m.obj", text))
    assert mesh.faces == [(0, 1, 2), (0, 2, 3), (3, 2, 4)]
    assert mesh.vertices == [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 2, 0)]
    assert mesh.uvs == [(0, 0), (1, 0), (1, 0), (0, 0), (0, 0)]
    assert mesh.normals == [(0, 0, 1)] * 5


def test_obj_corners_that_differ_are_not_welded(tmp_path):
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\nvn 0 1 0\nf 1//1 2//1 3//1\nf 1//2 3//2 2//2\n"
    mesh = read_obj(write(tmp_path / "m.obj", text))
    assert mesh.faces == [(0, 1, 2), (3, 4, 5)]
    assert mesh.uvs is None


@pytest.mark.parametrize(
    ("face", "message"),
    [
        ("f -1 -2 -3", "face corner `-1` is not"),
        ("f 1 2", "fewer than three corners"),
        ("f 0 1 2", "counts from 1"),
        ("f 1 2 4", "does not hold"),
        ("f 1//1 2//1 3", "vn is given for 2 of 3 corners"),
        ("f 1/1 2 3", "vt is given for 1 of 3 corners"),
        ("f 1 2 3\nvn 0 0 1", "vn is given for 0 of 3 corners"),
        ("v 1 2\nf 1 2 3", "too short"),
    ],
)
def test_obj_that_leaves_something_open_is_refused(tmp_path, face, message):
    text = f"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n{face}\n"
    if "vn 0 0 1" in face or "/" not in face:
        text = text.replace("vt 0 0\nvn 0 0 1\n", "", 1)
    elif "//" in face:
        text = text.replace("vt 0 0\n", "")
    else:
        text = text.replace("vn 0 0 1\n", "")
    with pytest.raises(SceneError) as error:
        read_obj(write(tmp_path / "m.obj", text))
    assert message in str(error.value)


def test_obj_textures_are_flipped_by_default_and_ply_textures_are_not(load_scene, ply):
    obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0.25\nf 1/1 2/1 3/1\n"
    files = {"m.obj": obj, "m.ply": ply([(0, 0, 0, 0, 0.25), (1, 0, 0, 0, 0), (0, 1, 0, 0, 0)], [(0, 1, 2)],
                                        ("x", "y", "z", "u", "v"))}  # fmt: skip
    shape = '<shape type="{0}"><string name="filename" value="m.{0}"/>{1}</shape>'
    flag = '<boolean name="flip_tex_coords" value="{}"/>'
    for kind, extra, v in [("obj", "", 0.75), ("obj", flag.format("false"), 0.25), ("ply", "", 0.25),
                           ("ply", flag.format("true"), 0.75)]:  # fmt: skip
        scene = load_scene(shape.format(kind, extra), files=files)
        assert scene.shapes[0].uvs[0] == (0, v)


# --------------------------------------------------------------------------------------------------- PNG
def png(width: int, height: int, colour: int, rows: list[bytes], depth: int = 8, interlace: int = 0) -> bytes:
    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    head = struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, interlace)
    body = zlib.compress(b"".join(rows))
    parts = chunk(b"IHDR", head) + chunk(b"IDAT", body[:7]) + chunk(b"IDAT", body[7:]) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def test_every_row_filter_is_undone(tmp_path):
    # The same two rows of RGB under each filter, filtered by the standard's definition of the encoder.
    first, second = bytes([10, 200, 30, 40, 250, 60]), bytes([12, 190, 33, 60, 5, 70])

    def filtered(kind: int, row: bytes, above: bytes) -> bytes:
        out = []
        for i, x in enumerate(row):
            a = row[i - 3] if i >= 3 else 0
            b, c = above[i], above[i - 3] if i >= 3 else 0
            p = a + b - c
            near = min((abs(p - a), 0, a), (abs(p - b), 1, b), (abs(p - c), 2, c))[2]
            out.append((x - [0, a, b, (a + b) // 2, near][kind]) & 255)
        return bytes([kind, *out])

    for kind in range(5):
        data = png(2, 2, 2, [filtered(kind, first, bytes(6)), filtered(kind, second, first)])
        picture = read_png(write(tmp_path / "t.png", data))
        assert (picture.width, picture.height, picture.channels) == (2, 2, 3)
        assert picture.texels == first + second


def test_alpha_is_dropped(tmp_path):
    grey = png(2, 1, 4, [bytes([0, 10, 99, 20, 98])])
    assert read_png(write(tmp_path / "t.png", grey)).texels == bytes([10, 20])
    colour = png(1, 1, 6, [bytes([0, 1, 2, 3, 99])])
    assert read_png(write(tmp_path / "t.png", colour)).texels == bytes([1, 2, 3])


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"GIF89a", "no PNG signature"),
        (png(1, 1, 2, [bytes(7)], depth=16), "bit depth 16"),
        (png(1, 1, 3, [bytes(2)]), "colour type 3"),
        (png(1, 1, 2, [bytes(4)], interlace=1), "interlace 1"),
        (png(1, 1, 2, [bytes(3)]), "3 bytes of pixels where 4 are due"),
        (png(1, 1, 2, [bytes([5, 0, 0, 0])]), "row filter 5"),
        (png(1, 1, 2, [bytes(4)])[:-1], "bad PNG file"),
        (
            png(1, 1, 2, [bytes(4)])[:20] + b"\1" + png(1, 1, 2, [bytes(4)])[21:],
            "checksum of chunk IHDR is wrong",
        ),
    ],
)
def test_damaged_or_unread_png_is_refused(tmp_path, data, message):
    with pytest.raises(SceneError) as error:
        read_png(write(tmp_path / "t.png", data))
    assert message in str(error.value)


# ------------------------------------------------------------------------------------------ broken files
@pytest.mark.parametrize("kind", ["ply", "ply_ascii", "obj", "png", "xml"])
def test_files_with_any_byte_changed_are_read_or_refused_in_one_line(tmp_path, ply, kind):
    good = {
        "ply": binary_ply("<"),
        "ply_ascii": ply(ROWS, [(0, 1, 2)], NAMES).encode(),
        "obj": b"v 0 0 0\nv 1 0 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\n",
        "png": png(2, 2, 2, [bytes(7), bytes(7)]),
        "xml": b"""<scene version="3.0.0"><default name="r" value="2"/><shape type="sphere" id="b"><float name="radius"
          value="$r"/><transform name="to_world"><rotate x="1" angle="30"/></transform></shape></scene>""",
    }[kind]
    read = {"ply": read_ply, "ply_ascii": read_ply, "obj": read_obj, "png": read_png, "xml": load}[kind]
    rng = random.Random(8)
    refused: list[str] = []
    for _ in range(400):
        data = bytearray(good)
        for _ in range(rng.choice([1, 1, 3])):
            place = rng.randrange(len(data))
            action = rng.randrange(3)
            if action == 0:
                data[place] = rng.randrange(256)
            elif action == 1:
                del data[place : place + rng.randrange(1, 20)]
            else:
                data[place:place] = data[rng.randrange(len(data)) :][:9]
            if not data:
                break
        try:
            read(write(tmp_path / f"broken.{kind[:3]}", bytes(data)))
        except SceneError as error:
            refused.append(str(error))
    assert len(refused) > 100
    assert not any("\n" in message for message in refused)


# ---------------------------------------------------------------------------------------- written pictures
PICTURE = Picture(2, 1, [[0.0, 0.5, 1.0, 2.0, 0.0031308, -1.0]])


def test_png_is_written_in_srgb_and_read_back(tmp_path):
    save(PICTURE, tmp_path / "p.png")
    # IEC 61966-2-1: 0.5 -> 0.7354 -> 188; 0.0031308 -> 0.04045 -> 10.
    assert read_png(tmp_path / "p.png").texels == bytes([0, 188, 255, 255, 10, 0])
    assert png_bytes(PICTURE, exposure=-1.0) == encode_png(2, 1, bytes([0, 137, 188, 255, 5, 0]))


def test_npy_holds_every_bit():
    data = npy_bytes(PICTURE)
    assert data.startswith(b"\x93NUMPY\x01\x00")
    (length,) = struct.unpack_from("<H", data, 8)
    assert (10 + length) % 64 == 0
    assert eval(data[10 : 10 + length]) == {"descr": "<f8", "fortran_order": False, "shape": (1, 2, 3)}
    assert list(array("d", data[10 + length :])) == PICTURE.rows[0]


def test_unknown_picture_ending_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"allowed: \.png, \.npy, \.exr"):
        save(PICTURE, tmp_path / "p.jpg")
    assert not list(tmp_path.iterdir())


def test_exr_is_read_back_by_mitsuba(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    np = pytest.importorskip("numpy")
    save(PICTURE, tmp_path / "p.exr")
    back = np.array(mi.Bitmap(str(tmp_path / "p.exr")))
    assert back.dtype == np.float32
    assert back.tolist() == [[[nearest(x) for x in PICTURE.rows[0][i : i + 3]] for i in (0, 3)]]


# --------------------------------------------------------------------------------------------- textures
GRADIENT = png(2, 2, 0, [bytes([0, 0, 51]), bytes([0, 102, 255])])  # raw: 0, 1/5 / 2/5, 1
FLOOR = """<shape type="rectangle"><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0"/>
  {}</bsdf></shape>"""


def bitmap(extra: str = "", name: str = "ambient_reflectance", move: str = "") -> str:
    return f"""<texture type="bitmap" name="{name}"><string name="filename" value="t.png"/>
      <boolean name="raw" value="true"/>{extra}<transform name="to_uv">{move}</transform></texture>"""


AMBIENT = '<rgb name="ambient" value="1"/>'


@pytest.mark.parametrize(
    ("wrap", "x", "y", "expected"),
    [
        # u = (x + 1) / 2, texel centres at u = 1/4, 3/4; v = 0 is the top row.
        ("clamp", -0.5, -0.5, 0), ("clamp", 0.5, -0.5, 0.2), ("clamp", -0.5, 0.5, 0.4),
        ("clamp", 0.5, 0.5, 1), ("clamp", 0, 0, 0.4), ("clamp", -1, -1, 0), ("clamp", -1, 0, 0.2),
        ("repeat", -1, -0.5, 0.1), ("repeat", -0.75, -0.5, 0.05), ("repeat", -0.5, -1, 0.2),
        ("mirror", -1, -0.5, 0), ("mirror", 1, 0.5, 1),
    ],
)  # fmt: skip
def test_bitmap_is_bilinear_between_texel_centres(eye, wrap, x, y, expected):
    body = FLOOR.format(bitmap(f'<string name="wrap_mode" value="{wrap}"/>'))
    colour = eye(body, AMBIENT, files={"t.png": GRADIENT}).see((x, y, 1), (0, 0, -1))
    # Bytes over 255 are no binary numbers: expected within one rounding of itself.
    assert all(c.low - 2.0**-53 <= expected <= c.high + 2.0**-53 for c in colour)


def test_nearest_bitmap_takes_the_texel_under_the_point(eye):
    body = FLOOR.format(bitmap('<string name="filter_type" value="nearest"/>'))
    scene = eye(body, AMBIENT, files={"t.png": GRADIENT})
    for x, y, value in [(-0.25, -0.75, 0), (0.25, -0.75, 0.2), (-0.25, 0.75, 0.4), (0.25, 0.75, 1)]:
        assert all(c.low - 2.0**-53 <= value <= c.high + 2.0**-53 for c in scene.see((x, y, 1), (0, 0, -1)))


def test_srgb_bytes_are_decoded_before_they_are_mixed(eye):
    body = FLOOR.format(bitmap().replace('<boolean name="raw" value="true"/>', ""))
    scene = eye(body, AMBIENT, files={"t.png": GRADIENT})
    half = (((0.4 + 0.055) / 1.055) ** 2.4 + 0) / 2  # between texels 0 and 102 = 0.4
    assert all(c.low - 2.0**-52 <= half <= c.high + 2.0**-52 for c in scene.see((-0.5, 0, 1), (0, 0, -1)))


def test_checkerboard_changes_at_half_strictly_and_to_uv_scales_it(eye):
    board = """<texture type="checkerboard" name="ambient_reflectance"><float name="color0" value="1"/>
      <float name="color1" value="0.25"/><transform name="to_uv">{}</transform></texture>"""
    scene = eye(FLOOR.format(board.format("")), AMBIENT)
    # u = (x + 1) / 2; the fraction must exceed 1/2 strictly.
    for x, y, value in [(-0.5, -0.5, 1), (0.5, -0.5, 0.25), (0.5, 0.5, 1), (0, -0.5, 1), (0.125, -0.5, 0.25)]:
        assert scene.sees((x, y, 1), (0, 0, -1), value)
    scene = eye(FLOOR.format(board.format('<scale x="2" y="1"/><translate x="0.25"/>')), AMBIENT)
    for x, value in [(-0.875, 1), (-0.625, 0.25), (-0.125, 1)]:  # 2 u + 1/4 = x + 5/4
        assert scene.sees((x, -0.5, 1), (0, 0, -1), value)


def test_exponent_may_be_a_texture(eye):
    # At u, v < 1/2 a checkerboard shows color0, whether it stands for a colour or for a number.
    board = """<texture type="checkerboard" name="exponent"><float name="color0" value="4"/>
      <float name="color1" value="2"/></texture><float name="specular_reflectance" value="1"/>"""
    lamp = """<emitter type="point"><point name="position" value="3.5,-0.5,3"/>
      <float name="intensity" value="25"/></emitter>"""
    colour = eye(FLOOR.format(board) + lamp).see((-0.5, -0.5, 1), (0, 0, -1))
    assert all(c.low <= 0.64 + 2.0**-53 and c.high >= 0.64 - 2.0**-53 for c in colour)  # (4/5)^(4/2)


def test_exponent_of_a_coloured_texture_is_not_judged(load_scene):
    body = FLOOR.format(bitmap().replace("ambient_reflectance", "exponent"))
    with pytest.raises(SceneError, match="not judged: exponent of a coloured texture"):
        load_scene(body, files={"t.png": png(2, 2, 2, [bytes([0, 0, 0, 0, 9, 9, 8])] * 2)})


def test_grey_scene_has_the_luminance_of_every_colour(scene_file):
    body = """<emitter type="constant"><rgb name="radiance" value="0.5 0.25 1"/></emitter>
      <shape type="sphere"><bsdf type="diffuse"><float name="reflectance" value="0.5"/></bsdf></shape>"""
    scene = load(scene_file(body, '<rgb name="ambient" value="0.1"/>'), grey=True)
    weights = [nearest(w) for w in (0.212671, 0.715160, 0.072169)]  # Rec. 709, in single precision
    y = nearest(weights[0] * 0.5 + weights[1] * 0.25 + weights[2])
    assert scene.background == (y, y, y)
    assert scene.shapes[0].look.material.reflectance == (0.5, 0.5, 0.5)
    assert scene.settings.ambient == (nearest(0.1 * sum(weights)),) * 3


def test_texture_on_a_polygon_is_not_judged(load_scene):
    body = """<shape type="polygon" id="flag"><string name="vertices" value="0,0,0 1,0,0 0,1,0"/>
      <bsdf type="diffuse"><texture type="checkerboard" name="reflectance"/></bsdf></shape>"""
    with pytest.raises(SceneError, match="not judged: polygon with a texture `flag`"):
        load_scene(body)


def test_picture_is_cached_under_everything_it_depends_on(scene_file, tmp_path):
    kept = tmp_path / "kept"
    path = scene_file('<emitter type="constant"><float name="radiance" value="0.5"/></emitter>')
    first = render(load(path), cache=kept)
    (entry,) = kept.iterdir()
    before = entry.stat().st_mtime_ns
    assert render(load(path), cache=kept) == first
    assert entry.stat().st_mtime_ns == before
    path.write_text(path.read_text().replace("0.5", "0.25"))
    assert render(load(path), cache=kept).pixel(0, 0) == (0.25, 0.25, 0.25)
    render(load(path), grid=2, cache=kept)
    assert len(list(kept.iterdir())) == 3
