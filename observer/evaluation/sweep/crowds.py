"""Crowds as sources of a sweep: the robot drives through them to a goal."""

from __future__ import annotations

import math
import re
import statistics
from dataclasses import dataclass
from typing import Final

from observer.errors import InputError
from observer.evaluation.choices import CROWD, DEFAULT_RUNS
from observer.evaluation.navigation.contacts import summed
from observer.evaluation.navigation.crowd import crowd_missing
from observer.evaluation.navigation.run import Case, free_time_s, run
from observer.guard.parameters import GuardParameters
from observer.navigation.parameters import AllParameters

_SPEC: Final = re.compile(CROWD + r"(kind|hard):(\d*\.?\d+)", re.ASCII)
# Seeds of ``navigate-benchmark`` start far above, so that it judges a sweep's result by other runs.
_FIRST_SEED: Final = 1
_MOST_RUNS: Final = 900
_DENSEST: Final = 1.0


@dataclass(frozen=True)
class SweepCrowd:
    """Crowds of one kind.

    Attributes:
        name: as given. density_per_m2: of the people. kind: True for people who avoid the robot.
            runs: number of runs, through crowds of different seeds.
    """

    name: str
    density_per_m2: float
    kind: bool
    runs: int

    @property
    def digest(self) -> str:
        """Return a name shared by equal crowds."""
        return f"crowd {self.kind} {self.density_per_m2!r}"

    @property
    def extent(self) -> str:
        """Return how much of it there is, in words."""
        return f"{self.runs} runs"


def sweep_crowd(spec: str, runs: int = DEFAULT_RUNS) -> SweepCrowd:
    """Parse ``crowd:hard:0.1`` or ``crowd:kind:0.1``, people per square metre.

    Raises:
        InputError: it is not a crowd, or the package that moves crowds is not installed.
    """
    found = _SPEC.fullmatch(spec)
    if found is None or float(found[2]) > _DENSEST:
        raise InputError(
            f"{spec[:80]} is not a crowd; give crowd:hard:DENSITY or crowd:kind:DENSITY with 0 to "
            f"{_DENSEST:g} people per m², for example crowd:hard:0.1"
        )
    if runs > _MOST_RUNS:
        raise InputError(f"a sweep makes at most {_MOST_RUNS} runs through each crowd")
    missing = crowd_missing()
    if missing is not None:
        raise InputError(missing)
    return SweepCrowd(spec, float(found[2]), found[1] == "kind", runs)


def driving_figures(crowd: SweepCrowd, parameters: AllParameters) -> dict[str, float | None]:
    """Drive through a crowd with the planner, once for each seed; return each ``DrivingFigure``.

    Returns:
        ``time_ratio``: median of the time to the goal as a multiple of the free time at the default
        speed, where a run that did not reach it counts as infinitely long; None if the median is
        infinite. ``contacts_per_m``: people touched while the robot moved, ``ahead_per_m``: those
        of them whom it drove into, per metre; None if nothing was driven. ``reached``: share of
        goals.
    """
    risk = parameters.navigation.risk_per_metre
    seeds = range(_FIRST_SEED, _FIRST_SEED + crowd.runs)
    cases = [Case("planner", crowd.density_per_m2, crowd.kind, risk, seed) for seed in seeds]
    done = [run(case, parameters) for case in cases]
    driven_m = sum(each.driven_m for each in done)
    time_s = statistics.median(each.time_s if each.reached else math.inf for each in done)
    contacts = summed([each.contacts for each in done])
    return {
        "time_ratio": None if math.isinf(time_s) else time_s / free_time_s(GuardParameters()),
        "contacts_per_m": contacts.moving / driven_m if driven_m > 0 else None,
        "ahead_per_m": contacts.ahead / driven_m if driven_m > 0 else None,
        "reached": statistics.fmean(each.reached for each in done),
    }
