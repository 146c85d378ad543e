"""Supervisor that keeps one drive process running, on behalf of the web process.

A new process has no robot: the supervisor's owner reconnects them, and only a person arms them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from app.contract.drive import (
    DriveLostEvent,
    DriveStartedEvent,
    DriveState,
    FromDrive,
    LeaveDrive,
    ToDrive,
)
from app.runtime.environment import module_command
from app.runtime.supervisor import ProcessSupervisor
from app.runtime.supervisor_limits import SupervisorLimits

DRIVE_COMMAND = module_command("app.drive")
# Events come every 0.1 s. A port's own thread sends zero much sooner than a hung loop is detected;
# a standby would have no robots, so it would be ready no sooner.
DRIVE_LIMITS = SupervisorLimits(
    hang_s=0.5,
    starved_s=2.0,
    start_s=20.0,
    standby_delay_s=None,
    most_backoff_s=5.0,
    stop_s=4.0,
    answer_s=1.0,
)


class DriveSupervisor(ProcessSupervisor[ToDrive[Any], FromDrive]):
    """Drive supervisor that implements ``app.server.contracts.Drive``.

    All methods belong to the event loop's thread.
    """

    what = "drive process"
    farewell = LeaveDrive()
    heartbeat = state = DriveState
    started = DriveStartedEvent
    lost = DriveLostEvent

    def __init__(
        self,
        slots: Mapping[str, int],
        *,
        command: Sequence[str] = DRIVE_COMMAND,
        limits: SupervisorLimits = DRIVE_LIMITS,
    ) -> None:
        """Set up the supervisor.

        Args:
            slots: ``EngineSupervisor.shared_slots``; their owner keeps them open until
                this is stopped.
            command: starts a drive process; its arguments are appended.
        """
        super().__init__(command, slots, limits)
