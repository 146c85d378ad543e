"""The pause between attempts to run a process."""

from __future__ import annotations

import time

from app.runtime.attempts import Attempts
from app.runtime.supervisor_limits import SupervisorLimits


def test_the_pause_is_limited_after_any_number_of_failures() -> None:
    attempts = Attempts(SupervisorLimits())
    attempts.failed = 5000
    assert attempts.count_failure(time.monotonic()) == 10.0
    assert 9.0 < attempts.not_before - time.monotonic() <= 10.0
