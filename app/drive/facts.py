"""Facts of the drive process as ``DriveState.facts`` holds them."""

from __future__ import annotations

from collections.abc import Hashable

from app.contract.robots import (
    DriveFacts,
    DriveLoopFacts,
    GuardVerdict,
    RobotNow,
    SightNow,
    Velocity,
)
from app.contract.values import filled
from app.drive.driven_role import DrivenRole
from app.drive.roles import Roles
from observer.robots.contract import RobotPhase, RobotReport

_NOTHING = RobotReport(RobotPhase.CONNECTING)


def drive_facts(roles: Roles, now: float, loop: DriveLoopFacts) -> DriveFacts:
    """Return all facts at this instant."""
    sight, playing, going = roles.sight, roles.playing, roles.goals.going
    return DriveFacts(
        stopped=roles.stopped,
        sight=SightNow(None, None, None)
        if sight is None
        else SightNow(now - sight.received, sight.status.value, sight.world),
        loop=loop,
        programme=None if playing is None else playing.facts(now),
        goal=None if going is None else going.facts(now),
        robots={
            role: role_facts(driven, roles.leases.holder(role))
            for role, driven in roles.driven.items()
        },
    )


def role_facts(driven: DrivenRole, operator: str | None) -> RobotNow | None:
    """Return the facts of one role; None without a robot."""
    connection, state, verdict = driven.connection, driven.state, driven.verdict
    if connection is None or state is None:
        return None
    report = driven.report or _NOTHING
    if connection.trouble is not None:
        report = RobotReport(RobotPhase.REFUSED, trouble=connection.trouble)
    return RobotNow(
        port=connection.port,
        name=connection.name or report.name,
        world=connection.world,
        state=state,
        operator=operator,
        present=driven.consent.present,
        why=driven.hindrance,
        commanded=Velocity(*driven.asked),
        sent=Velocity(*driven.sent),
        guard=None if verdict is None else filled(GuardVerdict, verdict),
        report=report,
    )


def outline_of_facts(roles: Roles) -> Hashable:
    """Return a key that changes whenever anything but a figure has changed."""
    sight, playing, going = roles.sight, roles.playing, roles.goals.going
    return (
        roles.stopped,
        None if sight is None else (sight.status, sight.world),
        None if playing is None else (playing.started, playing.profile.name),
        None if going is None else (going.goal.number, going.over),
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
