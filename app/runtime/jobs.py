"""Jobs on the worker's side: jobs from stdin, progress and results to stdout."""

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
    """Progress of a job: in words, and as a fraction of the whole."""

    words: str
    share: float


@dataclass(frozen=True)
class Refused:
    """Refusal of a job that could not be done; one sentence says why and what would help."""

    reason: str


# Takes words and the completed fraction.
Report = Callable[[str, float], None]
Do = Callable[[Any, Report], object]


def do_jobs(do: Do) -> None:
    """Run jobs until there are no more, or until the process that sends them is gone."""
    # Only this descriptor carries messages: a library's printed output must not mix with them.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)

    def send(message: object) -> None:
        out.write(encode(message))
        out.flush()

    while (job := load_message(sys.stdin.buffer)) is not None:
        answer(do, job, send)


def answer(do: Do, job: Any, send: Callable[[object], None]) -> None:
    """Run one job; the last message is its result or ``Refused``, those before are ``Progress``."""
    try:
        send(do(job, lambda words, share: send(Progress(words, share))))
    except DynamicObserverError as error:
        send(Refused(str(error)))
