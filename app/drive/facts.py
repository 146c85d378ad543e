"""The drive process as plain values, as ``DriveEvent.facts`` describes them."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

from app.drive.consent import Velocity
from app.drive.driven_role import DrivenRole
from app.drive.jitter import Lateness
from app.drive.roles import Roles
from observer.guard.guard import Verdict
from observer.robots.contract import RobotPhase, RobotReport

_NOTHING = RobotReport(RobotPhase.CONNECTING)


def drive_facts(
    roles: Roles, now: float, ticks: int, lateness: Lateness, priority: str
) -> dict[str, Any]:
    """Everything at this instant."""
    stopped, sight, playing = roles.stopped, roles.sight, roles.playing
    return {
        "stopped": None if stopped is None else {"by": stopped.by, "since": stopped.since},
        "sight": {
            "age_s": None if sight is None else now - sight.received,
            "status": None if sight is None else sight.status.value,
            "world": None if sight is None else sight.world,
        },
        "loop": {
            "ticks": ticks,
            "late_p99_ms": lateness.p99_ms,
            "late_max_ms": lateness.max_ms,
            "priority": priority,
        },
        "programme": None if playing is None else playing.facts(now),
        "robots": {
            role: role_facts(driven, roles.leases.holder(role))
            for role, driven in roles.driven.items()
        },
    }


def role_facts(driven: DrivenRole, operator: str | None) -> dict[str, Any] | None:
    """One role; None without a robot."""
    connection = driven.connection
    if connection is None:
        return None
    report = driven.report or _NOTHING
    if connection.trouble is not None:
        report = RobotReport(RobotPhase.REFUSED, trouble=connection.trouble)
    return {
        "port": connection.port,
        "name": connection.name or report.name,
        "world": connection.world,
        "state": driven.state,
        "operator": operator,
        "present": driven.consent.present,
        "why": driven.hindrance,
        "commanded": _velocity(driven.asked),
        "sent": _velocity(driven.sent),
        "guard": None if driven.verdict is None else _guard(driven.verdict),
        "report": _plain(report),
    }


def outline_of_facts(roles: Roles) -> Hashable:
    """What differs whenever anything but a figure has changed."""
    sight, playing = roles.sight, roles.playing
    return (
        roles.stopped,
        None if sight is None else (sight.status, sight.world),
        None if playing is None else (playing.started, playing.profile.name),
        tuple(_outline(driven, roles.leases.holder(role)) for role, driven in roles.driven.items()),
    )


def _outline(driven: DrivenRole, operator: str | None) -> Hashable:
    connection, report, verdict = driven.connection, driven.report, driven.verdict
    return (
        None if connection is None else (connection.port, connection.trouble),
        driven.state,
        operator,
        driven.consent.present,
        driven.hindrance is None,
        None if verdict is None else (verdict.level, verdict.blind),
        None
        if report is None
        else (
            report.phase,
            report.fault,
            report.trouble,
            len(report.warnings),
            report.motors_enabled,
            report.stop_pressed,
            report.stalled,
            report.front_bumpers,
            report.rear_bumpers,
            report.battery,
            report.charging,
        ),
    )


def _velocity(velocity: Velocity) -> dict[str, float]:
    return {"speed_mps": velocity[0], "turn_rate_radps": velocity[1]}


def _guard(verdict: Verdict) -> dict[str, Any]:
    return {
        "level": verdict.level,
        "reason": verdict.reason,
        "limit_mps": verdict.limit_mps,
        "stop_zone": [list(point) for point in verdict.stop_zone],
        "slow_zone": [list(point) for point in verdict.slow_zone],
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, tuple | list):
        return [_plain(item) for item in value]
    return dict(value) if hasattr(value, "items") else value
