"""Sending the observer to a goal through a running server, and staying present on its way."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from app.client.operator_socket import OperatorSocket
from app.client.server_api import APPEARS_WITHIN_S, POLL_S, DrivingFailed, ServerApi
from app.client.travelled import Travelled
from app.contract.values import JsonObject
from observer.errors import DynamicObserverError
from observer.rig.rig import Role

_ROLE: Final[Role] = "observer"


@dataclass(frozen=True)
class GoalRequest:
    """Request to drive to a goal.

    Attributes:
        ahead_m, left_m: from the robot as it stands.
        risk_per_metre: accepted probability of a contact on each metre; None for the server's
            default.
        takeover: take control from whoever has it.
    """

    ahead_m: float
    left_m: float
    risk_per_metre: float | None
    takeover: bool


# Called with the server's facts of ``goal`` during the drive.
Watch = Callable[[JsonObject], None]


class GoalDrive:
    """One drive to a goal and its outcome."""

    def __init__(self, api: ServerApi, request: GoalRequest, watch: Watch) -> None:
        self._api = api
        self._request = request
        self._watch = watch
        self._travelled = Travelled()
        self._goal: JsonObject = {}

    def run(self) -> None:
        """Drive until the goal is reached.

        However the drive ends, the robot is disarmed, or left to stop.

        Raises:
            InputError, DrivingFailed: the drive did not begin or the goal was not reached; one
                sentence says why.
        """
        with OperatorSocket(self._api) as socket:
            try:
                lease = socket.take(_ROLE, takeover=self._request.takeover)
                self._api.post("robots", _ROLE, "arm", body={"lease": lease})
                before = self._api.get("robots")["goal"]
                self._start(lease)
                self._follow(socket, before)
            finally:
                # The quickest way first: releasing the lease stops and disarms.
                if socket.release():
                    with contextlib.suppress(DynamicObserverError):
                        self._api.post("robots", _ROLE, "disarm")

    def summary(self) -> JsonObject:
        """Return how far the robot has come; ready for JSON."""
        return {
            "ahead_m": self._request.ahead_m,
            "left_m": self._request.left_m,
            "risk_per_metre": self._goal.get("risk_per_metre", self._request.risk_per_metre),
            "elapsed_s": self._goal.get("elapsed_s"),
            "distance_m": self._goal.get("distance_m"),
            "robot": self._travelled.summary(),
        }

    def _start(self, lease: str) -> None:
        request = self._request
        body = {"ahead_m": request.ahead_m, "left_m": request.left_m, "lease": lease}
        if request.risk_per_metre is not None:
            body["risk_per_metre"] = request.risk_per_metre
        self._goal = self._api.post("goal", body=body)

    def _follow(self, socket: OperatorSocket, before: JsonObject | None) -> None:
        """Follow the drive to its end.

        Args:
            before: the goal of the facts before this one was requested.
        """
        began, seen = time.monotonic(), False
        while True:
            socket.check()
            facts, now = self._api.get("robots"), time.monotonic()
            self._travelled.add(facts["robots"].get(_ROLE) or {}, now)
            goal = facts["goal"]
            seen = seen or _end_of(goal) != _end_of(before) or now - began > APPEARS_WITHIN_S
            if seen and self._is_reached(goal):
                return
            time.sleep(max(0.0, now + POLL_S - time.monotonic()))

    def _is_reached(self, goal: JsonObject | None) -> bool:
        """Return whether the goal is reached.

        Raises:
            DrivingFailed: it never will be.
        """
        if goal is None:
            raise DrivingFailed("the server no longer has the goal: the robot was reconnected")
        self._goal = goal
        self._watch(goal)
        if goal["state"] not in ("driving", "reached"):
            raise DrivingFailed(goal["sentence"].rstrip("."))
        return bool(goal["state"] == "reached")


def _end_of(goal: JsonObject | None) -> tuple[object, ...]:
    """Return what tells the end of one goal from that of another."""
    return () if goal is None else (goal["state"], goal["elapsed_s"])
