"""What must hold for any scene: linearity, order, scale, motion (with hypothesis).

Scenes are random: three balls and a rectangle over a floor, lit by lights of each kind. Where every number is
multiplied by a power of two, or changes its sign, no rounding differs: such pictures agree bit by bit. Elsewhere a
bound is derived.
"""

import itertools

import mitsuba as mi
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

U = 2.0**-24
SIZE = 12
UP = np.array([0.0, 1.0, 0.0])

# The fixture that sets the variant does nothing that the next example would undo.
some = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
seeds = st.integers(0, 2**32 - 1)


class Scene:
    """A random scene as plain numbers, and its picture."""

    def __init__(self, seed):
        rng = np.random.default_rng(seed)

        def f32(*args):  # inputs are exact in float32
            return np.float32(rng.uniform(*args)).astype(float)

        self.balls = [(f32([-2, -1, 4], [2, 2, 8], 3), f32(0.3, 1.0)) for _ in range(3)]
        self.plate = f32([-2, -1, 5], [2, 2, 9], 3)
        self.k = {name: [f32(0, 1, 3) for _ in range(5)] for name in ("diffuse", "specular", "mirror", "ambient")}
        self.exponents = [float(rng.integers(1, 8)) for _ in range(5)]  # no power comes near to underflow
        self.bulbs = [(f32([-4, 1, 0], [4, 6, 8], 3), f32(5, 50, 3)) for _ in range(2)]
        self.suns = [(f32([-1, -2, -1], [1, -0.5, 1], 3), f32(0, 1, 3)) for _ in range(2)]
        self.spots = [(f32([-4, 3, 0], [4, 6, 4], 3), f32(5, 50, 3)) for _ in range(2)]
        self.ambient = f32(0, 0.5, 3)
        self.scale = 1.0
        self.flip = 1.0
        self.falloff = "none"
        self.max_depth = 4

    def dictionary(self):
        """Describe the scene to Mitsuba."""
        transform = mi.ScalarTransform4f

        def turn(v):
            return (np.asarray(v) * [self.flip, 1, 1]).tolist()

        def place(p):
            return turn(self.scale * np.asarray(p))

        def material(i):
            colours = {
                f"{name}_reflectance": {"type": "rgb", "value": values[i].tolist()} for name, values in self.k.items()
            }
            return {"type": "twosided", "bsdf": {"type": "blinnphong", "exponent": self.exponents[i], **colours}}

        s = self.scale
        floor = transform().translate(place([0, -2, 0])) @ transform().scale([64 * s, s, 64 * s])
        plate = transform().translate(place(self.plate)) @ transform().scale([s, s, s])
        shapes = {
            f"ball{i}": {"type": "sphere", "center": place(c), "radius": s * r, "bsdf": material(i)}
            for i, (c, r) in enumerate(self.balls)
        }
        # A rectangle turned onto the plane y = 0 by its matrix, whose elements are 0 and +-1.
        lying = transform([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
        shapes["floor"] = {"type": "rectangle", "to_world": floor @ lying, "bsdf": material(3)}
        shapes["plate"] = {"type": "rectangle", "to_world": plate, "bsdf": material(4)}
        lights = {
            f"bulb{i}": {"type": "point", "position": place(p), "intensity": {"type": "rgb", "value": c.tolist()}}
            for i, (p, c) in enumerate(self.bulbs)
        }
        lights |= {
            f"sun{i}": {"type": "directional", "direction": turn(v), "irradiance": {"type": "rgb", "value": c.tolist()}}
            for i, (v, c) in enumerate(self.suns)
        }
        lights |= {
            f"spot{i}": {
                "type": "spot",
                "to_world": transform().look_at(place(p), place(p - UP), [0, 0, 1]),
                "cutoff_angle": 60,
                "intensity": {"type": "rgb", "value": c.tolist()},
            }
            for i, (p, c) in enumerate(self.spots)
        }
        film = {"type": "hdrfilm", "width": SIZE, "height": SIZE, "filter": {"type": "box"}}
        return {
            "type": "scene",
            "integrator": {
                "type": "whitted",
                "falloff": self.falloff,
                "max_depth": self.max_depth,
                "ambient": {"type": "rgb", "value": self.ambient.tolist()},
            },
            "camera": {
                "type": "perspective",
                "fov": 60,
                "near_clip": 0.01 * s,
                "far_clip": 1e4 * s,
                "film": film,
            },
            **shapes,
            **lights,
        }

    def picture(self):
        """Draw it: (SIZE, SIZE, 3)."""
        scene = mi.load_dict(self.dictionary(), optimize=False)
        return np.array(mi.render(scene, spp=1)).astype(np.float64)


# ------------------------------------------------------------------------------------------- exact: powers of two
@some
@given(seed=seeds, power=st.integers(-8, 8))
def test_light_of_twice_the_strength_gives_twice_the_picture(llvm_ad_rgb, seed, power):
    scene = Scene(seed)
    before = scene.picture()
    for lights in (scene.bulbs, scene.suns, scene.spots):
        lights[:] = [(where, 2.0**power * colour) for where, colour in lights]
    scene.ambient = 2.0**power * scene.ambient
    assert np.array_equal(scene.picture(), 2.0**power * before)
    assert before.max() > 0


@some
@given(seed=seeds, power=st.integers(-6, 0))
def test_all_but_the_mirrors_are_linear_in_the_reflectances(llvm_ad_rgb, seed, power):
    scene = Scene(seed)
    before = scene.picture()
    for name in ("diffuse", "specular", "ambient"):
        scene.k[name] = [2.0**power * k for k in scene.k[name]]
    assert np.array_equal(scene.picture(), 2.0**power * before)


@some
@given(seed=seeds, power=st.integers(-6, 0), name=st.sampled_from(["diffuse", "specular", "ambient"]))
def test_each_reflectance_is_linear_by_itself(llvm_ad_rgb, seed, power, name):
    scene = Scene(seed)
    for other in {"diffuse", "specular", "ambient"} - {name}:
        scene.k[other] = [0 * k for k in scene.k[other]]
    before = scene.picture()
    scene.k[name] = [2.0**power * k for k in scene.k[name]]
    assert np.array_equal(scene.picture(), 2.0**power * before)


@some
@given(seed=seeds, power=st.integers(1, 6))
def test_what_a_mirror_shows_is_linear_in_k_m(llvm_ad_rgb, seed, power):
    # The floor is the only mirror and shows nothing of its own; the rest of the picture stays as it is.
    scene = Scene(seed)
    for name in ("diffuse", "specular", "ambient"):
        scene.k[name][3] = np.zeros(3)
    scene.k["mirror"] = [np.zeros(3)] * 5
    without = scene.picture()
    scene.k["mirror"][3] = np.ones(3)
    perfect = scene.picture()
    assume(np.any(perfect > without))
    scene.k["mirror"][3] = np.full(3, 2.0**-power)
    assert np.array_equal(scene.picture() - without, 2.0**-power * (perfect - without))


@some
@given(seed=seeds, power=st.integers(-10, 10))
def test_a_world_of_twice_the_size_is_the_same_picture(llvm_ad_rgb, seed, power):
    # With the textbook's lights; no length is built in anywhere.
    scene = Scene(seed)
    before = scene.picture()
    scene.scale = 2.0**power
    assert np.array_equal(scene.picture(), before)


@some
@given(seed=seeds, power=st.integers(-6, 6))
def test_light_that_fades_needs_four_times_the_strength_at_twice_the_distance(llvm_ad_rgb, seed, power):
    scene = Scene(seed)
    scene.falloff = "inverse_square"
    before = scene.picture()
    scene.scale = 2.0**power
    scene.bulbs = [(p, 4.0**power * c) for p, c in scene.bulbs]
    scene.spots = [(p, 4.0**power * c) for p, c in scene.spots]
    assert np.array_equal(scene.picture(), before)


# ---------------------------------------------------------------------------------------- exact: signs and order
@some
@given(seed=seeds)
def test_the_world_in_a_looking_glass_is_the_picture_turned_round(llvm_ad_rgb, seed):
    # x -> -x: of all numbers only the sign of x changes. (A spot light's own frame turns; its cone is round.)
    scene = Scene(seed)
    scene.spots = []
    before = scene.picture()
    scene.flip = -1.0
    assert np.array_equal(scene.picture(), before[:, ::-1])


@some
@given(seed=seeds, data=st.data())
def test_the_order_of_shapes_does_not_matter(llvm_ad_rgb, seed, data):
    scene = Scene(seed)
    before = scene.picture()
    keys = list(scene.dictionary())
    shapes = [key for key in keys if key.startswith(("ball", "floor", "plate"))]
    shuffled = data.draw(st.permutations(shapes))
    assert np.array_equal(in_order(scene, [*shuffled, *(key for key in keys if key not in shapes)]), before)


@some
@given(seed=seeds, data=st.data())
def test_the_order_of_lights_is_that_of_a_sum(llvm_ad_rgb, seed, data):
    # Six lights and the ambient term at each of three hits: 21 terms, none negative, have 20 roundings in any order,
    # and 3 for the product of a term and two k_m, fused with a sum or not.
    scene = Scene(seed)
    before = scene.picture()
    keys = list(scene.dictionary())
    lights = [key for key in keys if key.startswith(("bulb", "sun", "spot"))]
    shuffled = data.draw(st.permutations(lights))
    after = in_order(scene, [*(key for key in keys if key not in lights), *shuffled])
    assert np.all(np.abs(after - before) <= 2 * (20 + 3) * U * before)


def in_order(scene, keys):
    entries = scene.dictionary()
    scene = mi.load_dict({key: entries[key] for key in keys}, optimize=False)
    return np.array(mi.render(scene, spp=1)).astype(np.float64)


# ----------------------------------------------------------------------------------------------- within roundings
@some
@given(seed=seeds)
def test_the_picture_of_all_lights_is_the_sum_of_their_pictures(llvm_ad_rgb, seed):
    # Three hits, each with 6 lights and the ambient term: 21 terms, none negative, have 20 roundings in any order;
    # the products with k_m, 2 on the way to the third hit, and that of the term itself are done for every light
    # apart, fused with a sum or not.
    scene = Scene(seed)
    together = scene.picture()
    ambient, dark = scene.ambient, {"bulbs": [], "suns": [], "spots": []}
    lights = {name: getattr(scene, name) for name in dark}
    vars(scene).update(dark)
    alone = scene.picture()
    scene.ambient = 0 * ambient
    for name, group in lights.items():
        for light in group:
            vars(scene).update(dark, **{name: [light]})
            alone = alone + scene.picture()
    assert np.all(np.abs(together - alone) <= 2 * (20 + 3) * U * alone)


@some
@given(seed=seeds, terms=st.permutations(["ambient", "diffuse", "specular"]))
def test_the_picture_is_the_sum_of_its_terms(llvm_ad_rgb, seed, terms):
    # The same for 3 hits with 6 lights of 2 terms each, and the ambient term: 39 terms.
    scene = Scene(seed)
    together = scene.picture()
    reflectances = dict(scene.k)
    alone = np.zeros_like(together)
    for term in terms:
        scene.k = {
            name: values if name in (term, "mirror") else [0 * k for k in values]
            for name, values in reflectances.items()
        }
        alone = alone + scene.picture()
    assert np.all(np.abs(together - alone) <= 2 * (38 + 3) * U * alone)


def moved_ball(turn, shift):
    """Describe a ball of radius 3 around (0, 0, 4) under l = (1, 2, -2) / 3, turned and shifted with its camera."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn, shift
    centre, l = turn @ [0, 0, 4] + shift, turn @ LIGHT  # noqa: E741
    view = f"""<sensor type="perspective"><float name="fov" value="90"/><transform name="to_world">
      <matrix value="{" ".join(map(str, matrix.ravel().tolist()))}"/></transform>{{film}}</sensor>"""
    body = f"""<shape type="sphere" id="ball"><point name="center" value="{", ".join(map(str, centre.tolist()))}"/>
      <float name="radius" value="3"/><bsdf type="blinnphong"><float name="diffuse_reflectance" value="0.5"/></bsdf>
      </shape>
      <emitter type="directional" id="sun"><vector name="direction" value="{", ".join(map(str, (-l).tolist()))}"/>
      <float name="irradiance" value="1"/></emitter>"""
    return {"body": body, "sensor": view, "size": (SIZE, SIZE)}


LIGHT = np.array([1.0, 2.0, -2.0]) / 3
CENTRE = np.array([0.0, 0.0, 4.0])


def colour_of_ball(d):
    """k_d n.l for rays from the origin that hit the ball at the front."""
    b = d @ CENTRE
    t = b - np.sqrt(b * b - (16 - 9))
    return np.repeat(0.5 * ((t[..., None] * d - CENTRE) / 3 @ LIGHT)[..., None], 3, axis=-1)


def check_moved_ball(see, agree, directions, turn, shift):
    """Compare with the ball that was not moved.

    Coordinates are larger by the shift s: a point is known to 64 u (t + |s|), which is a ray turned 1 + |s| / t times
    as far, 1 <= t <= 4; and the normal of a ball of radius 3 to 64 u (1 + (t + |s|) / 3).
    """
    d = directions(SIZE, SIZE)
    away = np.linalg.norm(np.cross(CENTRE, d), axis=-1)
    s = np.linalg.norm(shift)
    assert np.all(np.abs(away - 3) > 64 * U * (4 + s))
    hit = away < 3
    picture = see(**moved_ball(turn, shift))
    assert np.all(picture[~hit] == 0)
    expected = colour_of_ball(d[hit])[:, 0]
    lit = expected > 0
    assert np.count_nonzero(lit) > SIZE
    condition = (1 + (4 + s) / 3) * 0.5 / expected[lit][:, None]
    agree(picture[hit][lit], colour_of_ball, d[hit][lit], condition=condition, hits=1 + s)


unit_vectors = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: sum(x * x for x in q) > 0.01)


@some
@given(q=unit_vectors, shift=st.tuples(*[st.floats(-64, 64, width=32)] * 3))
def test_scene_and_camera_moved_together_give_the_same_picture(llvm_ad_rgb, see, agree, directions, q, shift):
    w, x, y, z = np.array(q) / np.linalg.norm(q)
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    check_moved_ball(see, agree, directions, turn, np.array(shift))


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, -1), (-1, -1, -1)])
def test_no_axis_is_preferred(any_rgb, see, agree, directions, order, signs):
    # Mirrored or not: a camera of determinant -1 is one as well.
    check_moved_ball(see, agree, directions, np.diag(signs)[list(order)], np.zeros(3))
