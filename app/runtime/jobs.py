"""The worker's side: jobs from stdin, progress and results to stdout."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from app.runtime.pipe import encode, load_message
from observer.errors import DynamicObserverError


@dataclass(frozen=True)
class Progress:
    """Progress of a job: in words, and as a share of all."""

    words: str
    share: float


@dataclass(frozen=True)
class Refused:
    """A job could not be done; one sentence says why and what would help."""

    reason: str


# Takes words and the share that is done.
Report = Callable[[str, float], None]
Do = Callable[[Any, Report], object]


def do_jobs(do: Do) -> None:
    """Do jobs until there are no more, which is also when whoever gives them is gone."""
    # Messages go out by this descriptor alone: what a library prints must not come between.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)

    def send(message: object) -> None:
        out.write(encode(message))
        out.flush()

    while (job := load_message(sys.stdin.buffer)) is not None:
        answer(do, job, send)


def answer(do: Do, job: Any, send: Callable[[object], None]) -> None:
    """Do one job; the last message is its result or ``Refused``, those before are ``Progress``."""
    try:
        send(do(job, lambda words, share: send(Progress(words, share))))
    except DynamicObserverError as error:
        send(Refused(str(error)))
