"""A computer too slow for its cameras does less work per frame, and more again once it can."""

from __future__ import annotations

import pytest

from app.engine.rate_governor import RateGovernor
from observer.parameters.reductions import REDUCTIONS, Reduction

PERIOD_S = 1 / 15


class Loop:
    """A loop over a camera's frames: it takes the newest one, or waits for the next."""

    def __init__(self, full_s: float, model: str = "rigid") -> None:
        self.full_s = full_s
        self.model = model
        self.now = 100.0
        self.governor = RateGovernor()
        self.changes = 0

    @property
    def reduction(self) -> Reduction | None:
        return self.governor.reduction(self.model)

    def work_s(self) -> float:
        return self.full_s * (1.0 if self.reduction is None else self.reduction.time_share)

    def run(self, seconds: float) -> None:
        until = self.now + seconds
        while self.now < until:
            began, self.now = self.now, self.now + self.work_s()
            self.changes += self.governor.spent(began, self.now, self.model)
            waiting = PERIOD_S - (self.now - began)
            self.now += max(0.0, waiting)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_nothing_is_reduced_while_frames_are_in_time(share: float) -> None:
    loop = Loop(share * PERIOD_S)
    loop.run(60)
    assert loop.reduction is None
    assert loop.changes == 0


@pytest.mark.parametrize(("share", "level"), [(1.02, 1), (1.2, 2), (5.0, 2)])
def test_the_smallest_sufficient_reduction_is_chosen(share: float, level: int) -> None:
    loop = Loop(share * PERIOD_S)
    loop.run(12)
    assert loop.reduction == REDUCTIONS[level - 1]
    changes = loop.changes
    loop.run(120)
    assert loop.reduction == REDUCTIONS[level - 1], "it does not swing to and fro"
    assert loop.changes == changes


def test_a_single_slow_frame_changes_nothing() -> None:
    loop = Loop(0.5 * PERIOD_S)
    loop.run(5)
    for _ in range(3):
        loop.full_s = 1.5
        loop.run(0.01)
        loop.full_s = 0.5 * PERIOD_S
        loop.run(5)
    assert loop.changes == 0


def test_processing_is_restored_step_by_step_once_the_load_is_gone() -> None:
    loop = Loop(3 * PERIOD_S)
    loop.run(15)
    assert loop.reduction == REDUCTIONS[-1]
    loop.full_s = 0.4 * PERIOD_S
    loop.run(4)
    assert loop.reduction == REDUCTIONS[-1], "a short pause restores nothing"
    loop.run(30)
    assert loop.reduction is None


def test_a_camera_that_slows_down_in_the_dark_causes_no_reduction() -> None:
    loop = Loop(1.5 * PERIOD_S)
    # Frames arrive only every third period.
    for _ in range(200):
        began, loop.now = loop.now, loop.now + loop.work_s()
        assert not loop.governor.spent(began, loop.now, loop.model)
        loop.now = began + 3 * PERIOD_S


def test_a_method_without_reductions_keeps_its_full_processing() -> None:
    loop = Loop(3 * PERIOD_S, "affine")
    loop.run(20)
    assert loop.reduction is None
    loop.model = "rigid"
    assert loop.reduction is None, "the time of another method tells nothing"
    loop.run(20)
    assert loop.reduction == REDUCTIONS[-1]
    loop.model = "homography"
    assert loop.reduction is None
