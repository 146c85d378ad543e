"""Contacts of a robot with people, by whether it moved and whether they could have been seen.

A contact begins when a body reaches into the robot's outline, and ends when it no longer does. It
counts once: as one of a *moving* robot if the robot drives or turns at any moment of it, so also if
it starts against somebody who had walked into it, and otherwise as one of a *standing* robot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from observer.evaluation.navigation.crowd import People
from observer.evaluation.navigation.robot import Robot


@dataclass(frozen=True)
class Contacts:
    """Number of people touched.

    Attributes:
        moving: while the robot moved. ahead: those of them whom it drove into. avoidable: those of
            them who could have been seen a second before.
        standing: while the robot stood. standing_seen: those of them who could have been seen a
            second before.
    """

    moving: int = 0
    ahead: int = 0
    avoidable: int = 0
    standing: int = 0
    standing_seen: int = 0


def summed(contacts: Sequence[Contacts]) -> Contacts:
    """Return the contacts of several runs together."""
    return Contacts(
        moving=sum(each.moving for each in contacts),
        ahead=sum(each.ahead for each in contacts),
        avoidable=sum(each.avoidable for each in contacts),
        standing=sum(each.standing for each in contacts),
        standing_seen=sum(each.standing_seen for each in contacts),
    )


class ContactCounter:
    """Counts the contacts of a run, step by step."""

    def __init__(self) -> None:
        self._moving = self._ahead = self._avoidable = 0
        self._standing = self._standing_seen = 0
        self._touching: frozenset[int] = frozenset()
        # Contacts that have been those of a standing robot so far: number, and whether the person
        # could have been seen a second before.
        self._pending: dict[int, bool] = {}

    def touch(self, robot: Robot, people: People, seen_before: frozenset[int]) -> None:
        """Take in a step.

        Args:
            people: now. seen_before: numbers of those who could be seen a second before.
        """
        touched = robot.touched(people)
        new = touched - self._touching
        self._touching = touched
        for number in [each for each in self._pending if each not in touched]:
            self._end(self._pending.pop(number))
        self._pending |= {number: number in seen_before for number in new}
        if robot.is_moving:
            moving = frozenset(self._pending)
            self._pending.clear()
            self._moving += len(moving)
            self._ahead += len(moving & robot.drives_up_to(people))
            self._avoidable += len(moving & seen_before)

    def _end(self, seen: bool) -> None:
        self._standing += 1
        self._standing_seen += seen

    def result(self) -> Contacts:
        """Return the counts so far, those of contacts that still last included."""
        return Contacts(
            self._moving,
            self._ahead,
            self._avoidable,
            self._standing + len(self._pending),
            self._standing_seen + sum(self._pending.values()),
        )
