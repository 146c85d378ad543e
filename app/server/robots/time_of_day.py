"""Wall clock for the records of driving."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta


def time_of_day(ago_s: float = 0.0) -> str:
    """Return the time of day ``ago_s`` ago, not in the future: ISO 8601, UTC, with milliseconds."""
    moment = datetime.now(UTC) - timedelta(seconds=max(0.0, ago_s))
    return moment.isoformat(timespec="milliseconds")
