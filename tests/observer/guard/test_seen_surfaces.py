"""What was seen in the way stays in the way when it is too near to be seen."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import numpy as np
import pytest

from observer.guard.seen_ground import ScanView
from observer.guard.seen_surfaces import RememberedSurfaces
from observer.guard.side import Side
from observer.guard.sight import FreeScan, Sight
from observer.types import Status

from .closed_loop import AMIGO, BEARINGS, Lab, drive, steady

BLIND_M = 0.55
HERE = np.zeros(3)


class UnderBoard(Lab):
    """A lab with a wide board that hangs across the way: the floor and sonar are clear below it.

    Attributes:
        board_m: its x.
    """

    def __init__(self, board_m: float, x: float) -> None:
        super().__init__(x=x)
        self.board_m = board_m

    def sight(self, index: int, time: float, rng: random.Random) -> Sight:
        """Return the sight of a camera that measures the board only beyond ``BLIND_M``."""
        sight = super().sight(index, time, rng)
        assert sight.scan is not None
        return replace(sight, scan=board_at(self.board_m - self.x, sight.scan))


def board_at(ahead_m: float, free: FreeScan | None = None) -> FreeScan:
    """Return a scan that shows a board across the way, and otherwise free floor."""
    count = len(BEARINGS)
    free = free or FreeScan(
        tuple(BEARINGS.tolist()), (None,) * count, (0.3,) * count, (4.0,) * count
    )
    distance = ahead_m / np.cos(BEARINGS)
    shown = [float(d) if d > BLIND_M else None for d in distance]
    to = [end if d is None else min(end, d) for end, d in zip(free.known_to_m, shown, strict=True)]
    return replace(free, blocked_m=tuple(shown), known_to_m=tuple(to), blind_m=(BLIND_M,) * count)


def looked(*ahead_m: float) -> RememberedSurfaces:
    """Return what is remembered of a board that comes towards the standing robot."""
    surfaces = RememberedSurfaces()
    for each in ahead_m:
        surfaces.see(ScanView.of(board_at(each)), HERE)
    return surfaces


@pytest.mark.parametrize("speed", [0.15, 0.3, 0.5])
def test_the_robot_stops_before_a_hanging_board(speed: float) -> None:
    lab = UnderBoard(2.2, x=0.0)
    drive(lab, steady(speed), 14.0)
    gap = lab.board_m - lab.x - AMIGO.length_m / 2
    assert 0.02 < gap < 0.5
    assert any("obstruction ahead" in reason for reason in lab.reasons)
    # It comes too near to be seen; only then can backing off help.
    assert any("back off" in reason for reason in lab.reasons)


@pytest.mark.parametrize(("scans", "known"), [(1, False), (2, False), (3, True), (5, True)])
def test_only_what_is_seen_several_times_is_remembered(scans: int, known: bool) -> None:
    at = looked(*[0.7] * scans).at(np.array([[0.7, 0.0]]))
    assert at.tolist() == [known]


def test_it_is_where_it_was_seen() -> None:
    at = looked(0.7, 0.7, 0.7).at(np.array([[0.7, 0.1], [0.5, 0.0], [0.9, 0.0], [0.7, 1.0]]))
    assert at.tolist() == [True, False, False, False]


def test_what_is_seen_to_be_gone_is_forgotten() -> None:
    assert not looked(0.7, 0.7, 0.7, 2.0).at(np.array([[0.7, 0.0]])).any()


def test_what_is_farther_away_is_left_to_the_scans() -> None:
    assert not looked(1.5, 1.5, 1.5).at(np.array([[1.5, 0.0]])).any()


@pytest.mark.parametrize("turn", [-0.4, 0.0, 0.4])
def test_it_stays_in_place_while_the_robot_drives(turn: float) -> None:
    side = Side()
    side.permitted = (0.3, turn)
    now, step = 10.0, 0.05
    place = np.array([[0.75, 0.0]])
    side.advance(now, (0.0, 0.0))
    for frame in range(3):
        scan = board_at(0.75)
        side.see(Sight(frame, now, now, "w", Status.OK, (), True, (), scan))
        now += step
        side.advance(now, (0.0, 0.0))
    for _ in range(20):
        now += step
        side.advance(now, (None, None))
    yaw = turn * 20 * step
    chord = 0.3 * 20 * step * np.sinc(yaw / 2 / math.pi)
    gone = chord * np.array([math.cos(yaw / 2), math.sin(yaw / 2)])
    c, s = math.cos(yaw), math.sin(yaw)
    expected = (place - gone) @ np.array([[c, -s], [s, c]])
    assert side.surfaces.at(expected).all()
    assert not side.surfaces.at(expected + np.array([0.2, 0.0])).any()


def test_it_is_not_forgotten_when_the_loop_stalls() -> None:
    side = Side()
    for frame in range(3):
        side.advance(10 + 0.05 * frame, (0.0, 0.0))
        now = 10 + 0.05 * frame
        side.see(Sight(frame, now, now, "w", Status.OK, (), True, (), board_at(0.6)))
    side.advance(12.0, (0.0, 0.0))
    assert side.surfaces.at(np.array([[0.6, 0.0]])).all()
