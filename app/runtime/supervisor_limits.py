"""Time limits of the supervision of a child process."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SupervisorLimits:
    """Time limits of the supervisor, seconds.

    Attributes:
        hang_s: a process silent for this long counts as hung. An engine sends a heartbeat every
            0.05 s and between the observer's stages; the rest of 2 s is left for replacing it.
        start_s: a starting process silent for this long counts as hung.
        starved_s: a process may get no CPU time on a busy machine for this long without counting
            as hung.
        tick_s: interval between checks for silence.
        standby_delay_s: delay from a process's start to the start of its standby; None for no
            standby: replacing then takes as long as a start.
        quick_death_s: a process that lived shorter than this counts as a failed attempt.
        backoff_s: pause before the third attempt in a row, doubled with each further one.
        most_backoff_s: the longest pause.
        attempts: number of failed attempts in a row after which ``start`` gives up.
        stop_s: time for a process to leave by itself.
        answer_s: time for a reply, unless the request sets its own.
        takeover_s: time that a repeatable request waits for the next process.
    """

    hang_s: float = 1.6
    start_s: float = 30.0
    starved_s: float = 10.0
    tick_s: float = 0.05
    standby_delay_s: float | None = 3.0
    quick_death_s: float = 5.0
    backoff_s: float = 0.5
    most_backoff_s: float = 10.0
    attempts: int = 3
    stop_s: float = 1.0
    answer_s: float = 10.0
    takeover_s: float = 15.0
