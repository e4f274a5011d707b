"""What the measurement of error against cost is to cover: all of it, or a quick look."""

from __future__ import annotations

from dataclasses import dataclass

from whitted_validation.benchmark.error_checks import CHECKS
from whitted_validation.benchmark.error_drawing import PEERS


@dataclass(frozen=True)
class Schedule:
    """What is to be measured.

    Attributes
    ----------
    kinds : letters of the scenes
    draws : how many scenes of each kind; all but the first are drawn by our own ways only
    untimed : how many more, of which no times are taken: rays and errors take one picture where times take a dozen, and
        a median of few scenes is that of their draw
    size : of their pictures, in pixels
    grids : samples along the side of a pixel
    targets : target errors; close enough that a curve's chords, which lie above it, tell as much as those of the grids
    converged, converged_untimed : samples a pixel of the converged pictures, at most; the second of scenes without
        times
    refined : target error of the picture that they are checked against
    samplers, spp, peers_size : for Mitsuba's integrators, on scene a with one light
    epsilons : the textbook's constants, world units
    povray : modes of POV-Ray's antialiasing: method, threshold, depth
    exact_size : of the picture that the reference draws in double precision
    random, random_size : how many random scenes, (width, height)
    pairs, patience : of samples a point at most; fewer where they would take longer than so many seconds
    """

    kinds: str
    draws: int
    untimed: int
    size: int
    grids: tuple[int, ...]
    targets: tuple[float, ...]
    converged: int
    converged_untimed: int
    refined: float
    samplers: tuple[str, ...]
    spp: tuple[int, ...]
    peers_size: int
    epsilons: tuple[float, ...]
    povray: tuple[tuple[int, float, int], ...]
    exact_size: int
    random: int
    random_size: tuple[int, int]
    pairs: int
    patience: float

    def count(self) -> int:
        """Count the steps of `run`."""
        curves = len(self.grids) + 1 + len(self.targets)  # and one without a target
        with_others = curves + (len(CHECKS) + 1) * len(self.targets)  # and an oracle
        peers = curves + 1 + len(self.samplers) * len(PEERS) * len(self.spp)
        first = len(self.kinds) * (with_others + 2 + len(self.povray))
        more = len(self.kinds) * (self.draws - 1 + self.untimed) * (with_others + 1)
        return first + more + peers + 1 + self.random + 1


FULL = Schedule(
    kinds="abc",
    draws=3,
    untimed=6,
    size=512,
    grids=(1, 2, 3, 4, 6, 8, 12, 16),
    targets=(3e-2, 1.5e-2, 1e-2, 7e-3, 5e-3, 4e-3, 3e-3, 2e-3, 1.4e-3, 1e-3, 7e-4, 5e-4, 4e-4, 3e-4, 2e-4, 1e-4),
    converged=4181,
    converged_untimed=1597,
    refined=3e-5,
    samplers=("independent", "stratified", "multijitter"),
    spp=(1, 4, 16, 64, 256),
    peers_size=256,
    epsilons=tuple(10.0**-digits for digits in range(7, -1, -1)),
    povray=tuple(
        (method, threshold, depth)
        for method, depth in ((1, 3), (1, 5), (2, 3), (2, 4))
        for threshold in (0.3, 0.1, 0.03, 0.01)
    ),
    exact_size=96,
    random=32,
    random_size=(128, 96),
    pairs=7,
    patience=4.0,
)

QUICK = Schedule(
    kinds="a",
    draws=2,
    untimed=1,
    size=64,
    grids=(1, 2, 4),
    targets=(1e-2, 3e-3, 1e-3),
    converged=233,
    converged_untimed=144,
    refined=1e-3,
    samplers=("independent",),
    spp=(1, 4),
    peers_size=32,
    epsilons=(1e-6, 1e-1),
    povray=((2, 0.1, 3),),
    exact_size=16,
    random=2,
    random_size=(32, 24),
    pairs=1,
    patience=1.0,
)
