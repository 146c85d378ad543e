"""Playing a programme through a running server: take leases, arm, start, stay present, disarm."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from app.client.operator_socket import OperatorSocket
from app.client.server_api import APPEARS_WITHIN_S, POLL_S, DrivingFailed, ServerApi
from app.client.travelled import Travelled
from app.contract.values import JsonObject
from observer.errors import DynamicObserverError
from observer.rig.rig import Role

_CLOSE_TO_END_S = 1.0
# The end of a programme may be reported together with stops of robots.
_NEWEST_INCIDENTS = 5


@dataclass(frozen=True)
class PlayRequest:
    """Request to play a programme.

    Attributes:
        name: name of the programme on the server. roles: roles it moves.
        duration_s: total duration.
        takeover: take the roles from their current holders.
    """

    name: str
    roles: Sequence[Role]
    duration_s: float
    repeat: int
    reverse: bool
    takeover: bool


# Called with the server's facts of ``programme`` and ``robots`` during the drive.
Watch = Callable[[JsonObject, JsonObject], None]


class ProfileDrive:
    """One playback of a programme and its outcome."""

    def __init__(self, api: ServerApi, request: PlayRequest, watch: Watch) -> None:
        self._api = api
        self._request = request
        self._watch = watch
        self._travelled = {role: Travelled() for role in request.roles}
        self._elapsed_s = 0.0

    def run(self) -> None:
        """Drive the programme to its end.

        However the drive ends, the robots that it took are disarmed, or left to stop.

        Raises:
            InputError, DrivingFailed: the drive did not begin or did not finish; one sentence
                says why.
        """
        roles = self._request.roles
        asked = False
        with OperatorSocket(self._api) as socket:
            try:
                leases = {
                    role: socket.take(role, takeover=self._request.takeover) for role in roles
                }
                for role in roles:
                    self._api.post("robots", role, "arm", body={"lease": leases[role]})
                # Taken before the request, so that the programme cannot seem to end too early.
                began, asked = time.monotonic(), True
                self._start(leases)
                self._follow(socket, began)
            finally:
                # The quickest way first: a release stops and disarms. The rest makes sure. Roles
                # that somebody else drives, from the beginning or by now, are left alone.
                self._disarm(socket.release(), asked)

    def summary(self) -> JsonObject:
        """Return how far each role has come; ready for JSON."""
        return {
            "programme": self._request.name,
            "repeat": self._request.repeat,
            "reverse": self._request.reverse,
            "duration_s": round(self._request.duration_s, 3),
            "elapsed_s": round(self._elapsed_s, 3),
            "robots": {role: each.summary() for role, each in self._travelled.items()},
        }

    def _start(self, leases: dict[Role, str]) -> None:
        self._api.post(
            "robots",
            "programme",
            body={
                "name": self._request.name,
                "repeat": self._request.repeat,
                "reverse": self._request.reverse,
                "leases": leases,
            },
        )

    def _follow(self, socket: OperatorSocket, began: float) -> None:
        seen = False
        while True:
            socket.check()
            facts = self._api.get("robots")
            now = time.monotonic()
            robots, playing = facts["robots"], facts["programme"]
            for role, each in self._travelled.items():
                each.add(robots.get(role) or {}, now)
            if playing is not None:
                seen = True
                self._elapsed_s = playing["elapsed_s"]
                self._watch(playing, robots)
            elif seen or now - began > APPEARS_WITHIN_S:
                self._judge_end(facts, now - began)
                return
            time.sleep(max(0.0, now + POLL_S - time.monotonic()))

    def _judge_end(self, facts: JsonObject, since_start_s: float) -> None:
        """Check that the programme ended by itself.

        Raises:
            DrivingFailed: it did not.
        """
        whole = self._request.duration_s
        nearly = whole - min(_CLOSE_TO_END_S, whole / 2)
        in_time = since_start_s >= whole and self._elapsed_s >= nearly
        if in_time and facts["stopped"] is None:
            self._elapsed_s = whole
            return
        reasons = [
            each["why"] for each in facts["robots"].values() if each is not None and each.get("why")
        ]
        if facts["stopped"] is not None:
            reasons.insert(0, f"stopped by {facts['stopped']['by']}")
        if not reasons:
            # The reason may be gone by now.
            newest = facts.get("incidents", ())[-_NEWEST_INCIDENTS:]
            sentences = [each["sentence"] for each in newest if each["kind"] == "programme"]
            reasons = [each for each in sentences[-1:] if self._request.name in each]
        raise DrivingFailed(
            f"{self._request.name} ended after {self._elapsed_s:.1f} of {whole:.1f} s: "
            f"{'; '.join(reasons) or 'the server does not say why'}"
        )

    def _disarm(self, held: Sequence[Role], asked: bool) -> None:
        # A server that does not answer has lost this operator, and stops the robots by itself.
        # There may also be no programme to stop.
        if held and asked:
            with contextlib.suppress(DynamicObserverError):
                self._api.delete("robots", "programme")
        for role in held:
            with contextlib.suppress(DynamicObserverError):
                self._api.post("robots", role, "disarm")
