"""Recurring job of the alignment worker."""

from __future__ import annotations

import time
from collections.abc import Iterable

from app.workers.alignment.messages import Choices, Solve, Solved
from observer.truth.alignment.choices import AlignmentChoices, BodyRole
from observer.truth.alignment.online import OnlineAlignment

# Seconds: the clocks are related by arrival times, so only delays remain to be searched.
_SEARCH_S = (-1.0, 1.0)


class Aligner:
    """Aligner that keeps and aligns the data of the last minutes."""

    def __init__(self) -> None:
        self._online = OnlineAlignment()

    def solve(self, job: Solve) -> Solved:
        """Add the new data, and align if an alignment is due."""
        began = time.perf_counter()
        online = self._online
        if job.anew:
            online.begin_anew()
        for line in job.lines:
            online.add_observation(line)
        online.add_pieces(job.samples)
        online.choices = _choices(job.choices, online.bodies)
        online.solve(job.clocks.to_source)
        return Solved(online.state, time.perf_counter() - began)


def _choices(given: Choices, bodies: Iterable[str]) -> AlignmentChoices:
    # An ignored body need not be present.
    roles: dict[str, BodyRole] = dict.fromkeys(set(given.ignore) & set(bodies), "ignored")
    if given.observer is not None:
        roles[given.observer] = "observer"
    return AlignmentChoices(
        roles=roles, search=_SEARCH_S, mount=given.mount, T_body_base=given.T_body_base
    )
