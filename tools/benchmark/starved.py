"""Server with live cameras on a share of one core: how old the displayed data is."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from observer.evaluation.targets import Target
from tools.benchmark.processor_share import PERIOD_S, limited_processor
from tools.benchmark.served import DriveLateness, drive_lateness
from tools.benchmark.soak_lab import Lab, running_lab
from tools.benchmark.viewers import server_socket

_PICTURES = 60
_SETTLING_S = 12.0
_MOST_AGE_S = 0.25


@dataclass(frozen=True)
class StarvedFigures:
    """Measurements of a starved server.

    Attributes:
        share: of one core, in periods of ``PERIOD_S``. camera_rate, rate: frames per second that
            the cameras deliver, and that were observed. observations: their number.
        age_median_s, age_p95_s, age_max_s: from reception of a frame until it was sent to a page.
        reduced_to: the reduced processing at the end; None for full processing.
        restarts: of the engine.
    """

    share: float
    camera_rate: float
    rate: float
    observations: int
    age_median_s: float
    age_p95_s: float
    age_max_s: float
    reduced_to: str | None
    restarts: int
    drive: DriveLateness | None

    @property
    def targets(self) -> tuple[Target, ...]:
        """Return the targets."""
        age = "age of what is shown, p95, s"
        return (
            Target(age, None, _MOST_AGE_S, self.age_p95_s, self.observations),
            Target("restarts of the engine", None, 0, self.restarts, 1),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {"targets": [target.as_dict() for target in self.targets]} | asdict(self)


def starved_figures(share: float, seconds: float, say: Callable[[str], None]) -> StarvedFigures:
    """Measure a server with two network cameras and a robot on this share of one core.

    Raises:
        MeasurementError: the server did not start, or its processor cannot be limited.
    """
    say("starting a server with two network cameras")
    with running_lab(_PICTURES) as lab, limited_processor(lab.server.pid, share):
        say(f"{share:.0%} of one core, in periods of {1e3 * PERIOD_S:g} ms")
        ages = asyncio.run(_ages(lab, seconds))
        status = lab.server.request("GET", "/api/status")
        median, p95 = np.percentile(ages, [50, 95]).tolist()
        return StarvedFigures(
            share=share,
            camera_rate=status["source"]["frame_rate"],
            rate=len(ages) / seconds,
            observations=len(ages),
            age_median_s=median,
            age_p95_s=p95,
            age_max_s=max(ages),
            reduced_to=status["live"]["reduced_to"],
            restarts=status["engine"]["restarts"],
            drive=drive_lateness(lab.server),
        )


async def _ages(lab: Lab, seconds: float) -> list[float]:
    """Return the age in seconds of every observation, once the server has settled."""
    ages = []
    begin = time.monotonic() + _SETTLING_S
    async with server_socket(lab.server, "/api/live") as socket:
        async for text in socket:
            now = time.monotonic()
            if now > begin + seconds:
                break
            message = json.loads(text)
            if message["type"] != "observation":
                continue
            await socket.send(json.dumps({"type": "painted", "sequence": message["sequence"]}))
            if now > begin:
                ages.append(message["age_ms"] / 1e3)
    return ages
