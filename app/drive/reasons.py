"""Reasons why a robot cannot be armed, does not move, or is slow: one sentence each."""

from __future__ import annotations

from app.drive.connection import Connection, Tick
from app.drive.consent import Velocity
from observer.guard.guard import sight_trouble
from observer.guard.parameters import GuardParameters
from observer.guard.sight import SIGHT_FRESH_S
from observer.rig.rig import Role
from observer.robots.contract import REPORT_FRESH_S, RobotPhase, RobotReport

# A smaller difference comes from rounding to whole mm/s and degrees/s, not from a limit.
_SAME_MPS, _SAME_RADPS = 0.0011, 0.018


def missing_to_arm(
    role: Role,
    connection: Connection | None,
    report: RobotReport | None,
    tick: Tick,
) -> str | None:
    """Return what is missing for switching the motors on; None where nothing is."""
    if tick.stopped is not None:
        return stopped_by(tick.stopped)
    if connection is None:
        return f"no robot is connected as the {role}; enter its port first"
    if connection.trouble is not None:
        return connection.trouble
    if report is None or report.phase is not RobotPhase.CONNECTED:
        return unconnected(role, report)
    if report.fault is not None:
        return f"the {role}'s robot has a fault: {report.fault}; reset it first"
    if report.stop_pressed:
        return f"the stop button on the {role}'s robot is pressed; release it first"
    if report.watchdog_s == 0.0:
        return (
            f"the watchdog of the {role}'s robot is switched off, so the robot would drive on if "
            "this computer failed; set it to 2000 ms with the manufacturer's configuration tool"
        )
    if role == "observer":
        return _unseeing(connection, tick)
    return None


def _unseeing(connection: Connection, tick: Tick) -> str | None:
    """Return why the observer cannot drive by its sight, and how to help a slow computer."""
    sight = tick.sight
    trouble = sight_trouble(sight, tick.now, connection.world)
    if trouble is None or sight is None or tick.now - sight.received <= SIGHT_FRESH_S:
        return trouble
    if sight.world != connection.world or sight.published - sight.received <= SIGHT_FRESH_S:
        return trouble
    return (
        f"{trouble}; this computer is too slow to process one every {1e3 * SIGHT_FRESH_S:.0f} ms, "
        "so close other programs or lower the image rate"
    )


def why_not_armed(
    role: Role,
    connection: Connection | None,
    report: RobotReport | None,
    why_disarmed: str | None,
) -> str:
    """Return the reason why a role is not armed."""
    if connection is None:
        return f"no robot is connected as the {role}"
    if connection.trouble is not None:
        return connection.trouble
    if report is None or report.phase is not RobotPhase.CONNECTED:
        return unconnected(role, report)
    if report.fault is not None:
        return report.fault
    if why_disarmed is not None:
        return f"disarmed: {why_disarmed}"
    return f"the {role} is not armed"


def why_less(
    role: Role,
    *,
    wanted: Velocity,
    permitted: Velocity,
    target: Velocity,
    sent: Velocity,
    guard: str | None,
    report: RobotReport,
    parameters: GuardParameters,
) -> str | None:
    """Return the reason why less was sent than wanted; None where it was not less.

    Args:
        permitted, target: the wanted velocity after the guard, and after the ramp.
        guard: the guard's reason.
    """
    if same(wanted, sent):
        return None
    if not same(target, sent):
        if report.motors_enabled is False:
            return f"the motors of the {role}'s robot are not on yet"
        return f"the {role}'s robot cannot go faster"
    if not same(permitted, target):
        return "it is still accelerating"
    return guard or (
        f"the maximum speed is set to {parameters.speed_max_mps:g} m/s and "
        f"{parameters.turn_rate_max_radps:g} rad/s"
    )


def stopped_by(by: str) -> str:
    """Return the sentence for a latched stop."""
    return f"all robots were stopped by {by}; reset the stop first"


def unconnected(role: Role, report: RobotReport | None) -> str:
    """Return the sentence for a robot that is not connected (any more)."""
    trouble = None if report is None else report.fault or report.trouble
    return f"the {role}'s robot is not connected" + (f": {trouble}" if trouble else "")


def silence(role: Role, report: RobotReport, now: float) -> str | None:
    """Return the sentence for a connected robot whose newest report is too old to move by.

    Args:
        now: the host's monotonic clock, at the end of the time for which the report must hold.
    """
    received = report.received
    if received is not None and now - received <= REPORT_FRESH_S:
        return None
    return f"the {role}'s robot has not reported its state for {1e3 * REPORT_FRESH_S:.0f} ms"


def same(one: Velocity, other: Velocity) -> bool:
    """Return true if two velocities differ by no more than a port's rounding."""
    return abs(one[0] - other[0]) <= _SAME_MPS and abs(one[1] - other[1]) <= _SAME_RADPS
