"""Pioneer P3-DX and AmigoBot: the driver that owns the port of an ARCOS robot.

One thread reads (after setting up the session), one writes (``setpoint_writer``). They carry out
the callers' requests, so that no method waits for the port.
"""

from __future__ import annotations

import math
import threading
import time
from collections import Counter
from collections.abc import Callable

from observer.robots.arcos import Command, command
from observer.robots.config_reply import CONFIG_REPLY, decode_config
from observer.robots.contract import COUNTERS, RobotPhase, RobotReport, Sent
from observer.robots.handshake import (
    MOTORS_OFF,
    STANDSTILL,
    NoSession,
    ask_config,
    open_session,
    shake_hands,
    speed_up,
)
from observer.robots.known_robot import KnownRobot
from observer.robots.models import SPECS, robot_spec
from observer.robots.packet_line import Closing, PacketLine
from observer.robots.robot_limits import limit_commands, setpoint_within
from observer.robots.robot_watch import RobotWatch
from observer.robots.serial_port import PortLost, open_port
from observer.robots.setpoint_writer import SetpointWriter
from observer.robots.sip import is_status

# Pauses between attempts to connect: a lost port may be back immediately, a missing one is not
# urgent.
_FIRST_PAUSE_S, _PAUSE_S = 0.3, 1.0
# A robot silent for this long has been switched off, or its cable is out.
_SILENCE_LOST_S = 3.0
_FAREWELL_S = 0.1
# CLOSE may be lost: it is repeated while status packets, every 100 ms, still come.
_GOODBYES, _SILENT_S = 3, 0.15
_CLOSE_S = 1.9
_STOP = (command(Command.E_STOP), *STANDSTILL[1:], MOTORS_OFF)


class UnknownRobot(Exception):
    """A robot of unknown model answered. The message is a sentence."""


class Pioneer:
    """Implements ``observer.robots.contract.Robot``; connects by itself once constructed.

    Args:
        port: ``/dev/...`` or ``socket://HOST:PORT``.
        model: of ``observer.robots.models``, overriding what the robot reports; None: as reported.
        clock: monotonic; of all reported times.

    Raises:
        InputError: there is no such model.
    """

    def __init__(
        self,
        port: str,
        model: str | None = None,
        *,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._port_text = port
        self._clock = clock
        # Guards everything below; held briefly.
        self._lock = threading.Lock()
        self._phase = RobotPhase.CONNECTING
        self._trouble: str | None = None
        self._known = KnownRobot(None if model is None else robot_spec(model))
        self._watch = RobotWatch()
        self._writer: SetpointWriter | None = None
        self._counters: Counter[str] = Counter()
        self._line: PacketLine | None = None
        self._last_sent: Sent | None = None
        # A higher baud rate that brought no status packet is not tried again.
        self._may_speed_up, self._sped_up = True, False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="robot reader", daemon=True)
        self._thread.start()

    # ------------------------------------------------------------------ as Robot

    def report(self) -> RobotReport:
        """Return the robot's current state; callable from any thread."""
        with self._lock:
            return self._report(self._clock())

    def enable(self) -> None:
        """Switch the motors on, at zero velocity, unless there is a fault or no connection."""
        with self._lock:
            if self._writer is not None and self._watch.switch_on(self._clock()):
                self._writer.halt(*STANDSTILL, command(Command.ENABLE, 1))

    def disable(self) -> None:
        """Command zero velocity and switch the motors off."""
        self._halt(*STANDSTILL[1:], MOTORS_OFF)

    def drive(self, speed_mps: float, turn_rate_radps: float) -> Sent:
        """Take a velocity, as ``Robot.drive`` specifies."""
        with self._lock:
            setpoint = (0, 0)
            limits = self._known.limits
            if self._watch.may_move and limits is not None:
                setpoint = setpoint_within(limits, speed_mps, turn_rate_radps)
            if self._writer is not None:
                self._writer.drive(setpoint)
            return Sent(setpoint[0] / 1000, math.radians(setpoint[1]), self._clock())

    def stop(self) -> None:
        """Send E_STOP, zero velocity and motors off, immediately."""
        self._halt(*_STOP)

    def clear(self) -> None:
        """Clear the fault if its cause is gone; motors stay off."""
        with self._lock:
            self._watch.clear(self._clock())
            if self._writer is not None:
                self._writer.halt(*STANDSTILL[1:], MOTORS_OFF)

    def close(self) -> None:
        """Close as ``Robot.close`` specifies.

        A host that does not answer at all may keep the reading thread waiting, and doing nothing
        else, for some seconds longer.
        """
        self._closing.set()
        self._thread.join(_CLOSE_S)
        with self._lock:
            self._phase = RobotPhase.CLOSED

    def _halt(self, *commands: bytes) -> None:
        with self._lock:
            self._watch.switch_off(self._clock())
            if self._writer is not None:
                self._writer.halt(*commands)

    # ------------------------------------------------------------------ the reading thread

    def _run(self) -> None:
        try:
            self._stay_connected()
        finally:
            with self._lock:
                if self._phase in (RobotPhase.CONNECTED, RobotPhase.CONNECTING):
                    # After an unexpected error it must not appear connected.
                    self._phase, self._trouble = RobotPhase.REFUSED, "its driver failed"
                    self._watch.lost(self._trouble, self._clock())

    def _stay_connected(self) -> None:
        pause = _FIRST_PAUSE_S
        while not self._closing.is_set():
            try:
                self._connect_and_serve()
            except Closing:
                break
            except UnknownRobot as error:
                self._gone(RobotPhase.REFUSED, str(error))
                return
            except (PortLost, NoSession) as error:
                if self._gone(RobotPhase.WAITING, str(error)):
                    pause = _FIRST_PAUSE_S
            self._closing.wait(pause)
            pause = _PAUSE_S
        with self._lock:
            self._phase, self._trouble = RobotPhase.CLOSED, None
            self._watch.closed()

    def _connect_and_serve(self) -> None:
        port = open_port(self._port_text)
        line = PacketLine(port, self._closing.is_set)
        writer: SetpointWriter | None = None
        discard = True
        try:
            self._line = line
            self._come_in(line)
            writer = SetpointWriter(port, self._clock)
            self._arrived(writer)
            while True:
                self._serve(line, writer)
        except (PortLost, NoSession, UnknownRobot):
            raise
        except BaseException:
            # On closing or after an unexpected error the robot must not drive on.
            self._say_goodbye(line, writer)
            discard = False
            raise
        finally:
            with self._lock:
                self._writer = None
                if writer is not None and writer.sent is not None:
                    self._last_sent = writer.sent
                self._count_line(line)
            if writer is not None:
                writer.finish(0.5)
            port.close(discard=discard)

    def _come_in(self, line: PacketLine) -> None:
        identity = shake_hands(line)
        with self._lock:
            spec = self._known.identify(identity)
        if spec is None:
            line.send(command(Command.CLOSE))
            raise UnknownRobot(
                f"the robot at {line.port.name} identifies itself as {identity.subtype!r}, which "
                f"is not a known model; choose the model to drive it as: {', '.join(SPECS)}"
            )
        open_session(line)
        config = ask_config(line)
        with self._lock:
            limits = self._known.configure(config)
        line.send(command(Command.ENCODER, 0), command(Command.SONAR, 1))
        line.send(*limit_commands(limits))
        if self._may_speed_up and spec.high_speed_serial and line.port.serial_line:
            self._may_speed_up = False
            self._sped_up = speed_up(line, spec.high_speed_serial)

    def _arrived(self, writer: SetpointWriter) -> None:
        """Begin a session: at a standstill, motors off."""
        with self._lock:
            self._known.begin_session(self._clock())
            self._writer = writer
            self._watch.connected(self._clock())
            self._phase, self._trouble = RobotPhase.CONNECTED, None

    def _serve(self, line: PacketLine, writer: SetpointWriter) -> None:
        """Process received packets and check the robot; every 50 ms or more often."""
        for payload in line.receive():
            self._take(payload, writer)
        now = self._clock()
        with self._lock:
            bad, frozen = self._watch.tick(now), writer.frozen
            if frozen and self._watch.switched_on:
                self._watch.blame(
                    "this computer was suspended, or too busy to serve it, for a second or more"
                )
                bad = True
            writer.in_outage(self._watch.in_outage(now, self._known.watchdog_s))
            if bad:
                writer.halt(*_STOP)
            elif again := self._watch.due_command(now):
                writer.send(again)
            if frozen:
                # Not before the velocity asked for was dropped.
                writer.frozen = False
            silence = self._watch.silence_s(now)
        if writer.broken is not None:
            raise PortLost(writer.broken)
        if silence > _SILENCE_LOST_S:
            raise PortLost(f"the robot at {line.port.name} sent nothing for {silence:.0f} s")

    def _take(self, payload: bytes, writer: SetpointWriter) -> None:
        if payload[0] == CONFIG_REPLY:
            config = decode_config(payload)
            with self._lock:
                self._known.configure(config)
            return
        if not is_status(payload):
            self._counters["unknown_packets"] += 1
            return
        try:
            status = self._known.decode(payload)
        except ValueError:
            self._counters["bad_packets"] += 1
            return
        now = self._clock()
        with self._lock:
            if self._watch.saw(status, now):
                writer.halt(*_STOP)
            self._known.take(status, now)
            self._may_speed_up |= self._sped_up

    def _say_goodbye(self, line: PacketLine, writer: SetpointWriter | None) -> None:
        farewell = (*STANDSTILL, MOTORS_OFF)
        try:
            if writer is not None:
                writer.halt(*farewell)
                if not writer.finish(0.5):
                    return
                time.sleep(_FAREWELL_S)
            else:
                line.send(*farewell)
            for _ in range(_GOODBYES):
                line.send(command(Command.CLOSE))
                # The first bytes may have been sent before CLOSE arrived.
                if not line.port.read(_SILENT_S) or not line.port.read(_SILENT_S):
                    return
        except PortLost:
            # The robot is already gone.
            return

    def _gone(self, phase: RobotPhase, sentence: str) -> bool:
        """Record the loss of the connection; return whether there was one."""
        with self._lock:
            had = self._phase is RobotPhase.CONNECTED
            self._phase, self._trouble = phase, sentence
            self._watch.lost(sentence, self._clock())
            if had:
                self._counters["reconnects"] += 1
            return had

    # ------------------------------------------------------------------ reporting

    def _count_line(self, line: PacketLine) -> None:
        self._counters["packets"] += line.parser.packets
        self._counters["bad_packets"] += line.parser.bad_packets
        self._line = None

    def _report(self, now: float) -> RobotReport:
        counters = dict.fromkeys(COUNTERS, 0) | self._counters
        if (line := self._line) is not None:
            counters["packets"] += line.parser.packets
            counters["bad_packets"] += line.parser.bad_packets
        sent = self._writer.sent if self._writer is not None else None
        return self._known.report(
            self._phase, self._trouble, self._watch, sent or self._last_sent, counters, now
        )
