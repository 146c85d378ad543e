"""``/api/drive``: driving by hand. One socket is one operator; the leases end with the socket.

The reader waits only for the network: messages are handled in tasks, so that a stop never waits
behind a velocity.
"""

from __future__ import annotations

import asyncio
import contextlib

from fastapi import WebSocket

from app.contract.drive import COMMAND_FRESH_S, DriveCommand, Presence
from app.contract.sockets import (
    HEARTBEAT_S,
    DriveMessage,
    LeaseMessage,
    LinkMessage,
    OperatorMessage,
    PingMessage,
    RefusedMessage,
    SentMessage,
)
from app.contract.values import filled, json_text
from app.http.gate.access import WATCHING_ONLY, Access
from app.http.gate.admission import access_of, session_of
from app.http.sockets.command_age import TOO_SLOW, CommandAge
from app.http.sockets.connections import GOING_AWAY, TRY_LATER, close, receive_text, until_one_ends
from app.http.sockets.drive_messages import (
    Command,
    Pong,
    Release,
    Stop,
    Take,
    Unusable,
    read_message,
)
from app.server import Conflict, FieldError, NotAvailable, Server
from app.server.background import Background
from observer.rig.rig import Role

# A client silent for this long is gone, whatever the kernel says about the connection.
_SILENT_S = 10.0
# Messages waiting for a client to read them: three seconds' worth.
_MOST_WAITING = 64
# Commands that the drive process has not answered yet.
_MOST_UNANSWERED = 8
_REFUSALS = (Conflict, FieldError, NotAvailable)


class DriveSocket:
    """Socket of one operator; from a read-only client it accepts only the stop."""

    def __init__(self, socket: WebSocket, server: Server, name: str | None) -> None:
        self._socket = socket
        self._may_drive = access_of(socket.scope) is Access.OPERATOR
        self._driving = server.driving
        self._clock = server.clock
        self._command_age = CommandAge()
        self._waiting: asyncio.Queue[DriveMessage] = asyncio.Queue(_MOST_WAITING)
        self._overrun = asyncio.Event()
        self._background = Background()
        self._unanswered = 0
        # Takes and releases happen in the order of their requests.
        self._leasing = asyncio.Lock()
        self._sequences: dict[str, int] = {}
        self._heard = self._clock()
        self._operator = self._driving.operators.join(name, self._lost, session_of(socket.scope))

    async def serve(self) -> None:
        """Serve the socket until the client leaves."""
        self._say(OperatorMessage(self._operator.name))
        try:
            await until_one_ends(
                self._socket, self._read(), self._send(), self._ping(), self._watch()
            )
        finally:
            # First of all, the robots stop.
            self._driving.operators.leave(self._operator)
            await self._background.cancel()

    # --- outgoing --------------------------------------------------------------------------

    def _say(self, message: DriveMessage) -> None:
        try:
            self._waiting.put_nowait(message)
        except asyncio.QueueFull:
            self._overrun.set()

    async def _send(self) -> None:
        while True:
            message = await self._waiting.get()
            await self._socket.send_text(json_text(message))

    async def _watch(self) -> None:
        """Close the connection of a client that stops reading or answering."""
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(1.0):
                    await self._overrun.wait()
            if self._overrun.is_set():
                await close(self._socket, TRY_LATER, "messages are not read in time")
                return
            if self._clock() - self._heard > _SILENT_S:
                await close(self._socket, GOING_AWAY, "no ping was answered for 10 s")
                return

    async def _ping(self) -> None:
        number = 0
        while True:
            number += 1
            now = self._clock()
            self._say(self._link_message(now))
            self._command_age.pinged(number, now)
            self._say(PingMessage(number))
            await asyncio.sleep(HEARTBEAT_S)

    def _link_message(self, now: float) -> LinkMessage:
        state = self._command_age.state(now)
        stops = state.quality != "good" and bool(self._operator.leases)
        rtt_ms, delay_ms = _ms(state.rtt_s), _ms(state.delay_s)
        return LinkMessage(state.quality, rtt_ms, delay_ms, TOO_SLOW if stops else None)

    def _lost(self, role: Role, sentence: str) -> None:
        holder = self._driving.operators.holder(role)
        self._say(LeaseMessage(role, "lost", holder=holder, sentence=sentence))

    # --- incoming --------------------------------------------------------------------------

    async def _read(self) -> None:
        while True:
            message = read_message(await receive_text(self._socket))
            # The age includes any time the command waited; see ``app.http.sockets.command_age``.
            now = self._clock()
            self._heard = now
            match message:
                case Pong():
                    self._command_age.ponged(message.number, message.stamp, now)
                case Stop():
                    self._background.start(self._stop())
                case _ if not self._may_drive:
                    self._refuse_watcher(message)
                case Command():
                    self._command(message, now)
                case Unusable():
                    self._refuse(message.role, message.sequence, message.sentence)
                case Take() | Release():
                    self._background.start(self._change_lease(message))

    def _refuse(self, role: Role | None, sequence: int | None, sentence: str) -> None:
        self._say(RefusedMessage(role, sequence, sentence))

    def _refuse_watcher(self, message: Take | Release | Command | Unusable) -> None:
        if isinstance(message, Take):
            holder = self._driving.operators.holder(message.role)
            self._say(LeaseMessage(message.role, "refused", holder=holder, sentence=WATCHING_ONLY))
            return
        sequence = None if isinstance(message, Release) else message.sequence
        self._refuse(message.role, sequence, WATCHING_ONLY)

    async def _stop(self) -> None:
        try:
            await self._driving.stop_robots(self._operator.name)
        except _REFUSALS as error:
            self._refuse(None, None, str(error))

    async def _change_lease(self, message: Take | Release) -> None:
        role, operators = message.role, self._driving.operators
        async with self._leasing:
            if isinstance(message, Release):
                await operators.release(self._operator, role)
                return
            try:
                lease = await operators.take(self._operator, role, takeover=message.takeover)
            except _REFUSALS as error:
                holder = operators.holder(role)
                self._say(LeaseMessage(role, "refused", holder=holder, sentence=str(error)))
            else:
                self._say(LeaseMessage(role, "yours", lease=lease, holder=self._operator.name))

    def _command(self, command: Command, now: float) -> None:
        """Forward a command or say why not; never keep it for later."""
        age = self._command_age.age(command.stamp, now)
        lease = self._operator.leases.get(command.role)
        sentence = None
        if lease is None:
            sentence = f"take control of the {command.role} first"
        elif age is None:
            sentence = (
                "the connection delay is unknown; answer the pings, using the same clock for "
                "timestamps"
            )
        elif age > COMMAND_FRESH_S or not self._command_age.is_fit(now):
            sentence = TOO_SLOW
        elif command.sequence <= self._sequences.get(lease, -1):
            sentence = f"sequence must be greater than {self._sequences[lease]}"
        elif self._unanswered >= _MOST_UNANSWERED:
            sentence = "the drive process is overloaded"
        if sentence is not None or lease is None or age is None:
            self._refuse(command.role, command.sequence, sentence or TOO_SLOW)
            return
        self._sequences[lease] = command.sequence
        self._unanswered += 1
        self._background.start(self._pass_on(command, lease, now - age))

    async def _pass_on(self, command: Command, lease: str, issued: float) -> None:
        role, sequence = command.role, command.sequence
        try:
            if command.velocity is None:
                await self._driving.ask(Presence(role, lease, sequence, issued))
                return
            reply = await self._driving.ask(
                DriveCommand(role, lease, sequence, issued, *command.velocity)
            )
        except _REFUSALS as error:
            self._refuse(role, sequence, str(error))
        else:
            self._say(
                filled(
                    SentMessage,
                    reply,
                    role=role,
                    sequence=sequence,
                    age_ms=_ms(reply.age_s),
                    type="sent",
                )
            )
        finally:
            self._unanswered -= 1


def _ms(seconds: float | None) -> float | None:
    return None if seconds is None else round(1000 * seconds, 1)
