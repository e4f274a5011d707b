"""The benchmark of error against cost: what is read off its curves, and that it cannot claim what it has not seen."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

from mitsuba_whitted import LIBLLVM  # isort: skip  # before Mitsuba
import mitsuba as mi
import numpy as np
import pytest

from whitted_validation.benchmark import povray, scenes
from whitted_validation.benchmark.error import GRID, TARGET, UNREFINED, Curves, Kept, Results, run
from whitted_validation.benchmark.error_checks import CHECKS, NO_CHECKS
from whitted_validation.benchmark.error_curves import Point, at_error, cheapest, cpu, rays, slope
from whitted_validation.benchmark.error_oracle import ORACLE
from whitted_validation.benchmark.error_povray import POVRAY
from whitted_validation.benchmark.error_schedule import FULL, QUICK
from whitted_validation.benchmark.error_targets import LEAST_SCENES, MOST_RAYS, costs, outcomes
from whitted_validation.benchmark.speed_pairs import Comparison, Interval
from whitted_validation.benchmark.speed_worker import Sample

needs_llvm = pytest.mark.skipif(bool(LIBLLVM.refusal), reason=str(LIBLLVM.refusal))

U = 2.0**-53


def point(way: str, rmse: float, cost: float, worst: float = 1.0) -> Point:
    """Make a picture that takes `cost` in rays and in both times."""
    ratio = Interval(*[cost] * 5)
    taken = Sample(1.0, 1.0)
    return Point(way, 1, rmse, rmse, worst, rays=cost, cost=Comparison(ratio, ratio, taken, taken, (1, 1), 1))


def power(way: str, exponent: float, worst: float = 1.0, factor: float = 1.0) -> list[Point]:
    """Make a curve of RMSE = cost ** exponent, its costs times `factor`."""
    return [point(way, (4.0**k) ** exponent, factor * 4.0**k, worst) for k in range(7)]


# ------------------------------------------------------------------------------------------------ the curves
def test_the_slope_of_a_power_is_its_exponent() -> None:
    # Seven terms each of sums of logarithms below 10, and a quotient.
    assert abs(slope(power(GRID, -0.75, factor=3), rays) + 0.75) <= 64 * U


def test_two_points_have_no_slope() -> None:
    assert math.isnan(slope(power(GRID, -0.75)[:2], rays))


@pytest.mark.parametrize("rmse", [1.0, 0.3, 2.0**-5, 2.0**-6])
def test_between_points_a_curve_is_a_power(rmse: float) -> None:
    expected = rmse**-2
    assert abs(at_error(power(GRID, -0.5), rays, rmse) - expected) <= expected * 64 * U


@pytest.mark.parametrize("rmse", [1.5, 1e-5])
def test_a_curve_says_nothing_beyond_its_ends(rmse: float) -> None:
    assert math.isnan(at_error(power(GRID, -0.5), rays, rmse))


def test_a_picture_that_another_beats_in_both_is_not_on_the_front() -> None:
    points = [point(GRID, 0.1, 1), point(GRID, 0.2, 2), point(TARGET, 0.05, 2), point(GRID, 0.05, 3)]
    assert cheapest(points, cpu) == [points[0], points[2]]


# ----------------------------------------------------------------------------------------------- the targets
def verdicts(results: Results) -> dict[str, str]:
    return {outcome.target: outcome.verdict for outcome in outcomes(results)}


def of(found: dict[str, str], words: str) -> str:
    """Return the verdict on the one target that has these words."""
    (verdict,) = [verdict for target, verdict in found.items() if words in target]
    return verdict


def measured(size: int = FULL.size, factor: float = 1.0, worst: float = 1.0) -> Results:
    """Make three scenes where refinement takes `factor` of the grid's cost to the power of 0.6."""
    points = [*power(GRID, -1.5), *[point(TARGET, p.rmse, factor * p.rmse**-0.4, worst) for p in power("", -1.5)]]
    return Results({kind: Curves("", 0, size, 0.0, 0.0, 1, 0, points) for kind in "abc"})


def test_nothing_measured_is_nothing_met() -> None:
    assert set(verdicts(Results()).values()) == {"not measured"}


def test_small_pictures_meet_no_target() -> None:
    assert set(verdicts(measured(size=FULL.size // 2)).values()) == {"not measured"}


def test_what_is_cheap_enough_is_met_and_what_is_dear_is_not() -> None:
    cheap, dear = verdicts(measured(factor=0.01)), verdicts(measured(factor=100))
    for words in ("balls: RMSE 0.001 with", "mesh: RMSE 0.0005 with", "clutter: RMSE 0.002 with"):
        assert (of(cheap, words), of(dear, words)) == ("met", "not met")
    for words in ("in at most 5 times the CPU", "in at most 1/2 of the grid's CPU", "never slower than the grid of"):
        pair = [{v for t, v in found.items() if words in t} for found in (cheap, dear)]
        assert pair == [{"met"}, {"not met"}]


def told_beside(found: dict[str, str], clock: str, what: str, share: float) -> None:
    """See that beside our time for the balls, and its gain in clutter, stands what a part of it takes."""
    (time,) = [text for target, text in found.items() if "balls" in target and f"5 times the {clock}" in target]
    ours, part = float(time.split(";")[0]), float(time.split(what)[1])
    assert abs(part - share * ours) <= 0.01 * ours  # three digits of each are shown
    (gain,) = [text for target, text in found.items() if f"1/2 of the grid's {clock}" in target]
    ours, part = (float(each.split("1/")[1]) for each in gain.split(";"))
    assert abs(part - ours / share) <= 0.01 * part


def test_beside_a_time_stands_that_of_tracing_the_same_samples_alone() -> None:
    results = measured(factor=100)
    for curves in results.scenes.values():  # half of what ours takes
        half = [replace(p, bare=point("", 1, cpu(p) / 2).cost) if p.way == TARGET else p for p in curves.points]
        curves.points = half
    found = {outcome.target: outcome.measured for outcome in outcomes(results)}
    told_beside(found, "CPU", "alone", 0.5)
    (slower,) = [text for target, text in found.items() if "never slower" in target and "CPU" in target]
    assert slower.split("alone slower in ")[1].startswith("7: ")
    assert not any("alone" in text for target, text in found.items() if "the rays" in target)


def test_beside_a_wall_time_stands_that_of_its_kernels() -> None:
    results = measured(factor=100)
    for curves in results.scenes.values():
        curves.points = [replace(p, busy=0.25) if p.way == TARGET else p for p in curves.points]
        curves.points += [replace(p, way=f"{POVRAY}, one sample") for p in curves.of(GRID)]
    found = {outcome.target: outcome.measured for outcome in outcomes(results)}
    told_beside(found, "wall", "kernels alone", 0.25)
    # The grid takes 4^k for an RMSE of 4^-1.5k, ours 25 * 4^0.6k: more up to k = 5, 3.2 / 1.74 times there.
    (slower,) = [text for target, text in found.items() if "never slower" in target and "wall" in target]
    count, times = slower.split("kernels alone slower in ")[1].split(": ")
    assert count == "6"
    assert times.split(", ")[-1].startswith(f"{25 * 4 ** (0.6 * 5) / 4**5:.3g} times at ")
    (povs,) = [text for target, text in found.items() if "balls: POV-Ray" in target]
    assert "kernels alone" in povs
    assert not any("kernels" in text for target, text in found.items() if "CPU" in target or "the rays" in target)


def test_beside_rays_slope_and_worst_pixel_stand_those_of_other_checks_and_an_oracle() -> None:
    results = measured(worst=3.0)
    for curves in results.scenes.values():
        curves.points = curves.points + [replace(p, way=ORACLE, rays=0.25 * rays(p)) for p in curves.of(TARGET)]
        for way, factor, worst in zip(CHECKS, (0.5, 8.0), (5.0, 1.5), strict=True):
            others = [replace(p, way=way, rays=factor * rays(p), largest=worst) for p in curves.of(TARGET)]
            curves.points = curves.points + others
    found = {outcome.target: outcome for outcome in outcomes(results)}
    of_rays = [outcome.measured for target, outcome in found.items() if "the rays of" in target]
    assert len(of_rays) == len(MOST_RAYS)
    for text in of_rays:
        ours, _, fewer, more, least = (float(part.split()[-1]) for part in text.split("; "))
        # Three digits of each are shown: within 1/200.
        assert abs(fewer / ours - 0.5) <= 0.5 * 2 / 199
        assert abs(more / ours - 8) <= 8 * 2 / 199
        assert abs(least / ours - 0.25) <= 0.25 * 2 / 199
    (worst,) = [outcome for target, outcome in found.items() if "worst pixel" in target]
    parts = [part for part in worst.measured.split("; ") if "pictures worse" in part]
    assert [part.split(" of ")[0].split()[-1] for part in parts] == ["21", "21", "0"]
    most = re.findall(r"at most ([0-9.]+) times", worst.measured)
    assert most == ["3", "5", "1.5"]
    assert worst.verdict == "not met"


def test_slopes_are_told_below_an_error_as_well() -> None:
    def bent(exponent: float, way: str) -> list[Point]:
        """Fall with the power -0.1 of the extra rays down to 1e-3, then with this one."""
        above = [(10.0**-k, 10.0 ** (0.1 * k - 1)) for k in (4, 3, 2)]
        below = [(10.0**k, 1e-3 * (10.0**k) ** exponent) for k in (0, 1, 2)]
        return [replace(point(way, rmse, 1.0), rays=1 + extra) for extra, rmse in above + below]

    results = measured()
    results.scenes["a"].points = [*bent(-0.8, TARGET), *bent(-1.1, NO_CHECKS), *bent(-0.7, GRID), *bent(-0.1, ORACLE)]
    (steep,) = [each.measured for each in outcomes(results) if "more steeply" in each.target]
    assert f"; {ORACLE} {slope(bent(-0.1, ORACLE), lambda p: rays(p) - 1):.2f}; from" in steep
    assert steep.endswith(f"from 0.001 down: {TARGET} -0.80, {ORACLE} -0.10, {NO_CHECKS} -1.10, {GRID} -0.70")


def test_between_two_grids_there_is_none_to_be_slower_than() -> None:
    results = measured()
    grids = [point(GRID, 0.1, 1), point(GRID, 0.01, 8), point(GRID, 0.001, 64)]
    between = 2 * 8**0.5  # the curve of the grids takes the root of 8 at the root of 0.001, and this is twice as much
    ours = [point(TARGET, 0.001**0.5, between), point(TARGET, 0.01, 8.5), point(TARGET, 0.0011, 64.5)]
    beyond = [point(TARGET, 0.2, 1.5), point(TARGET, 0.0009, 99.0)]
    results.scenes["b"].points = [*grids, *ours, *beyond, point(UNREFINED, 0.05, 2)]
    results.redrawn = [("b", replace(results.scenes["b"], points=grids + ours[1:]))]
    told = [each.measured for each in outcomes(results) if "never slower" in each.target]
    assert len(told) == 2
    for text in told:
        assert text.startswith(
            "5 of 5 pictures slower; at 0.032 2 times its time (without a target 0.707); at 0.01 1.06 "
        )
        assert text.count(UNREFINED) == 3  # the other scene's were not drawn
        assert "than the fastest grid that was drawn and is as good 4" in text.split("; ")


def test_of_several_scenes_the_median_counts() -> None:
    """One that is dear between two that are cheap is outvoted, two are not; pictures are counted one by one."""
    words = "mesh: RMSE 0.0005 with"
    dear, cheap = (measured(factor=factor).scenes["c"] for factor in (100, 0.01))
    for others, verdict in (([dear, cheap], "met"), ([dear, dear], "not met")):
        results = measured(factor=0.01)
        results.redrawn = [("c", each) for each in others]
        assert of(verdicts(results), words) == verdict
        (text,) = [outcome.measured for outcome in outcomes(results) if words in outcome.target]
        least, most = (costs([each], TARGET, rays, 5e-4)[0] for each in (cheap, dear))
        assert f"({least:.4g} to {most:.4g})" in text
    results = measured()
    results.redrawn = [("b", measured(factor=1e6).scenes["b"])]
    (slower,) = [each.measured for each in outcomes(results) if "never slower than the grid" in each.target][:1]
    assert slower.startswith("7 of 14 pictures slower")
    results.redrawn = [("b", measured(worst=2.1).scenes["b"])]
    assert of(verdicts(results), "worst pixel") == "not met"


def test_scenes_without_times_count_for_rays_worst_pixels_and_nothing_else() -> None:
    flat = [replace(point(TARGET, (4.0**k) ** -0.25, 100 * 4.0**k, worst=2.1), cost=None) for k in range(27)]
    counted = {target for target in verdicts(Results()) if "the rays of" in target or "worst pixel" in target}
    for factor, known in ((0.01, "in at most 5 times"), (1.0, "more steeply")):
        results = measured(factor=factor)
        before = verdicts(results)
        assert "met" in {verdict for target, verdict in before.items() if known in target}
        dear = [(kind, replace(each, points=[*each.of(GRID), *flat])) for kind, each in results.scenes.items()]
        results.untimed = [*dear, *dear]
        after = verdicts(results)
        assert {target for target in before if after[target] != before[target]} <= counted
        assert {after[target] for target in counted} == {"not met"}


@pytest.mark.parametrize(
    ("kind", "words", "factor"),
    [
        ("b", "in at most 1/2 of the grid's CPU", 0.01),
        ("a", "more steeply", 1.0),
        ("c", "mesh: RMSE 0.0005 with", 0.01),
    ],
)
def test_a_scene_that_says_nothing_leaves_the_median_open(kind: str, words: str, factor: float) -> None:
    results = measured(factor=factor)
    assert of(verdicts(results), words) == "met"
    dear = [point(TARGET, (4.0**k) ** -0.25, 100 * 4.0**k) for k in range(25)]  # slope -0.25, and no gain anywhere
    curves = replace(results.scenes[kind], points=[*results.scenes[kind].of(GRID), *dear])
    results.redrawn = [(kind, curves)] * 2
    assert of(verdicts(results), words) == "not met"
    results.redrawn = [(kind, replace(curves, points=[]))]
    assert of(verdicts(results), words) == "not measured"


def test_a_gain_is_told_as_a_share_from_median_to_extremes() -> None:
    results = measured(factor=0.01)
    results.redrawn = [("b", measured(factor=0.02).scenes["b"]), ("b", measured(factor=0.04).scenes["b"])]
    (text,) = [each.measured for each in outcomes(results) if "1/2 of the grid's CPU" in each.target]
    middle, least, most = (float(part.strip("()")) for part in re.findall(r"1/([0-9.e+]+)", text))
    # Three digits of each are shown: within 1/200, so that their quotients are within (1 + 1/200) / (1 - 1/200).
    for quotient in (2 * least / middle, most / middle / 2):
        assert abs(quotient - 1) <= 2 / 199


def test_small_pictures_of_other_scenes_meet_nothing_either() -> None:
    results = measured()
    small = [("a", measured(size=FULL.size // 2).scenes["a"])]
    for drawn in ({"redrawn": small}, {"untimed": small}):
        assert set(verdicts(replace(results, **drawn)).values()) == {"not measured"}


def test_a_worse_pixel_than_twice_the_grids_is_told() -> None:
    words = "worst pixel"
    assert of(verdicts(measured(worst=1.9)), words) == "met"
    assert of(verdicts(measured(worst=2.1)), words) == "not met"


def test_errors_that_the_converged_picture_cannot_judge_are_left_out() -> None:
    results = measured(worst=2.1)
    for curves in results.scenes.values():
        curves.unsure = 1.0
    assert of(verdicts(results), "worst pixel") == "not measured"


def keeping(*ratios: float, rays: float = 2.0, unsure: float = 0.0, scenes: int = LEAST_SCENES) -> Results:
    """Make scenes that keep their target but for the first ones."""
    all_ratios = [*ratios, *[0.9] * (scenes - len(ratios))]
    kept = [Kept(f"random {i}", 1e-3, ratio * 1e-3, rays, unsure) for i, ratio in enumerate(all_ratios)]
    return Results(kept=kept)


def test_one_of_thirty_above_its_target_is_within_the_promise_and_two_are_not() -> None:
    assert of(verdicts(keeping(1.2)), "target error kept") == "met"
    assert of(verdicts(keeping(1.2, 1.2)), "target error kept") == "not met"


def test_none_may_exceed_its_target_by_more_than_half() -> None:
    assert of(verdicts(keeping(1.49)), "never exceeded") == "met"
    assert of(verdicts(keeping(1.51)), "never exceeded") == "not met"


def test_a_picture_much_better_than_asked_is_wasteful_unless_it_is_cheap() -> None:
    assert of(verdicts(keeping(0.2)), "wasteful") == "not met"
    assert of(verdicts(keeping(0.2, rays=1.2)), "wasteful") == "met"


def test_what_is_wasteful_whatever_all_are_aimed_at_is_told() -> None:
    # 38 of 40 must keep their target: the third largest may grow by 4 / 3; and the largest to 1.5 of it, by 1.25.
    results = keeping(1.2, 0.9, 0.75, 0.22, 0.26, scenes=40)
    for each in range(5, 40):
        results.kept[each] = replace(results.kept[each], rmse=0.5e-3)
    (text,) = [each.measured for each in outcomes(results) if "wasteful" in each.target]
    assert text == "2 of 40 wasteful; were all errors 1.25 times as large, 1"
    results.kept[0] = replace(results.kept[0], rmse=0.9e-3)
    (text,) = [each.measured for each in outcomes(results) if "wasteful" in each.target]
    assert text == "2 of 40 wasteful; were all errors 1.33 times as large, 1"
    without_error = [0.0] * LEAST_SCENES  # and so without a limit to how much larger it may be
    for results, wasteful in ((keeping(), 0), (keeping(*without_error, rays=1.0), 0), (keeping(*without_error), 30)):
        (text,) = [each.measured for each in outcomes(results) if "wasteful" in each.target]
        assert text == f"{wasteful} of 30 wasteful"


def test_the_promise_is_not_judged_on_few_scenes_nor_by_unsure_pictures() -> None:
    for results in (keeping(scenes=LEAST_SCENES - 1), keeping(unsure=4e-4)):
        assert of(verdicts(results), "target error kept") == "not measured"


def test_a_certain_miss_counts_however_unsure_the_converged_picture_is() -> None:
    assert of(verdicts(keeping(1.3, 1.3)), "target error kept") == "not met"
    kept = keeping().kept
    unsure = [Kept(f"unsure {i}", 1e-3, rmse, 2.0, 4e-4) for i, rmse in enumerate((1.3e-3, 1.3e-3, 1.3e-3))]
    assert of(verdicts(Results(kept=kept + unsure)), "target error kept") == "met"  # each may be within 1e-3
    certain = [Kept(f"certain {i}", 1e-3, 1.5e-3, 2.0, 4e-4) for i in range(3)]
    assert of(verdicts(Results(kept=kept + certain)), "target error kept") == "not met"


# ----------------------------------------------------------------------------------------------- the drawing
@needs_llvm
def test_path_converges_to_the_picture_of_the_scene_without_mirrors(tmp_path: Path, llvm_ad_rgb: None) -> None:
    from whitted_validation.benchmark.error_drawing import PEERS, Drawing, for_peers, pixels

    drawing = Drawing(for_peers(scenes.write("a", tmp_path, 5, lights=1), "independent"), size="16")
    truth = pixels(drawing.grid(16)).astype(float)
    for name in PEERS:
        error = [float(np.sqrt(np.mean((pixels(drawing.peer(name, n)) - truth) ** 2))) for n in (4, 1024)]
        # Independent samples: 256 times as many have a 16th of the error. The grid's own error, and chance in an RMSE
        # over hundreds of pixels, are nowhere near a factor of two.
        assert error[1] < error[0] / 8


@needs_llvm
def test_the_samples_that_are_traced_alone_cause_the_rays_of_the_refinement(tmp_path: Path, llvm_ad_rgb: None) -> None:
    from mitsuba_whitted.trace import trace
    from whitted_validation.benchmark.error_bare import samples

    scene = mi.load_file(str(scenes.write("a", tmp_path, 5)), size="64")
    integrator = scene.integrator()
    integrator.settings = replace(integrator.settings, target_error=1e-3)
    counted = integrator.count_rays(scene)
    places = samples(scene)
    stage, camera, plan = integrator._prepare(scene, scene.sensors()[0])
    traced = trace(stage, plan, camera.rays(*(mi.Float(axis) for axis in places.T)))
    secondary = int(np.array(traced.mirror_rays + traced.shadow_rays, np.uint64).sum())
    assert (len(places), secondary) == (counted["camera"], counted["mirror"] + counted["shadow"])
    # Neighbours follow each other: along a Z curve all samples of a square of 4 x 4 pixels do.
    squares = np.floor(places / 4)
    runs = 1 + np.count_nonzero((squares[1:] != squares[:-1]).any(axis=1))
    assert runs == len(np.unique(squares, axis=0))


@needs_llvm
def test_what_no_corner_of_a_pixel_sees_is_hidden_and_a_large_body_is_not(tmp_path: Path, llvm_ad_rgb: None) -> None:
    from whitted_validation.benchmark.error_drawing import Drawing

    def hidden(radius: float) -> list[tuple[int, ...]]:
        file = tmp_path / f"ball_{radius}.xml"
        file.write_text(f"""<scene version="3.0.0"><integrator type="whitted"/><sensor type="perspective">
          <float name="fov" value="90"/><film type="hdrfilm"><integer name="width" value="8"/>
          <integer name="height" value="8"/><rfilter type="box"/></film></sensor><shape type="sphere">
          <point name="center" value="-1.25, 3.75, 10"/><float name="radius" value="{radius}"/>
          <emitter type="area"/></shape></scene>""")
        return [tuple(map(int, place)) for place in np.argwhere(Drawing(file).hidden(16))]

    # A pixel is 2.5 wide at the ball's distance: its centre is that of the pixel in column 4, row 2.
    assert hidden(0.5) == [(2, 4)]
    assert hidden(3.0) == []


def test_what_path_cannot_draw_is_taken_out_of_the_scene(tmp_path: Path) -> None:
    from whitted_validation.benchmark.error_drawing import for_peers

    root = ET.parse(for_peers(scenes.write("a", tmp_path, lights=1), "stratified")).getroot()
    assert [emitter.get("type") for emitter in root.iter("emitter")] == ["point"]
    assert {e.get("name") for e in root.iter()}.isdisjoint({"mirror_reflectance", "ambient"})
    assert [sampler.get("type") for sampler in root.iter("sampler")] == ["stratified"]


@needs_llvm
def test_other_checks_take_other_samples_and_are_taken_back(tmp_path: Path, llvm_ad_rgb: None) -> None:
    from mitsuba_whitted import hidden
    from whitted_validation.benchmark.error_checks import checks_times
    from whitted_validation.benchmark.error_drawing import Drawing, pixels

    file, before = scenes.write("a", tmp_path, 5), dict(vars(hidden))
    drawing = Drawing(file, size="64")
    counted = [drawing.rays_to(1e-3, checks) for checks in (0.0, 1.0, 16.0)]
    assert len(set(counted)) == 3
    assert max(counted) == counted[2]
    pictures = [pixels(drawing.to(1e-3, checks)) for checks in (16.0, 1.0)]
    assert not np.array_equal(*pictures)
    scene = mi.load_file(str(file), size="64")
    scene.integrator().settings = replace(scene.integrator().settings, target_error=1e-3)
    assert np.array_equal(pictures[1], np.array(mi.render(scene)))

    @checks_times(2.0)
    def fail() -> None:
        assert 2 * before["NEAR"] == hidden.NEAR
        raise InterruptedError

    with pytest.raises(InterruptedError):
        fail()
    assert vars(hidden) == before


@needs_llvm
def test_the_times_of_kernels_are_told_in_parts_of_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    from whitted_validation.benchmark import error_picture

    seconds = iter([0.1, 0.2, 0.5, 0.4, 0.3])  # of five pictures

    class Kernels:
        running, compiling = 0.03, 1.0

        def __enter__(self) -> Kernels:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr(error_picture, "Stopwatch", Kernels)
    pictures = SimpleNamespace(sample=lambda count: Sample(next(seconds) / count, math.nan))
    monkeypatch.setattr(error_picture, "Timed", lambda draw, side: pictures)
    assert error_picture.busy(lambda: None, 64) == 0.03 / 0.3


# ----------------------------------------------------------------------------------------------- the command
@needs_llvm
@pytest.mark.slow
def test_as_many_steps_are_told_as_there_are(tmp_path: Path, llvm_ad_rgb: None) -> None:
    small = replace(QUICK, size=16, grids=(1,), targets=(1e-2,), converged=21, peers_size=16, spp=(1,), povray=())
    small = replace(small, epsilons=(1e-3,), exact_size=8, random=1, random_size=(16, 12), patience=0.1)
    assert sum(1 for _ in run(small, tmp_path, Results(), lambda _: None)) == small.count()


@needs_llvm
@pytest.mark.slow
def test_the_quick_benchmark_writes_data_and_a_page(tmp_path: Path) -> None:
    ours = "from whitted_validation.cli import main; main()"
    arguments = ["benchmark", "error", "--quick", "--report", str(tmp_path / "report")]
    done = subprocess.run([sys.executable, "-c", ours, *arguments], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    facts = json.loads((tmp_path / "report" / "results.json").read_text())
    assert facts["complete"] is True
    assert [each["kind"] for each in facts["redrawn"]] == ["a"]
    assert facts["redrawn"][0]["seed"] == facts["scenes"]["a"]["seed"] + 1
    points = facts["scenes"]["a"]["points"]
    ways = {"grid", "without a target", "target error", *CHECKS, ORACLE}
    (untimed,) = facts["untimed"]
    assert (untimed["kind"], untimed["seed"]) == ("a", facts["scenes"]["a"]["seed"] + 2)
    assert {point["way"] for point in untimed["points"]} == ways
    for each, is_timed in ((facts["redrawn"][0], True), (untimed, False)):
        ours = [point for point in each["points"] if point["way"] == "target error"]
        assert {point[cost] is not None for point in ours for cost in ("cost", "bare", "busy")} == {is_timed}
        assert all(point["rays"] > 1 for point in ours)
    assert {kept["scene"] for kept in facts["kept"]} >= {f"scene a, seed {untimed['seed']}"}
    if povray.version() is None:
        assert "scene a: POV-Ray is not installed" in facts["notes"]
    else:
        ways |= {"POV-Ray, one sample", "POV-Ray method 2, depth 3"}
    assert ({point["way"] for point in points}, facts["povray"]) == (ways, povray.version())
    assert {point["way"] for point in facts["peers"]["points"]} > {"path, independent", "direct, independent"}
    errors = [point["rmse"] for point in points if point["way"] == "grid"]
    assert errors == sorted(errors, reverse=True)
    assert {target["verdict"] for target in facts["targets"]} == {"not measured"}
    assert all(0 == wrong["ours"] < wrong["by_epsilon"][0][1] for wrong in facts["shadows"])
    assert "<svg" in (tmp_path / "report" / "report.html").read_text()
