"""The benchmark of speed: what it measures with, seen to tell slower from equal."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mitsuba_whitted import LIBLLVM
from whitted_validation.benchmark import povray, scenes, speed
from whitted_validation.benchmark.speed import Measured, Results, Row
from whitted_validation.benchmark.speed_configurations import BY_NAME, CONFIGURATIONS, Unavailable, _replace
from whitted_validation.benchmark.speed_memory import draw_large
from whitted_validation.benchmark.speed_native import with_native_materials
from whitted_validation.benchmark.speed_pairs import CONFIDENCE, Comparison, Interval, compare, interval
from whitted_validation.benchmark.speed_start import BARE, CACHE, timed
from whitted_validation.benchmark.speed_targets import outcomes
from whitted_validation.benchmark.speed_worker import Facts, Failed, Sample, Worker

needs_llvm = pytest.mark.skipif(bool(LIBLLVM.refusal), reason=str(LIBLLVM.refusal))


# ------------------------------------------------------------------------------------------- the statistics
@pytest.mark.parametrize("n", range(6, 40))
def test_an_interval_is_the_narrowest_that_holds_the_median_often_enough(n: int) -> None:
    found = interval([float(i) for i in range(n)])
    k = int(found.low)  # values below the interval

    def outside(k: int) -> float:
        return 2 * sum(math.comb(n, i) for i in range(k + 1)) / 2**n

    assert found.high == n - 1 - k
    assert outside(k) <= 1 - CONFIDENCE < outside(k + 1)


def test_five_numbers_are_too_few_for_an_interval() -> None:
    found = interval([3.0, 1.0, 2.0, 5.0, 4.0])
    assert (found.median, found.least, found.most) == (3, 1, 5)
    assert math.isnan(found.low)
    assert math.isnan(found.high)


class _Clockwork:
    """A worker that takes exactly so long, longer with every sample that anybody takes."""

    taken: list[str]

    def __init__(self, name: str, seconds: float, side: int, taken: list[str], drift: float = 0.0) -> None:
        self.name, self._seconds, self.taken, self._drift = name, seconds, taken, drift
        self.facts = Facts(side, (), 0, 0.0, 0.0, 0.0, Sample(seconds, seconds))

    def sample(self, _pictures: int) -> Sample:
        self.taken.append(self.name)
        seconds = self._seconds * (1 + self._drift * len(self.taken))
        return Sample(seconds, seconds)


def _compared(a: float, b: float, side: int = 64, drift: float = 0.0) -> tuple[Comparison, list[str]]:
    taken: list[str] = []
    first: Any = _Clockwork("a", a, 64, taken, drift)
    second: Any = _Clockwork("b", b, side, taken, drift)
    return compare(first, second, 8, 0.02), taken


def test_two_processes_draw_in_turn_and_each_goes_first_as_often() -> None:
    assert _compared(1.0, 1.0)[1] == ["a", "b", "b", "a"] * 4


def test_a_ratio_is_that_of_the_second_over_the_first_for_one_pixel() -> None:
    assert _compared(2.0, 3.0)[0].cpu.median == 1.5
    assert _compared(2.0, 3.0, side=32)[0].wall.median == 6.0


def test_a_machine_that_slows_down_steadily_makes_no_difference() -> None:
    # A sample is longer than the last by e <= 0.01 of it, so that the ratios are 1 + e and 1 / (1 + e), in turn; e
    # itself changes by no more than 2 e^2 from one pair to the next, and the mean of the middle two by half of that.
    found = _compared(1.0, 1.0, drift=0.01)[0].cpu
    assert abs(found.median - 1) < 2 * 0.01**2
    assert found.low < 1 < found.high


def test_a_sample_takes_so_long_that_a_tick_of_the_clock_is_a_small_share_of_it() -> None:
    pictures = _compared(0.003, 40.0)[0].pictures
    assert pictures == (math.ceil(0.01 / 0.02 / 0.003), 1)


# ------------------------------------------------------------------------------------------------ verdicts
def _results(ratio: Interval) -> Results:
    comparison = Comparison(ratio, ratio, Sample(1, 1), Sample(1, 1), (1, 1), 9)
    scene = Measured("", 64, rows=[Row("limit", "", comparison), Row("general", "", comparison)])
    return Results(scenes={"a": scene})


def _verdict(ratio: Interval, target: str) -> str:
    return next(o.verdict for o in outcomes(_results(ratio)) if target in o.target)


@pytest.mark.parametrize(
    ("low", "high", "verdict"), [(1.6, 2.0, "met"), (1.5, 2.0, "not met"), (math.nan, math.nan, "not measured")]
)
def test_a_target_is_met_only_with_the_whole_interval_on_its_good_side(low: float, high: float, verdict: str) -> None:
    # Of the bare rays over the plugin, 1 / 0.65 = 1.538.
    assert _verdict(Interval(1.8, low, high, 1.4, 2.1), "scene a: at most 0.65") == verdict


def test_a_plan_is_slower_only_if_every_pair_says_so() -> None:
    assert _verdict(Interval(0.9, 0.8, 0.95, 0.8, 0.99), "no scene slower") == "not met"
    assert _verdict(Interval(0.9, 0.8, 0.95, 0.8, 1.01), "no scene slower") == "met"


def test_a_random_scene_that_every_pair_finds_slower_is_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def row(ratio: float) -> Row:
        same = Interval(ratio, ratio, ratio, ratio, ratio)
        return Row("general", "", Comparison(same, same, Sample(1, 1), Sample(1, 1), (1, 1), 9))

    measured = iter([row(0.9), row(1.1), row(1.0), row(0.9), row(0.8)])
    monkeypatch.setattr(speed, "_random", lambda *_: next(measured))
    results, nothing = Results(), dataclasses.replace(speed.QUICK, names={}, random=3, sizes=(), starts={})
    for _ in speed.run(nothing, tmp_path, results, lambda _: None):
        pass
    found = [row.comparison.cpu.median for row in results.random.values() if row.comparison]
    assert found == [1.1, 1.0, 0.8]  # seed 0 and seed 2 twice, the last of which is slower indeed


def test_beside_a_target_stands_what_there_is_to_be_reached() -> None:
    results = _results(Interval(2, 2, 2, 2, 2))
    rows = results.scenes["a"].rows
    three = Interval(3, 3, 3, 3, 3)
    by_hand = Comparison(three, three, Sample(1, 1), Sample(1, 1), (1, 1), 9)
    rows += [Row("floor", "", by_hand), Row("povray", "", by_hand)]
    told = {outcome.target: outcome.measured for outcome in outcomes(results)}
    # The bare rays take 2, the kernel by hand and POV-Ray 3 of the plugin's time.
    assert told["scene a: at most 0.65 of the CPU time of the bare rays"] == "0.5 (0.5 to 0.5); by hand: 1.5"
    assert told["scene a: POV-Ray traces for at least 25 times the wall time"] == "3 (3 to 3); the bare rays: 1.5"


# ----------------------------------------------------------------------------------------------- processes
@needs_llvm
@pytest.mark.slow
def test_the_harness_tells_a_slower_configuration_from_an_equal_one(tmp_path: Path) -> None:
    # Two that are equal come out all on one side in one of 2^14 runs.
    file = scenes.write("d", tmp_path)
    with Worker("planned", file, 128) as planned:
        with Worker("same", file, 128) as same:
            equal = compare(planned, same, 15, 0.1).cpu
        with Worker("twice", file, 128) as twice:
            double = compare(planned, twice, 15, 0.1).cpu
    assert equal.least <= 1 <= equal.most
    assert double.low > 1


@needs_llvm
def test_a_scene_that_cannot_be_drawn_fails_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(Failed, match=r"missing\.xml") as failure:
        Worker("planned", tmp_path / "missing.xml", 64)
    assert "\n" not in str(failure.value)


def test_what_the_plugin_has_not_is_named() -> None:
    for module, path in (("film", "NO_SUCH"), ("no_such", "TILE"), ("surfaces", "Surfaces.no_such")):
        with pytest.raises(Unavailable, match=f"no {module}.{path}"):
            _replace(module, path, lambda old: old)()


@needs_llvm
def test_every_change_finds_what_it_changes(tmp_path: Path) -> None:
    # All at once, in a process of their own: the picture is nobody's, but none of them says that it is unavailable.
    file = scenes.write("b", tmp_path)
    changed = """
import sys
from pathlib import Path
import mitsuba_whitted
import mitsuba as mi
mi.set_variant("llvm_ad_rgb")
mi.set_log_level(mi.LogLevel.Error)
from whitted_validation.benchmark.speed_configurations import CONFIGURATIONS
changes = [change for configuration in CONFIGURATIONS for change in configuration.changes]
for change in changes:
    change()
scene = mi.load_file(sys.argv[1], optimize=False, size="16")
scene.integrator().render(scene)
print(len(changes))
"""
    done = subprocess.run([sys.executable, "-c", changed, str(file)], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert int(done.stdout) == sum(len(configuration.changes) for configuration in CONFIGURATIONS) > 20


@needs_llvm
@pytest.mark.slow
def test_what_is_put_back_leaves_every_byte_of_the_picture_as_it_was(tmp_path: Path) -> None:
    # Embree's search is other arithmetic: what stands in its place is judged by the verdicts of `whitted validate`.
    file = scenes.write("a", tmp_path)
    with Worker("planned", file, 32) as planned:
        picture = planned.ask("pixels")
    for configuration in CONFIGURATIONS:
        if configuration.family == "skip" and configuration.name not in ("embree", "hybrid"):
            with Worker(configuration.name, file, 32) as worker:
                assert np.array_equal(worker.ask("pixels"), picture), configuration.name


@needs_llvm
def test_compiled_kernels_go_to_the_private_cache(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    cache.mkdir()
    timed(["-c", BARE, str(with_native_materials(scenes.write("d", tmp_path)))], {CACHE: str(cache)})
    assert list(cache.iterdir())


def test_a_command_that_fails_is_no_sample() -> None:
    with pytest.raises(Failed, match="code 3"):
        timed(["-c", "raise SystemExit(3)"], {})


@needs_llvm
def test_a_process_that_takes_too_much_memory_is_stopped_and_leaves_no_file(tmp_path: Path) -> None:
    file = scenes.write("d", tmp_path)
    before = set(tmp_path.iterdir())
    assert not draw_large(file, tmp_path, 64, 1e6).stopped
    stopped = draw_large(file, tmp_path, 64, 1.0)
    assert stopped.stopped
    assert stopped.peak_mb > 2
    assert set(tmp_path.iterdir()) == before


@needs_llvm
def test_a_random_scene_is_drawn_alike_by_both_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "RANDOM_SIZE", 32)
    row = speed._random(0, dataclasses.replace(speed.QUICK, pairs=1, tick=1.0), tmp_path)
    assert row.note == ""
    assert row.off == 0
    assert row.facts is not None
    assert row.facts.side == 32


# --------------------------------------------------------------------------------------------- the bare rays
@pytest.mark.parametrize("kind", ["a", "b", "d", "e"])
def test_the_bare_rays_are_those_of_the_plugin_and_meet_the_same_shapes(
    kind: str, tmp_path: Path, llvm_ad_rgb: str
) -> None:
    import mitsuba as mi

    from whitted_validation.benchmark.limit import PATH_BITS, Limit

    side = 12
    file = scenes.write(kind, tmp_path)
    mi.set_log_level(mi.LogLevel.Error)
    scene = mi.load_file(str(file), optimize=False, size=str(side))
    numbers = {shape.id(): i for i, shape in enumerate(scene.shapes())}
    ours, asked = np.zeros((side, side, 3)), 0
    for y in range(side):
        for x in range(side):
            rays = scene.integrator().explain(scene, x, y).samples[0].rays
            path = 0
            for ray in rays:
                path = (31 * path + (numbers[ray.shape] + 1 if ray.shape else 0)) % 2**32
            lights = [light for ray in rays for light in ray.lights]
            ours[y, x] = path & PATH_BITS, sum(light.visible for light in lights), len(rays) - 1
            asked += sum(light.above for light in lights)
    limit = Limit(file, side)
    assert np.array_equal(np.array(limit.draw()), ours)
    assert limit.count_rays() == {"camera": side**2, "mirror": ours[..., 2].sum(), "shadow": asked}


@pytest.mark.parametrize("kind", ["a", "b"])
def test_the_floor_by_hand_draws_the_picture(kind: str, tmp_path: Path, llvm_ad_rgb: str) -> None:
    from whitted_validation.benchmark.floor import Floor
    from whitted_validation.benchmark.speed_configurations import load

    file = scenes.write(kind, tmp_path)
    scene, floor = load(file, 128), Floor(file, 128)  # which both must live until their kernels are done
    picture, by_hand = np.array(scene.integrator().render(scene)), np.array(floor.draw())
    off = np.abs(picture - by_hand).max(axis=2)
    # n.h is off by some 8 u, and taken to a power of up to 150. The constant offset, 2^-16 of a scene of ten that is
    # 128 pixels wide, moves an edge by 1/5000 of a pixel, and in a ball of a fiftieth of its distance by fifty times
    # that: one of a hundred pixels that an edge crosses comes to its other side, and edges cross a tenth of all.
    assert (off > 8 * 150 * 2.0**-24 * picture.max()).sum() <= off.size / 1000


def test_the_floor_refuses_what_it_was_not_written_for(tmp_path: Path, llvm_ad_rgb: str) -> None:
    from whitted_validation.benchmark.floor import Floor

    with pytest.raises(ValueError, match="no scene of balls on a floor"):
        Floor(scenes.write("e", tmp_path), 64)


def test_a_size_that_tiles_do_not_fill_is_refused(tmp_path: Path, llvm_ad_rgb: str) -> None:
    from whitted_validation.benchmark.limit import Limit

    with pytest.raises(ValueError, match="30 is no multiple of 4"):
        Limit(scenes.write("d", tmp_path), 30)


# ------------------------------------------------------------------------------------------------- the peers
def test_native_materials_keep_the_diffuse_term_and_the_mirrors(tmp_path: Path) -> None:
    file = scenes.write("a", tmp_path)
    ours, native = (list(ET.parse(f).getroot().iter("bsdf")) for f in (file, with_native_materials(file)))
    for one, other in zip(ours, native, strict=True):
        values = {e.get("name"): e.get("value") for e in one}
        mirror = float(values["mirror_reflectance"] or 0)
        assert other.get("type") == ("conductor" if mirror else "diffuse")
        if not mirror:
            k_d = [float(x) for x in str(values["diffuse_reflectance"]).split(",")]
            rho = [float(x) for x in str(other[0].get("value")).split(",")]
            # Six digits are written.
            assert all(abs(r - min(1, math.pi * k)) <= 0.5e-5 for r, k in zip(rho, k_d, strict=True))


# ----------------------------------------------------------------------------------------------- the command
@needs_llvm
@pytest.mark.slow
def test_the_quick_benchmark_writes_data_and_a_page(tmp_path: Path) -> None:
    ours = "from whitted_validation.cli import main; main()"
    arguments = ["benchmark", "speed", "--quick", "--report", str(tmp_path / "report")]
    done = subprocess.run([sys.executable, "-c", ours, *arguments], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    facts = json.loads((tmp_path / "report" / "results.json").read_text())
    assert facts["complete"] is True
    rows = {row["name"]: row for row in facts["scenes"]["a"]["rows"]}
    assert set(rows) == {"limit", "general", "same", "twice", "path", "povray"}
    if povray.version() is None:
        assert rows.pop("povray")["note"] == "POV-Ray is not installed"
    else:
        assert facts["scenes"]["a"]["povray"]["version"] == povray.version()
        assert rows["povray"]["off"] < 1e-3
    assert all(row["comparison"]["cpu"]["median"] > 0 for row in rows.values())
    assert all(BY_NAME[name].words in (tmp_path / "report" / "report.html").read_text() for name in ("same", "twice"))
    assert {target["verdict"] for target in facts["targets"]} <= {"met", "not met", "not measured"}
