"""Thread that opens and closes the robots of one role."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Callable

from observer.errors import InputError
from observer.rig.rig import Role
from observer.robots.contract import Robot

_log = logging.getLogger(__name__)

OpenRobot = Callable[[str, str | None], Robot]


class RobotOpener:
    """Opener of one role's robots: opens and closes them one after the other, never blocking.

    Releasing a robot takes seconds, and opening one imports what its port needs. Requests are
    carried out in order; all methods return at once.
    """

    def __init__(self, role: Role, open_robot: OpenRobot) -> None:
        self._role = role
        self._open_robot = open_robot
        self._jobs: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._results: queue.SimpleQueue[tuple[int, Robot | str]] = queue.SimpleQueue()
        self._ticket = 0
        # Counts of requested and completed jobs; only one thread writes each.
        self._asked = 0
        self._done = 0
        self._thread: threading.Thread | None = None

    @property
    def busy(self) -> bool:
        """Return true while a requested job is not done yet."""
        return self._done < self._asked

    def open(self, port: str, model: str | None) -> None:
        """Open a robot; any earlier opening still pending is given up."""
        self._ticket += 1
        ticket = self._ticket
        self._do(lambda: self._results.put((ticket, self._opened(port, model))))

    def close(self, robot: Robot | None) -> None:
        """Release a robot, and any that is being opened."""
        self._ticket += 1
        if robot is not None:
            self._do(robot.close)

    def opened(self) -> Robot | str | None:
        """Return the requested robot, or one sentence on why there is none; returned only once."""
        try:
            ticket, result = self._results.get_nowait()
        except queue.Empty:
            return None
        if ticket == self._ticket:
            return result
        if not isinstance(result, str):
            self._do(result.close)
        return None

    def _opened(self, port: str, model: str | None) -> Robot | str:
        try:
            return self._open_robot(port, model)
        except InputError as error:
            return str(error)
        except Exception:  # noqa: BLE001
            _log.exception("the robot of the %s could not be opened", self._role)
            return f"connecting the {self._role}'s robot failed; see the log of the drive process"

    def _do(self, job: Callable[[], None]) -> None:
        self._asked += 1
        self._jobs.put(job)
        if self._thread is None:
            self._thread = threading.Thread(
                target=self._run, name=f"opener of the {self._role}", daemon=True
            )
            self._thread.start()

    def _run(self) -> None:
        while True:
            job = self._jobs.get()
            try:
                job()
            except Exception:  # noqa: BLE001
                # A fault in one job must not leave the next robot unopened.
                _log.exception("the robot of the %s could not be closed", self._role)
            self._done += 1
