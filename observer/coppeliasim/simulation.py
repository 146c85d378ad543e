"""Starts, steps and stops a simulation.

In stepping mode the simulator waits for us, so everything read between two steps belongs to one
instant. It forgets silent clients, so a thread keeps the connection alive while nothing is read.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable

from observer.coppeliasim.connection import (
    FORGOTTEN_AFTER_S,
    Connection,
    CoppeliaSimError,
    CoppeliaSimUnreachable,
)

# A client that died while stepping blocks the simulator until it is forgotten; wait longer.
STEP_WITHIN_S = FORGOTTEN_AFTER_S + 0.4
_STARTED_WITHIN_S = 2.0
_POLL_S = 0.01
_ALIVE_EVERY_S = FORGOTTEN_AFTER_S / 4


class Simulation:
    """Steps a simulator; used by one thread.

    Attributes:
        time_step_s: simulated seconds of one step.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._started = False
        self._stepping = False
        # Simulated time after our last step; None while it may have changed.
        self._stepped_to: float | None = None
        self._closing = threading.Event()
        self._keeper: threading.Thread | None = None
        self.time_step_s = connection.number("getSimulationTimeStep")
        if not self.time_step_s > 0:
            raise CoppeliaSimError(
                f"CoppeliaSim at {connection.address} has a time step of {self.time_step_s} s; set "
                "a positive time step"
            )

    @property
    def time(self) -> float:
        """The simulated time, seconds."""
        return self._connection.number("getSimulationTime")

    def start(self) -> None:
        """Hold the simulation still between steps, and start it if it is stopped."""
        connection = self._connection
        stopped = connection.constant("simulation_stopped")
        advancing = connection.constant("simulation_advancing")
        self._stepped_to = None
        self._wait_while_stopping()
        self._step_alone()
        state = connection.call("getSimulationState")
        if not state & advancing:
            self._started = state == stopped
            connection.call("startSimulation")
            self._await(lambda: bool(connection.call("getSimulationState") & advancing), "start")
        if self._keeper is None:
            self._keeper = threading.Thread(
                target=self._keep_alive, name="CoppeliaSim keep-alive", daemon=True
            )
            self._keeper.start()

    def step(self) -> float:
        """Make one step; return the simulated time after it, seconds.

        Raises:
            CoppeliaSimError: time does not advance, because the simulation was stopped or paused.
        """
        connection = self._connection
        before = self.time
        if self._stepped_to is not None and before > self._stepped_to:
            # The simulator forgot that we step it, and continued by itself.
            self.hold_again()
            before = self.time
        try:
            connection.call("step", within_s=STEP_WITHIN_S)
        except CoppeliaSimUnreachable as error:
            raise CoppeliaSimUnreachable(
                f"{error}, such as a second program that steps it"
            ) from None
        after = self.time
        if after > before:
            self._stepped_to = after
            return after
        raise CoppeliaSimError(
            f"the simulation at {connection.address} does not advance beyond {after:.3f} s, as if "
            "it had been stopped or paused; start it, or reopen the source"
        )

    def hold_again(self) -> None:
        """Make it stand still between steps again, after it forgot us."""
        self._stepping = False
        self._stepped_to = None
        self._step_alone()

    def restart(self) -> None:
        """Stop the simulation, which resets everything to its start."""
        connection = self._connection
        stopped = connection.constant("simulation_stopped")
        self._release()
        connection.call("stopSimulation")
        self._await(lambda: connection.call("getSimulationState") == stopped, "stop")

    def close(self) -> None:
        """Let it run freely, or stop it if it was started here; safe to call twice."""
        self._closing.set()
        if self._keeper is not None:
            self._keeper.join()
            self._keeper = None
        if self._connection.closed:
            return
        with contextlib.suppress(CoppeliaSimError):
            self._release()
            if self._started:
                self._connection.call("stopSimulation")
        self._started = False

    def _step_alone(self) -> None:
        # The simulator counts calls: stepping that is set twice must be released twice.
        if not self._stepping:
            self._connection.call("setStepping", True)
            self._stepping = True

    def _release(self) -> None:
        if self._stepping:
            self._stepping = False
            self._connection.call("setStepping", False)

    def _wait_while_stopping(self) -> None:
        connection = self._connection
        stopping = [
            connection.constant(f"simulation_advancing_{name}")
            for name in ("abouttostop", "lastbeforestop")
        ]
        self._await(lambda: connection.call("getSimulationState") not in stopping, "stop")

    def _await(self, done: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + _STARTED_WITHIN_S
        while not done():
            if time.monotonic() > deadline:
                raise CoppeliaSimError(
                    f"the simulation at {self._connection.address} did not {what} within "
                    f"{_STARTED_WITHIN_S:g} s; {what} it by hand and check its messages"
                )
            time.sleep(_POLL_S)

    def _keep_alive(self) -> None:
        while not self._closing.wait(_ALIVE_EVERY_S / 2):
            silent = time.monotonic() - self._connection.last_call
            if silent < _ALIVE_EVERY_S:
                continue
            try:
                self._connection.call("getSimulationTime")
            except CoppeliaSimUnreachable:
                # The next read reports it.
                return
            except CoppeliaSimError:
                continue
