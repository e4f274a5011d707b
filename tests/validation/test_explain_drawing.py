"""The drawing of a pixel's rays: it holds what it should, within its frame."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

import whitted_reference
from whitted_reference.scene import Sphere
from whitted_validation import explain, scene_files
from whitted_validation.explanation.drawing import WIDTH
from whitted_validation.explanation.labels import Labels
from whitted_validation.explanation.outlines import hull, outlines


@pytest.mark.parametrize("name", ["many_spheres", "smooth_mesh", "hall_of_mirrors"])
def test_the_drawing_of_a_large_scene_stays_small_and_in_its_frame(llvm_ad_rgb: str, name: str) -> None:
    drawing = explain(name, 256, 256, variant=llvm_ad_rgb).drawing()
    assert len(drawing) < 100_000
    root = ET.fromstring(drawing)
    for svg in root.iter("svg"):
        height = float(svg.attrib["viewBox"].split()[3])
        labels = list(svg.iter("text"))
        assert 1 <= len(labels) <= 12
        for label in labels:
            assert 0 <= float(label.attrib["x"]) <= WIDTH
            assert 0 <= float(label.attrib["y"]) <= height


def test_the_drawing_shows_hits_lights_and_shadow_rays(llvm_ad_rgb: str) -> None:
    root = ET.fromstring(explain("shadows", 200, 300, variant=llvm_ad_rgb).drawing())
    for svg in root.iter("svg"):
        texts = {text.text for text in svg.iter("text")}
        assert {"eye", "p0 floor", "red_lamp", "green_lamp", "blue_sun"} == texts
        lines = [line.get("class") for line in svg.iter("line")]
        assert lines.count("shadow lit") == 2
        assert lines.count("shadow blocked") == 1
        kinds = [path.attrib["class"] for path in svg.iter("path")]
        assert kinds.count("touched") == kinds.count("blocker") == 1


def test_left_in_the_picture_is_left_in_the_plan(llvm_ad_rgb: str) -> None:
    for x, sign in ((150, -1), (360, 1)):
        plan = next(ET.fromstring(explain("shadows", x, 330, variant=llvm_ad_rgb).drawing()).iter("svg"))
        across = {c.attrib["class"]: float(c.attrib["cx"]) for c in plan.iter("circle") if "class" in c.attrib}
        assert (across["hit"] - across["eye"]) * sign > 10


def test_the_outline_of_a_ball_is_its_radius_away_under_any_placement() -> None:
    """An outline point along w is farthest there: w.x = |P^T w|, the support function of P applied to the ball."""
    scene_ = whitted_reference.load(scene_files.find("instances"))
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0][:2]
    balls = [s for s in whitted_reference.load(scene_files.find("many_spheres")).shapes if isinstance(s, Sphere)]
    assert {ball.radius for ball in balls} - {1.0}
    rounding = 64 * 2.0**-53
    for ball, outline in zip(balls, outlines(balls, axes), strict=True):
        off = np.linalg.norm(outline.rings[0] - axes @ np.array(ball.centre), axis=1)
        assert np.abs(off - ball.radius).max() <= rounding * (ball.radius + np.abs(ball.centre).max())
    inner = [o for o in outlines(scene_.shapes, axes) if "/" in o.id]
    assert inner
    assert all(np.isfinite(ring).all() for o in inner for ring in o.rings)


def test_the_hull_holds_every_point_and_only_points() -> None:
    points = np.random.default_rng(2).integers(-20, 20, size=(200, 2)).astype(float)  # with many in line
    corners = hull(points)
    ends = np.roll(corners, -1, axis=0)
    side = ends - corners
    for point in points:
        to = point - corners
        assert (side[:, 0] * to[:, 1] - side[:, 1] * to[:, 0] >= 0).all()  # integers: exact
    assert {tuple(c) for c in corners} <= {tuple(p) for p in points}


def test_labels_cover_each_other_only_where_there_is_no_room() -> None:
    labels = Labels(380, 300)
    for i in range(6):
        labels.put(f"label {i}", np.array([190.0, 150.0]), "label")
    root = ET.fromstring(f"<svg>{labels.placed()}</svg>")
    boxes = [(float(t.attrib["x"]), float(t.attrib["y"]), 6.4 * len(t.text or "")) for t in root]
    for i, (x, y, width) in enumerate(boxes):
        for other_x, other_y, other_width in boxes[:i]:
            assert x + width <= other_x or other_x + other_width <= x or abs(y - other_y) >= 14
