"""Supervisor that keeps one drive process running, on behalf of the web process.

A new process has no robot: the supervisor's owner reconnects them, and only a person arms them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from app.contract.drive import (
    DriveLostEvent,
    DriveStartedEvent,
    DriveState,
    FromDrive,
    LeaveDrive,
    ToDrive,
)
from app.runtime.child import ChildProcess
from app.runtime.environment import module_command
from app.runtime.supervisor import ProcessSupervisor, SupervisorLimits

DRIVE_COMMAND = module_command("app.drive")
# Events come every 0.1 s. A port's own thread sends zero much sooner than a hung loop is detected;
# a standby would have no robots, so it would be ready no sooner.
DRIVE_LIMITS = SupervisorLimits(
    hang_s=0.5, start_s=20.0, standby_delay_s=None, most_backoff_s=5.0, stop_s=4.0
)


class DriveSupervisor(ProcessSupervisor[ToDrive[Any], FromDrive]):
    """Drive supervisor that implements ``app.server.contracts.Drive``.

    All methods belong to the event loop's thread.
    """

    what: ClassVar[str] = "drive process"
    heartbeat = DriveState
    kept = (DriveState,)

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

    async def request(self, command: ToDrive[Any], timeout_s: float = 1.0) -> Any:
        """Send a request to the drive process and return its reply's value.

        Raises:
            ProcessRefused: it refuses, and why.
            ProcessUnavailable: there is none, it ended meanwhile or did not answer in time.
        """
        return await super().request(command, timeout_s)

    def _farewell(self) -> ToDrive[Any]:
        return LeaveDrive()

    def _started_event(self, generation: int, pid: int) -> FromDrive:
        return DriveStartedEvent(generation, pid)

    def _lost_event(self, generation: int, reason: str) -> FromDrive:
        return DriveLostEvent(generation, reason)

    def _state(self, child: ChildProcess) -> FromDrive | None:
        return child.newest(DriveState)
