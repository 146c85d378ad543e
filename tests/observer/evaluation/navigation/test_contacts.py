"""Contacts of a robot at the origin with people at chosen places."""

from __future__ import annotations

import numpy as np
import pytest

from observer.evaluation.navigation.contacts import ContactCounter, Contacts, summed
from observer.evaluation.navigation.crowd import People
from observer.evaluation.navigation.robot import SPEC, Robot
from observer.guard.parameters import GuardParameters

FAR = 5.0
TOUCHING = SPEC.length_m / 2 + 0.1
NOBODY, SEEN = frozenset[int](), frozenset({0})


def person(ahead: float) -> People:
    return People(np.arange(1), np.array([[ahead, 0.0]]), np.zeros((1, 2)), np.array([0.25]))


def robot(speed_mps: float = 0.0, turn_rate_radps: float = 0.0) -> Robot:
    one = Robot((0.0, 0.0, 0.0), GuardParameters())
    one.speed_mps, one.turn_rate_radps = speed_mps, turn_rate_radps
    return one


def counted(*steps: tuple[Robot, float], seen: frozenset[int] = NOBODY) -> Contacts:
    counter = ContactCounter()
    for one, ahead in steps:
        counter.touch(one, person(ahead), seen)
    return counter.result()


@pytest.mark.parametrize("seen", [NOBODY, SEEN])
def test_contacts_are_separated_by_motion_and_by_whether_the_person_could_be_seen(
    seen: frozenset[int],
) -> None:
    drives, stands = robot(0.3), robot()
    avoidable = len(seen)
    ahead = counted((drives, FAR), (drives, TOUCHING), (drives, TOUCHING), seen=seen)
    assert ahead == Contacts(moving=1, ahead=1, avoidable=avoidable)
    behind = counted((drives, FAR), (drives, -TOUCHING), seen=seen)
    assert behind == Contacts(moving=1, avoidable=avoidable)
    standing = counted((stands, FAR), (stands, TOUCHING), (stands, FAR), seen=seen)
    assert standing == Contacts(standing=1, standing_seen=avoidable)


def test_turning_on_the_spot_is_moving() -> None:
    assert counted((robot(turn_rate_radps=0.5), TOUCHING)).moving == 1
    assert counted((robot(turn_rate_radps=0.01), TOUCHING)).standing == 1


def test_robot_that_starts_against_somebody_touches_him_while_moving() -> None:
    started = counted((robot(), TOUCHING), (robot(0.1), TOUCHING), (robot(), TOUCHING))
    assert started == Contacts(moving=1, ahead=1)
    left = counted((robot(), TOUCHING), (robot(0.1), FAR))
    assert left == Contacts(standing=1)


def test_lasting_contact_counts_once_and_a_second_one_again() -> None:
    stands = robot()
    once = counted((stands, TOUCHING), (stands, TOUCHING))
    assert once == Contacts(standing=1)
    twice = counted((stands, TOUCHING), (stands, FAR), (stands, TOUCHING))
    assert twice == Contacts(standing=2)
    assert summed([once, twice]) == Contacts(standing=3)
