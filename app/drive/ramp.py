"""Limits on a velocity: what is permitted, and its rise; it may fall at any rate."""

from __future__ import annotations

from app.drive.consent import Velocity


def least(wanted: Velocity, permitted: Velocity) -> Velocity:
    """Limit a velocity to the permitted one: never faster, never the other way."""
    return _within(wanted[0], permitted[0]), _within(wanted[1], permitted[1])


def _within(wanted: float, permitted: float) -> float:
    # This also covers values that are not numbers.
    if not wanted * permitted > 0.0:
        return 0.0
    return permitted if abs(permitted) < abs(wanted) else wanted


def ramped(
    before: Velocity, wanted: Velocity, acceleration: float, turn_acceleration: float, dt: float
) -> Velocity:
    """Return the next velocity on the way to the wanted one.

    Each component rises by at most its acceleration and never exceeds the wanted value. A robot
    stays on the wanted arc while it speeds up, unless it would have to brake for that: then it
    turns into the arc as quickly as permitted.

    Args:
        before: the velocity sent last, m/s and rad/s.
        wanted: the velocity to be reached.
        acceleration, turn_acceleration: m/s^2 and rad/s^2, positive.
        dt: seconds since ``before`` was sent.
    """
    speed = _risen(before[0], wanted[0], acceleration, dt)
    turn = _risen(before[1], wanted[1], turn_acceleration, dt)
    if wanted[0] == 0.0 or wanted[1] == 0.0:
        return speed, turn
    share = min(speed / wanted[0], turn / wanted[1])
    brakes = share * abs(wanted[0]) < min(abs(before[0]), abs(wanted[0]))
    return (speed, turn) if brakes else (share * wanted[0], share * wanted[1])


def _risen(before: float, wanted: float, acceleration: float, dt: float) -> float:
    """Return a value with the wanted sign, or zero: a reversal stops first."""
    if wanted == 0.0:
        return 0.0
    same_way = before * wanted > 0
    reached = (abs(before) if same_way else 0.0) + acceleration * max(dt, 0.0)
    return min(abs(wanted), reached) * (1.0 if wanted > 0 else -1.0)
