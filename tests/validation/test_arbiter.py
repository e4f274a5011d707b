"""Intervals and forty digits have the last word where doubles or the bounds around them do not suffice."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

import whitted_reference
from whitted_reference import Scene, Tracer
from whitted_reference.arithmetic import DECIMAL, INTERVAL
from whitted_reference.proof import TARGET, Prover
from whitted_validation import bounds, scene_files, verdict
from whitted_validation.bounds import Cause, Means
from whitted_validation.roundoffs import U
from whitted_validation.validation import Here
from whitted_validation.verdict import Status, judge

SIZE = 32


@pytest.fixture
def small() -> Callable[[str], Scene]:
    """Load a shipped scene at a small size, and drop tracers made with a fault."""
    bounds._tools.cache_clear()
    verdict._witnesses.cache_clear()
    return lambda name: whitted_reference.image.resized(whitted_reference.load(scene_files.find(name)), SIZE, SIZE)


def test_intervals_settle_what_they_can_and_forty_digits_the_rest(small: Callable[[str], Scene]) -> None:
    scene = small("whitted_1980")
    prover = Prover(scene)
    by_intervals = prover.settle(16, 16)
    assert by_intervals.means == INTERVAL.name
    assert max(by_intervals.off) <= TARGET * max(1.0, *by_intervals.colour)
    by_digits = prover.settle(16, 16, enough=0.0)
    assert by_digits.means == DECIMAL.name
    assert np.all(np.abs(np.subtract(by_digits.colour, by_intervals.colour)) <= np.add(by_intervals.off, by_digits.off))


def test_every_pixel_has_someone_who_vouches_for_it(
    small: Callable[[str], Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gold mirrors in gold: asked for more digits, some bounds are loose, and the colour is not left to doubles."""
    monkeypatch.setattr(bounds, "LEAST_FAULT", 1e-6)
    known = bounds.measure(small("gold"), Here())
    doubtful = known.loose | known.chaotic
    assert doubtful.any()
    assert ((known.means >= Means.INTERVAL) == doubtful).all()
    assert ((known.cause != Cause.NONE) == doubtful).all()
    assert (known.cause[doubtful] == Cause.MIRRORS).any()


def test_a_colour_that_doubles_got_wrong_is_corrected(
    small: Callable[[str], Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Let floats lose a thousandth of the highlights: where bounds are loose, the colour is right all the same."""
    monkeypatch.setattr(bounds, "LEAST_FAULT", 1e-6)
    scene = small("gold")
    right = bounds.measure(scene, Here())
    doubtful = right.loose | right.chaotic
    old = Tracer.highlight

    def highlight(self, *args):  # type: ignore[no-untyped-def]
        return old(self, *args) * (1.001 if self.arithmetic.spread is None and self.arithmetic is not DECIMAL else 1)

    monkeypatch.setattr(Tracer, "highlight", highlight)
    bounds._tools.cache_clear()
    wrong = bounds.measure(scene, Here())
    same = (wrong.colour == right.colour).all(axis=2)
    assert same[doubtful & (wrong.means >= Means.INTERVAL)].all()
    assert not same.all()


def test_a_fault_of_doubles_is_not_laid_at_the_picture_s_door(
    small: Callable[[str], Scene], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = small("lambert")
    known = bounds.measure(scene, Here())
    picture = known.colour.copy()
    known.colour[5, 6] += 0.25  # as if a double had gone astray
    judgement = judge(scene, known, picture, Here())
    assert judgement.good
    (difference,) = judgement.differences
    assert (difference.status, difference.settled_by) == (Status.EXPLAINED, INTERVAL.name)
    picture[9, 3] += 2.0 * known.bound[9, 3] + U
    judgement = judge(scene, known, picture, Here())
    assert [(d.x, d.y, d.status) for d in judgement.differences if d.status == Status.UNEXPLAINED] == [
        (3, 9, Status.UNEXPLAINED)
    ]
    monkeypatch.setattr(verdict, "MOST_SETTLED", 0)
    assert judge(scene, known, picture, Here()).count(Status.UNEXPLAINED) == 2
