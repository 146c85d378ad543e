"""Supervisor of one engine process, with a second one on standby.

Starting an engine takes longer on a busy machine than the two seconds within which a lost one must
be replaced.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any

from app.contract.commands import Shutdown, ToEngine
from app.contract.drive import SHARED_NAMES
from app.contract.events import (
    EngineLostEvent,
    EngineStartedEvent,
    Event,
    HeartbeatEvent,
    StateEvent,
)
from app.contract.views import CLOUD_NAME, VIEW_NAMES
from app.runtime.child import ChildProcess
from app.runtime.environment import module_command
from app.runtime.latest import LatestReader, create_slot
from app.runtime.supervisor import ProcessSupervisor
from app.runtime.supervisor_limits import SupervisorLimits

ENGINE_COMMAND = module_command("app.engine")
# A JPEG 1280 pixels wide stays below 1 MB, 20000 points take 300 KB; memory is used only up to the
# size of the values written.
_SLOT_BYTES = 4 * 1024 * 1024
# A sight of 100 obstacles and 200 directions takes 40 KB, one second of two robots' wheels 5 KB.
_SHARED_SLOT_BYTES = 256 * 1024


class EngineSupervisor(ProcessSupervisor[ToEngine[Any], Event]):
    """Supervisor of the engine processes. Call all methods in the event loop's thread.

    ``views`` and ``cloud`` read the latest images and cloud of whichever engine writes them.
    ``shared_slots`` are the descriptors, by name, of the slots through which engine and drive
    process communicate directly, bypassing this process; they stay open until ``stop``.
    """

    what = "engine"
    farewell = Shutdown()
    heartbeat = HeartbeatEvent
    state = StateEvent
    started = EngineStartedEvent
    lost = EngineLostEvent

    def __init__(
        self,
        *,
        command: Sequence[str] = ENGINE_COMMAND,
        limits: SupervisorLimits | None = None,
    ) -> None:
        """Set up the supervisor.

        Args:
            command: command that starts an engine; its arguments are appended.
        """
        self._drawn = {name: create_slot(_SLOT_BYTES) for name in (*VIEW_NAMES, CLOUD_NAME)}
        self.shared_slots: Mapping[str, int] = {
            name: create_slot(_SHARED_SLOT_BYTES) for name in SHARED_NAMES
        }
        super().__init__(
            command, {**self._drawn, **self.shared_slots}, limits or SupervisorLimits()
        )
        readers = {name: LatestReader(fd) for name, fd in self._drawn.items()}
        self.cloud: LatestReader = readers.pop(CLOUD_NAME)
        self.views: Mapping[str, LatestReader] = readers

    def _dropped(self, child: ChildProcess | None) -> int:
        heartbeat = None if child is None else child.newest(HeartbeatEvent)
        return 0 if heartbeat is None else heartbeat.counters.get("observations_lost", 0)

    def _release(self) -> None:
        for reader in (self.cloud, *self.views.values()):
            reader.close()
        for fd in (*self._drawn.values(), *self.shared_slots.values()):
            os.close(fd)
