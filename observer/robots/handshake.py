"""Session set-up with an ARCOS robot, whatever state the last client left it in.

All functions also raise the exceptions of the methods of ``PacketLine``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from observer.robots.arcos import Command, command
from observer.robots.config_reply import CONFIG_REPLY, ConfigReply, as_text, decode_config
from observer.robots.packet_line import PacketLine
from observer.robots.serial_port import FIRST_BAUD
from observer.robots.sip import is_status

# The order matters: a robot stopped by its watchdog resumes its last velocity at any command
# other than these.
STANDSTILL = (command(Command.STOP), command(Command.VEL, 0), command(Command.RVEL, 0))
MOTORS_OFF = command(Command.ENABLE, 0)
_CLOSE = command(Command.CLOSE)

_SYNC_S = 1.0
# Time to listen first: in an open session SYNC 0 would be PULSE, and a stopped robot would resume
# driving. An open session shows by a status packet every 100 ms.
_LISTEN_S = 0.25
_TRIES, _TRIES_IN_SILENCE = 10, 5
_SILENT_BEFORE_CLOSE = 2
_BAUDS = (9600, 38400, 115200, 19200, 57600)
_HOSTBAUD = {9600: 0, 19200: 1, 38400: 2, 57600: 3, 115200: 4}
_NOT_UNDERSTOOD = 0xFF
_OPEN_TRIES, _FIRST_STATUS_S = 3, 0.7
_CONFIG_TRIES, _CONFIG_S = 3, 0.5
_BAUD_S = 0.5


class NoSession(Exception):
    """No session with the robot can be opened. The message is a sentence."""


@dataclass(frozen=True)
class Identity:
    """Identity that a robot reports.

    Attributes:
        name: its own. kind: its class, ``Pioneer``. subtype: its model, in lower case.
    """

    name: str
    kind: str
    subtype: str


def shake_hands(line: PacketLine) -> Identity:
    """Exchange SYNC 0, 1 and 2, and return the robot's identity.

    Raises:
        NoSession: it does not answer, or not as the protocol demands.
    """
    answered = line.wait_for(is_status, _LISTEN_S) is not None
    if answered or line.parser.skipped_bytes:
        # Damaged packets, or packets at another baud rate, also indicate an open session.
        _end_session(line)
    step, silent = 0, 0
    # Counts SYNCs that were not echoed; at most two echoed ones come between two failures.
    failed = 0
    while failed < (_TRIES if answered else _TRIES_IN_SILENCE):
        line.send(command(step))
        reply = line.wait_for(partial(_counts, step=step), _SYNC_S)
        if reply is not None:
            answered = True
            if reply[0] == step == 2:
                return _identity(reply)
            if reply[0] == step:
                step += 1
                continue
            if is_status(reply):
                _end_session(line)
            else:
                line.drain(0.1, 0.5)
        else:
            silent += 1
            if silent == _SILENT_BEFORE_CLOSE:
                _close_at_every_rate(line)
        failed += 1
        step = 0
    if answered:
        raise NoSession(
            f"the robot at {line.port.name} responds but does not open a session; power-cycle it"
        )
    raise NoSession(
        f"no robot answers at {line.port.name}; check that it is switched on, that its cable is "
        "plugged in and that no other program is driving it"
    )


def open_session(line: PacketLine) -> None:
    """Send OPEN, at a standstill with motors off, and wait for the first status packet.

    Raises:
        NoSession: no status packet comes.
    """
    for _ in range(_OPEN_TRIES):
        line.send(command(Command.OPEN), *STANDSTILL, MOTORS_OFF, command(Command.PULSE))
        if line.wait_for(is_status, _FIRST_STATUS_S) is not None:
            return
    raise NoSession(f"the robot at {line.port.name} opened no session: it sends no status")


def ask_config(line: PacketLine) -> ConfigReply:
    """Ask the robot for its settings; all None where it does not answer."""
    for _ in range(_CONFIG_TRIES):
        line.send(command(Command.CONFIG))
        reply = line.wait_for(lambda payload: payload[0] == CONFIG_REPLY, _CONFIG_S)
        if reply is not None:
            return decode_config(reply)
    return ConfigReply()


def speed_up(line: PacketLine, baud: int) -> bool:
    """Ask for a higher baud rate; return whether it is in use. Falls back to the old rate.

    Raises:
        NoSession: it is silent at the old rate as well.
    """
    before = line.port.baud
    if before is None or baud not in _HOSTBAUD:
        return False
    # It may have changed its rate though nothing arrives, so the old rate is requested at the new.
    for rate in (baud, before):
        line.send(command(Command.HOSTBAUD, _HOSTBAUD[rate]))
        line.change_baud(rate)
        # Two packets, as a single one may be old.
        if all(line.wait_for(is_status, _BAUD_S) is not None for _ in range(2)):
            return rate == baud
    raise NoSession(f"the robot at {line.port.name} stopped responding at {baud} baud")


def _counts(payload: bytes, *, step: int) -> bool:
    """Return whether a payload can be the answer to SYNC ``step``."""
    # A late echo of the previous step does not count.
    return (
        is_status(payload)
        or payload[0] == _NOT_UNDERSTOOD
        or (payload[0] <= 2 and payload[0] != step - 1)
    )


def _end_session(line: PacketLine) -> None:
    """End the session of a client that died without CLOSE, whatever velocity it had commanded."""
    line.send(*STANDSTILL, MOTORS_OFF, _CLOSE)
    line.drain(0.15, 1.0)


def _close_at_every_rate(line: PacketLine) -> None:
    if not line.port.serial_line:
        line.send(*STANDSTILL, MOTORS_OFF, _CLOSE)
        return
    for baud in _BAUDS:
        line.change_baud(baud)
        line.send(*STANDSTILL, MOTORS_OFF, _CLOSE)
    line.change_baud(FIRST_BAUD)
    line.drain(0.15, 0.5)


def _identity(reply: bytes) -> Identity:
    words = [as_text(each) for each in reply[1:].split(b"\0")]
    words += [""] * (3 - len(words))
    return Identity(words[0], words[1], words[2].lower())
