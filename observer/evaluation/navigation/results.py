"""Results of the navigation benchmark: runs summarised by setting."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from scipy.special import gammaincinv

from observer.evaluation.navigation.contacts import Contacts, summed
from observer.evaluation.navigation.coverage import AHEAD_S, WalkResult
from observer.evaluation.navigation.oracle import Answer, Question
from observer.evaluation.navigation.perception_check import PerceptionFigures, perception_figures
from observer.evaluation.navigation.run import Driver, RunResult, Sees
from observer.navigation.calibration import coverage
from observer.parameters import ParameterValue


@dataclass(frozen=True)
class Setting:
    """Settings shared by a group of runs.

    Attributes:
        risk_per_metre: declared; None for the driver ``guard``, which declares none.
    """

    driver: Driver
    density_per_m2: float
    kind: bool
    risk_per_metre: float | None
    sees: Sees


@dataclass(frozen=True)
class Summary:
    """Runs of one setting.

    Attributes:
        reached: how many reached the goal within three times the free time.
        time_ratio: median of the time to the goal as a multiple of the free time, where a run that
            did not reach it counts as infinitely long; None if the median is infinite.
        oracle_ratio: the same as a multiple of the oracle's time; None also for people who avoid
            the robot, whose future depends on it.
        driven_m: driven by all.
        contacts: people touched by all.
        stops: number of stops by the guard, by reason. stopped_s, waited_s: time for which the
            guard, and the driver, kept the robot standing.
        perception: check of the perception against the true places of people.
    """

    setting: Setting
    runs: int
    reached: int
    time_ratio: float | None
    oracle_ratio: float | None
    driven_m: float
    contacts: Contacts
    stops: dict[str, int]
    stopped_s: float
    waited_s: float
    total_s: float
    perception: PerceptionFigures | None

    @property
    def contacts_per_m(self) -> float | None:
        """Return contacts of the moving robot per metre; None if nothing was driven."""
        return self.contacts.moving / self.driven_m if self.driven_m > 0 else None

    @property
    def ahead_per_m(self) -> tuple[float, float, float] | None:
        """Return people driven into per metre, with 95 % interval; None if nothing was driven."""
        return rate(self.contacts.ahead, self.driven_m) if self.driven_m > 0 else None


@dataclass(frozen=True)
class Coverage:
    """Coverage of predictions.

    Attributes:
        seen: whether the people were seen in the frame of the prediction, or only remembered.
        share: of true places within the predicted 95 % region; None without predictions.
    """

    seen: bool
    ahead_s: float
    predictions: int
    share: float | None


@dataclass(frozen=True)
class NavigationBenchmark:
    """All results, and the coverage of the predictions on other walks of the same crowds.

    Attributes:
        changed: parameters of guard and planner that differ from their defaults.
    """

    first_seed: int
    summaries: tuple[Summary, ...]
    coverage: tuple[Coverage, ...]
    changed: Mapping[str, ParameterValue] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


def summarize(runs: Sequence[RunResult], answers: Sequence[Answer]) -> tuple[Summary, ...]:
    """Return a summary of each setting, in the order of first occurrence.

    Args:
        answers: of the oracle, at least for every crowd that ignores the robot.
    """
    best = {each.question: each.time_s for each in answers}
    groups: dict[Setting, list[RunResult]] = {}
    for run in runs:
        case = run.case
        risk = case.risk_per_metre if case.driver == "planner" else None
        setting = Setting(case.driver, case.density_per_m2, case.kind, risk, case.sees)
        groups.setdefault(setting, []).append(run)
    return tuple(_summary(setting, each, best) for setting, each in groups.items())


def _summary(
    setting: Setting, runs: Sequence[RunResult], best: Mapping[Question, float | None]
) -> Summary:
    stops: Counter[str] = Counter()
    for run in runs:
        stops.update(run.stops)
    return Summary(
        setting=setting,
        runs=len(runs),
        reached=sum(run.reached for run in runs),
        time_ratio=_ratio(runs, [run.free_s for run in runs]),
        oracle_ratio=None if setting.kind else _ratio(runs, [best[_question(r)] for r in runs]),
        driven_m=sum(run.driven_m for run in runs),
        contacts=summed([run.contacts for run in runs]),
        stops=dict(stops.most_common()),
        stopped_s=sum(run.stopped_s for run in runs),
        waited_s=sum(run.waited_s for run in runs),
        total_s=sum(run.time_s for run in runs),
        perception=perception_figures([run.perception for run in runs]),
    )


def _question(run: RunResult) -> Question:
    return Question(run.case.density_per_m2, run.case.seed)


def _ratio(runs: Sequence[RunResult], least_s: Sequence[float | None]) -> float | None:
    """Return the median ratio of the times to the least ones, without runs that have no least."""
    ratios = [
        run.time_s / least if run.reached else math.inf
        for run, least in zip(runs, least_s, strict=True)
        if least is not None
    ]
    if not ratios:
        return None
    # With an even number of runs the greater of the two middle ones: half of the runs achieve it.
    ratio = statistics.median_high(ratios)
    return None if math.isinf(ratio) else ratio


def coverages(walks: Sequence[WalkResult]) -> tuple[Coverage, ...]:
    """Return the coverage over all walks: of people seen and of those remembered, by horizon."""
    return tuple(
        Coverage(seen, ahead, len(ranked), coverage(ranked))
        for seen in (True, False)
        for k, ahead in enumerate(AHEAD_S)
        for ranked in [
            [rank for walk in walks for rank in (walk.seen if seen else walk.remembered)[k]]
        ]
    )


def rate(count: int, driven_m: float) -> tuple[float, float, float]:
    """Return events per metre and its 95 % interval.

    Exact interval of a Poisson process (Garwood, Fiducial limits for the Poisson distribution,
    Biometrika 28, 1936).
    """
    low = float(gammaincinv(count, 0.025)) if count else 0.0
    high = float(gammaincinv(count + 1, 0.975))
    return count / driven_m, low / driven_m, high / driven_m
