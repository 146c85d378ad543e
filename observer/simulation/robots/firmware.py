"""A robot's firmware, ARCOS or AmigOS: bytes in, bytes out, stepped by the times passed to it.

It has no port, thread or clock. ``receive`` takes incoming bytes, ``tick`` does what is due (status
packets, sonar, watchdog); both return what the robot sends, and both take a time that never
decreases. ``serving`` puts one behind a TCP port or a pseudo terminal.
"""

from __future__ import annotations

import math

from observer.robots.arcos import HEADER, Command, PacketParser, decode_command, packet
from observer.robots.models import RobotSpec
from observer.simulation.robots import packets
from observer.simulation.robots.chassis import Chassis
from observer.simulation.robots.command_log import Arrived, CommandLog
from observer.simulation.robots.faults import Faults
from observer.simulation.robots.motors import VELOCITIES, Motors

WATCHDOG_S = 2.0
STATUS_S = 0.1
_SONAR_S = 0.04
_NO_ECHO_MM = 5000
# Seconds without a byte after which an incomplete packet is discarded.
_INCOMPLETE_S = 0.1
_BAUDS = (9600, 19200, 38400, 57600, 115200)


class Firmware:
    """The firmware of one robot.

    Args:
        spec: the model. chassis: the machine below.
        now: start time, seconds; only differences matter.
        name, subtype: as it reports them; the subtype is the model's own unless given.
        watchdog_s: the robot stops after this long without a command; 0: never.
        bumpers: number at each end, at most 7.

    Attributes:
        faults: may be changed while it runs.
        log: commands that arrived.
        baud: current rate of its serial port.
        is_open: a session is open.
    """

    def __init__(
        self,
        spec: RobotSpec,
        chassis: Chassis,
        *,
        now: float = 0.0,
        name: str = "simulated",
        subtype: str | None = None,
        watchdog_s: float = WATCHDOG_S,
        bumpers: int = 0,
    ) -> None:
        self.spec = spec
        self.faults = Faults()
        self.log = CommandLog(self._within_limits)
        self.baud = _BAUDS[0]
        self.is_open = False
        self._chassis = chassis
        self._name = name
        self._subtype = subtype or spec.model
        self._watchdog_s = watchdog_s
        self._bumpers = bumpers
        self._motors = Motors(spec, chassis, self.faults, bumpers, watchdog_s, now)
        self._parser = PacketParser()
        self._now = self._received = now
        self._next_sync = 0
        self._to_go_off = False
        self._battest = 0
        self._origin = (0.0, 0.0, 0.0)
        self._next_status = self._next_sonar = math.inf
        self._sonar_on = False
        self._sonar_step = 0
        self._echoes: dict[int, int] = {}
        self._encoder = self._io = 0

    # ------------------------------------------------------------------ seen from outside

    @property
    def motors_enabled(self) -> bool:
        return self._motors.on

    @property
    def timed_out(self) -> bool:
        """True if the watchdog stopped the robot and no command has come since."""
        return self._motors.timed_out

    @property
    def odometry(self) -> tuple[float, float, float]:
        """x, y (m) and yaw (rad, not wrapped) since OPEN or SETO, before rounding."""
        w = self._chassis.wheels()
        x0, y0, yaw0 = self._origin
        c, s = math.cos(yaw0), math.sin(yaw0)
        dx, dy = w.x - x0, w.y - y0
        return c * dx + s * dy, c * dy - s * dx, w.yaw - yaw0

    def motors_off(self) -> None:
        """Switch the motors off, as after a fault of the machine; safe from any thread.

        It takes effect at the next ``receive`` or ``tick``.
        """
        self._to_go_off = True

    def cut_off(self) -> None:
        """Discard a half-received packet: the client is gone."""
        self._parser.clear()

    # ------------------------------------------------------------------ bytes in, bytes out

    def receive(self, data: bytes, now: float) -> bytes:
        """Process received bytes; return the immediate answer."""
        self._received = now
        self._go_off()
        return self._take_all(self._parser.feed(data), now)

    def tick(self, now: float) -> bytes:
        """Return what it sends unasked; to be called at least every 20 ms."""
        self._now = now
        self._go_off()
        sent = b""
        if now - self._received > _INCOMPLETE_S:
            sent = self._take_all(self._parser.abandon(), now)
        if not self.is_open:
            return sent
        self._motors.watch(now)
        self._listen_to_sonar(now)
        if now < self._next_status:
            return sent
        # A late tick skips packets rather than sending several at once.
        self._next_status = max(self._next_status + STATUS_S, now)
        sent += self._framed(self._status())
        if self._encoder == 2:
            sent += self._encoders()
        if self._io == 2:
            sent += self._framed(packets.io_data())
        if self.faults.strange_packets:
            sent += b"".join(self._framed(bytes([kind, 1, 2, 3])) for kind in packets.STRANGE)
        return sent

    def _framed(self, data: bytes) -> bytes:
        sent = packet(data)
        if self.faults.double_header:
            sent = HEADER[:1] + sent
        if self.faults.false_header:
            sent = HEADER + b"\xc8" + sent
        return sent

    def _take_all(self, found: list[bytes], now: float) -> bytes:
        self._now = now
        sent = b"".join([self._take(data, now) for data in found])
        self.log.bad_bytes = self._parser.skipped_bytes
        return sent

    def _take(self, data: bytes, now: float) -> bytes:
        try:
            read = decode_command(data)
        except ValueError:
            return b""
        number, argument = read.number, read.argument
        sent = self._obey(number, argument, now) if self.is_open else self._synchronize(number, now)
        meant = True
        if number in VELOCITIES and isinstance(argument, int) and argument != 0:
            meant = self.log.intended(*self._motors.asked(number, argument))
        point, enabled = self._motors.setpoint, self.motors_enabled
        self.log.add(
            Arrived(now, number, argument, point.speed, point.turn_rate, enabled, not meant)
        )
        return sent

    def _within_limits(self, speed_mps: float, turn_rate_radps: float) -> bool:
        spec = self.spec
        slack = 1.001
        return (
            abs(speed_mps) <= spec.speed_max_mps * slack
            and abs(turn_rate_radps) <= spec.turn_rate_max_radps * slack
        )

    # ------------------------------------------------------------------ sessions

    def _synchronize(self, number: int, now: float) -> bytes:
        """Answer outside a session, where 0, 1 and 2 are SYNC, and 1 is OPEN after SYNC2."""
        if self.faults.no_sync_reply or number > 2:
            return b""
        if self.faults.strange_sync_reply:
            return self._framed(b"\xff")
        if number == 1 and self._next_sync == 3:
            self.begin_session(now)
            return b""
        if number > self._next_sync:
            return b""
        self._next_sync = number + 1
        if number < 2:
            return self._framed(bytes([number]))
        words = (self._name, "Pioneer", self._subtype)
        return self._framed(b"\x02" + b"".join(word.encode() + b"\0" for word in words))

    def begin_session(self, now: float) -> None:
        """Open a session, as OPEN does; status packets continue until CLOSE, client or not."""
        self.is_open = True
        self._motors.switch(on=False)
        self._motors.commanded(now)
        self._next_status = now + STATUS_S
        self._next_sonar = now
        self._sonar_on = bool(self.spec.sonars)
        self._echoes.clear()
        self._encoder = self._io = 0
        self._set_origin()

    def _end(self) -> None:
        self._motors.switch(on=False)
        self.is_open = False
        self._next_sync = 0
        self._next_status = self._next_sonar = math.inf
        self.baud = _BAUDS[0]

    def _set_origin(self) -> None:
        w = self._chassis.wheels()
        self._origin = (w.x, w.y, w.yaw)

    def _go_off(self) -> None:
        if self._to_go_off:
            self._to_go_off = False
            self._motors.switch(on=False)

    # ------------------------------------------------------------------ commands

    def _obey(self, number: int, argument: int | bytes | None, now: float) -> bytes:
        # Any command feeds the watchdog, including PULSE, OPEN and unknown ones.
        self._motors.commanded(now)
        value = argument if isinstance(argument, int) else None
        if number == Command.CLOSE:
            self._end()
        elif number == Command.CONFIG:
            return b"" if self.faults.no_config_reply else self._framed(self._config())
        elif number in (Command.STOP, Command.E_STOP):
            self._motors.stop(hard=number == Command.E_STOP)
        elif number == Command.SETO:
            self._set_origin()
        elif value is not None:
            self._motors.move(number, value, self.odometry[2])
            return self._set(number, value)
        return b""

    def _set(self, number: int, value: int) -> bytes:
        """Obey a command with a numeric argument that sets something; return the answer."""
        if number == Command.ENABLE:
            self._motors.switch(on=bool(value))
        elif number == Command.SONAR:
            self._sonar_on = bool(value & 1) and bool(self.spec.sonars)
        elif number == Command.BUMPSTALL:
            self._motors.bump_stall = value & 3
        elif number == Command.BATTEST:
            self._battest = max(0, value)
        elif number == Command.HOSTBAUD and 0 <= value < len(_BAUDS):
            self.baud = _BAUDS[value]
        elif number == Command.ENCODER:
            self._encoder = value
            return self._encoders() if value == 1 else b""
        elif number == Command.IOREQUEST:
            self._io = value
            return self._framed(packets.io_data()) if value == 1 else b""
        else:
            self._motors.limit(number, value)
        return b""

    # ------------------------------------------------------------------ what it reports

    def _listen_to_sonar(self, now: float) -> None:
        if not self._sonar_on:
            return
        sonars = len(self.spec.sonars)
        if now - self._next_sonar > _SONAR_S * packets.SONAR_ARRAY:
            self._next_sonar = now
        while now >= self._next_sonar:
            for index in range(self._sonar_step, sonars, packets.SONAR_ARRAY):
                echo = self._chassis.sonar(index)
                self._echoes[index] = _NO_ECHO_MM if echo is None else round(echo * 1000)
            self._sonar_step = (self._sonar_step + 1) % packets.SONAR_ARRAY
            self._next_sonar += _SONAR_S

    def _status(self) -> bytes:
        wheels, faults, spec = self._chassis.wheels(), self.faults, self.spec
        front, rear = self._motors.touched(wheels)
        stalled = self._motors.stalled(wheels)
        stall = stalled[0] | stalled[1] << 8 | rear << 1 | front << 9
        if faults.phantom_bumpers:
            stall |= 0xFEFE
        flags = self.motors_enabled | self._sonar_on << 1 | faults.stop_pressed << 5 | faults.flags
        if self._sonar_on and len(spec.sonars) > packets.SONAR_ARRAY:
            flags |= 1 << 2
        battery = 0 if faults.battery_v is None else round(faults.battery_v * 10)
        echoes, self._echoes = self._echoes, {}
        return packets.status_data(
            spec,
            wheels,
            self.odometry,
            faults,
            stall=stall,
            flags=flags,
            battery_dv=self._battest or battery,
            echoes=echoes,
        )

    def _encoders(self) -> bytes:
        return self._framed(packets.encoder_data(self._chassis.wheels()))

    def _config(self) -> bytes:
        return packets.config_data(
            self.spec,
            self._motors.limits,
            subtype=self._subtype,
            name=self._name,
            host_baud=_BAUDS.index(self.baud),
            watchdog_s=self._watchdog_s,
            bumpers=self._bumpers,
        )
