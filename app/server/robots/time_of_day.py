"""The wall clock, as the records of driving have it."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta


def time_of_day(ago_s: float = 0.0) -> str:
    """The time of day so long ago, not in the future: ISO 8601 in UTC with milliseconds."""
    moment = datetime.now(UTC) - timedelta(seconds=max(0.0, ago_s))
    return moment.isoformat(timespec="milliseconds")
