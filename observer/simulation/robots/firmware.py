"""A robot's firmware, ARCOS or AmigOS: bytes in, bytes out, by the time it is told.

It knows no port, no thread and no clock. ``receive`` takes what came, ``tick`` does what is due
(status packets, sonar, watchdog); both answer what the robot sends, and both are to be called
with a time that never goes back. ``serving`` puts one behind a TCP port or a pseudo terminal.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from observer.robots.arcos import HEADER, Command, PacketParser, decode_command, packet
from observer.robots.models import RobotSpec
from observer.simulation.robots import packets
from observer.simulation.robots.chassis import Chassis, Drive, Wheels
from observer.simulation.robots.command_log import Arrived, CommandLog
from observer.simulation.robots.faults import Faults

WATCHDOG_S = 2.0
STATUS_S = 0.1
_SONAR_S = 0.04
# Sonars of one array fire one after the other, arrays at the same time.
_ARRAY = 8
_NO_ECHO_MM = 5000
# After a stall the motors are relaxed for so long; CONFIG tells it in units of 5 ms.
_STALL_WAIT_S = 1.0
# A packet that does not go on for so long was none.
_INCOMPLETE_S = 0.1
# As hard as the machine can brake: E_STOP overrides the deceleration that was asked for.
_HARDEST_MPS2, _HARDEST_RADPS2 = 5.0, 20.0
# Below these a robot counts as standing.
_STANDS_MPS, _STANDS_RADPS = 0.002, 0.004
# Of the goals of MOVE, HEAD and DHEAD.
_NEAR_M, _NEAR_RAD = 0.005, math.radians(0.5)
_TICKS_PER_TURN = 500
_BAUDS = (9600, 19200, 38400, 57600, 115200)

_VELOCITIES = (Command.VEL, Command.RVEL, Command.VEL2)
_MOTIONS = (*_VELOCITIES, Command.MOVE, Command.HEAD, Command.DHEAD)


@dataclass
class _Setpoint:
    """What motion was asked for last; it outlives the watchdog."""

    speed: float = 0.0
    turn_rate: float = 0.0
    wheels: bool = False
    # Way and heading to be reached, in the encoders' own sums.
    way_goal: float | None = None
    heading_goal: float | None = None
    hard: bool = False


@dataclass
class _Limits:
    """As CONFIG tells and SETV, SETRV, SETA and SETRA change; m/s, rad/s and per second."""

    speed: float
    turn_rate: float
    acceleration: float = 0.3
    deceleration: float = 0.3
    turn_acceleration: float = math.radians(100)
    turn_deceleration: float = math.radians(100)


class Firmware:
    """One robot's.

    Args:
        spec: the model. chassis: the machine below.
        now: the time at the start, seconds; only differences count.
        name, subtype: as it tells; the subtype is the model's own unless given.
        watchdog_s: after how long without a command it stops.
        front_bumpers, rear_bumpers: how many are fitted, at most 7.
        faults: may be changed while it runs.

    Attributes:
        log: what arrived.
        baud: of its serial port at this moment.
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
        front_bumpers: int = 0,
        rear_bumpers: int = 0,
        faults: Faults | None = None,
    ) -> None:
        self.spec = spec
        self.faults = faults or Faults()
        self.log = CommandLog(self._within_limits)
        self.baud = _BAUDS[0]
        self._chassis = chassis
        self._name = name
        self._subtype = subtype or spec.model
        self._watchdog_s = watchdog_s
        self._bumpers = (front_bumpers, rear_bumpers)
        self._parser = PacketParser()
        self._now = self._received = now
        self._open = False
        self._next_sync = 0
        self._enabled = False
        self._to_go_off = False
        self._setpoint = _Setpoint()
        self._limits = _Limits(spec.speed_max_mps, spec.turn_rate_max_radps)
        self._commanded = now
        self._timed_out = False
        self._relaxed_until = -math.inf
        self._stall = (False, False)
        self._bump_stall = 0
        self._battest = 0
        self._origin = (0.0, 0.0, 0.0)
        self._next_status = self._next_sonar = math.inf
        self._sonar_on = False
        self._sonar_step = 0
        self._echoes: dict[int, int] = {}
        self._encoder = self._io = 0

    # ------------------------------------------------------------------ seen from outside

    @property
    def is_open(self) -> bool:
        """Whether a session is open."""
        return self._open

    @property
    def motors_enabled(self) -> bool:
        return self._enabled and not self.faults.stop_pressed

    @property
    def timed_out(self) -> bool:
        """Whether the watchdog stopped it and no command came since."""
        return self._timed_out

    @property
    def odometry(self) -> tuple[float, float, float]:
        """x, y (m) and yaw (rad, not wrapped) since OPEN or SETO, before they are rounded."""
        w = self._chassis.wheels()
        x0, y0, yaw0 = self._origin
        c, s = math.cos(yaw0), math.sin(yaw0)
        dx, dy = w.x - x0, w.y - y0
        return c * dx + s * dy, c * dy - s * dx, w.yaw - yaw0

    def motors_off(self) -> None:
        """The motors go off by themselves, as after a fault of the machine; from any thread.

        They are off from the next ``receive`` or ``tick`` on.
        """
        self._to_go_off = True

    def leave_open(self, now: float) -> None:
        """As if the last client had died without saying goodbye: status packets go on."""
        self._begin(now)

    def cut_off(self) -> None:
        """Its client is gone: what came of a packet is worth nothing to the next one."""
        self._parser.clear()

    # ------------------------------------------------------------------ bytes in, bytes out

    def receive(self, data: bytes, now: float) -> bytes:
        """What it answers to these bytes at once."""
        self._received = now
        self._go_off()
        return self._take_all(self._parser.feed(data), now)

    def tick(self, now: float) -> bytes:
        """What it sends by itself by this time; to be called every 20 ms at least."""
        self._now = now
        self._go_off()
        sent = b""
        if now - self._received > _INCOMPLETE_S:
            sent = self._take_all(self._parser.abandon(), now)
        if not self._open:
            return sent
        self._watch(now)
        self._listen_to_sonar(now)
        if now < self._next_status:
            return sent
        # A tick that comes late costs packets, it does not bring several at once.
        self._next_status = max(self._next_status + STATUS_S, now)
        sent += self._framed(self._status())
        if self._encoder == 2:
            sent += self._framed(self._encoders())
        if self._io == 2:
            sent += self._framed(bytes([packets.IO_REPLY]) + bytes(21))
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
        if not self._open:
            sent = self._synchronize(number, now)
        else:
            sent = self._obey(number, argument, now)
        meant = True
        if number in _VELOCITIES and isinstance(argument, int) and argument != 0:
            meant = self.log.intended(*self._asked(number, argument))
        point = self._setpoint
        self.log.add(
            Arrived(
                now, number, argument, point.speed, point.turn_rate, self.motors_enabled, not meant
            )
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
        """Outside a session the bytes 0, 1 and 2 are SYNC, and 1 is OPEN behind SYNC2."""
        if self.faults.no_sync_reply or number > 2:
            return b""
        if self.faults.strange_sync_reply:
            return self._framed(b"\xff")
        if number == 1 and self._next_sync == 3:
            self._begin(now)
            return b""
        if number > self._next_sync:
            return b""
        self._next_sync = number + 1
        if number < 2:
            return self._framed(bytes([number]))
        words = (self._name, "Pioneer", self._subtype)
        return self._framed(b"\x02" + b"".join(word.encode() + b"\0" for word in words))

    def _begin(self, now: float) -> None:
        self._open = True
        self._disable()
        self._commanded = now
        self._timed_out = False
        self._next_status = now + STATUS_S
        self._next_sonar = now
        self._sonar_on = bool(self.spec.sonars)
        self._echoes.clear()
        self._encoder = self._io = 0
        self._set_origin()

    def _end(self) -> None:
        self._disable()
        self._open = False
        self._next_sync = 0
        self._next_status = self._next_sonar = math.inf
        self.baud = _BAUDS[0]

    def _set_origin(self) -> None:
        w = self._chassis.wheels()
        self._origin = (w.x, w.y, w.yaw)

    def _go_off(self) -> None:
        if self._to_go_off:
            self._to_go_off = False
            self._disable()

    def _disable(self) -> None:
        self._enabled = False
        self._setpoint = _Setpoint()
        self._drive()

    # ------------------------------------------------------------------ commands

    def _obey(self, number: int, argument: int | bytes | None, now: float) -> bytes:
        # Any command at all ends a time-out, and the robot takes its last setpoint up again.
        self._commanded = now
        self._timed_out = False
        value = argument if isinstance(argument, int) else None
        if number == Command.OPEN or number == Command.PULSE:
            pass
        elif number == Command.CLOSE:
            self._end()
        elif number == Command.CONFIG:
            return self._framed(self._config())
        elif number in (Command.STOP, Command.E_STOP):
            self._setpoint = _Setpoint(hard=number == Command.E_STOP)
        elif number == Command.SETO:
            self._set_origin()
        elif value is not None:
            sent = self._set(number, value)
            if sent is not None:
                return sent
            self._move(number, value)
        self._drive()
        return b""

    def _set(self, number: int, value: int) -> bytes | None:
        """Commands that set something; None where it is none of them, or has no answer."""
        limits, spec = self._limits, self.spec
        if number == Command.ENABLE:
            if not value:
                self._disable()
            elif not self.faults.stop_pressed:
                self._enabled = True
        elif number == Command.SETA and value:
            name = "acceleration" if value > 0 else "deceleration"
            setattr(limits, name, abs(value) / 1000)
        elif number == Command.SETRA and value:
            name = "turn_acceleration" if value > 0 else "turn_deceleration"
            setattr(limits, name, math.radians(abs(value)))
        elif number == Command.SETV and value > 0:
            limits.speed = min(value / 1000, spec.speed_max_mps)
        elif number == Command.SETRV and value > 0:
            limits.turn_rate = min(math.radians(value), spec.turn_rate_max_radps)
        elif number == Command.SONAR:
            self._sonar_on = bool(value & 1) and bool(spec.sonars)
        elif number == Command.BUMPSTALL:
            self._bump_stall = value & 3
        elif number == Command.BATTEST:
            self._battest = max(0, value)
        elif number == Command.HOSTBAUD and 0 <= value < len(_BAUDS):
            self.baud = _BAUDS[value]
        elif number == Command.ENCODER:
            self._encoder = value
            return self._framed(self._encoders()) if value == 1 else None
        elif number == Command.IOREQUEST:
            self._io = value
            return self._framed(bytes([packets.IO_REPLY]) + bytes(21)) if value == 1 else None
        return None

    def _asked(self, number: int, value: int) -> tuple[float, float]:
        """The velocity that a command asks for by itself, before limits; m/s and rad/s."""
        if number == Command.VEL:
            return value / 1000, 0.0
        if number == Command.RVEL:
            return 0.0, math.radians(value)
        left, right = struct.unpack(">bb", struct.pack(">H", value & 0xFFFF))
        return (left + right) / 2 * 0.02, (right - left) / 2 * 20 * self.spec.wheel_turn

    def _move(self, number: int, value: int) -> None:
        """Commands that move; motors that are off take none."""
        if not self.motors_enabled or number not in _MOTIONS:
            return
        point, limits, wheels = self._setpoint, self._limits, self._chassis.wheels()
        point.hard = False
        if number == Command.VEL2:
            speed, turn_rate = self._asked(number, value)
            self._setpoint = _Setpoint(
                _bounded(speed, limits.speed), _bounded(turn_rate, limits.turn_rate), wheels=True
            )
            return
        if point.wheels:
            # The two kinds of velocity exclude each other: the last one wins.
            point = self._setpoint = _Setpoint()
        if number == Command.VEL:
            point.speed, point.way_goal = _bounded(value / 1000, limits.speed), None
        elif number == Command.RVEL:
            rate = _bounded(math.radians(value), limits.turn_rate)
            point.turn_rate, point.heading_goal = rate, None
        elif number == Command.MOVE:
            point.way_goal = (wheels.left_m + wheels.right_m) / 2 + value / 1000
        elif number == Command.HEAD:
            turn = math.radians(value) - (wheels.yaw - self._origin[2])
            point.heading_goal = wheels.yaw + math.remainder(turn, 2 * math.pi)
        else:
            point.heading_goal = wheels.yaw + math.radians(value)

    # ------------------------------------------------------------------ motion

    def _watch(self, now: float) -> None:
        """The watchdog, stalls and goals: what changes the motors without a command."""
        wheels = self._chassis.wheels()
        if now - self._commanded > self._watchdog_s:
            self._timed_out = True
        front, rear = self._touched(wheels)
        bumped = (self._bump_stall & 1 and front) or (self._bump_stall & 2 and rear)
        stalled = self._stalled(wheels)
        if now >= self._relaxed_until:
            self._stall = stalled
            # It relaxes its motors for a while and tries again by itself.
            if (any(stalled) or bumped) and now >= self._relaxed_until + STATUS_S:
                self._relaxed_until = now + _STALL_WAIT_S
        if self.faults.stop_pressed and self._enabled:
            self._disable()
        self._approach(wheels)
        self._drive()

    def _approach(self, wheels: Wheels) -> None:
        """Towards the goals of MOVE, HEAD and DHEAD."""
        point, limits = self._setpoint, self._limits
        if point.way_goal is not None:
            rest = point.way_goal - (wheels.left_m + wheels.right_m) / 2
            if abs(rest) < _NEAR_M:
                point.way_goal, point.speed = None, 0.0
            else:
                fast = min(limits.speed, math.sqrt(limits.deceleration * abs(rest)), abs(rest) * 4)
                point.speed = math.copysign(fast, rest)
        if point.heading_goal is not None:
            rest = point.heading_goal - wheels.yaw
            if abs(rest) < _NEAR_RAD:
                point.heading_goal, point.turn_rate = None, 0.0
            else:
                fast = math.sqrt(limits.turn_deceleration * abs(rest))
                fast = min(limits.turn_rate, fast, abs(rest) * 4)
                point.turn_rate = math.copysign(fast, rest)

    def _drive(self) -> None:
        """Hand the motors what holds now."""
        point, limits = self._setpoint, self._limits
        hard = point.hard
        moves = self._enabled and not self._timed_out and self._now >= self._relaxed_until
        self._chassis.drive(
            Drive(
                point.speed if moves else 0.0,
                point.turn_rate if moves else 0.0,
                limits.acceleration,
                _HARDEST_MPS2 if hard else limits.deceleration,
                limits.turn_acceleration,
                _HARDEST_RADPS2 if hard else limits.turn_deceleration,
                powered=self.motors_enabled,
            )
        )

    def _stalled(self, wheels: Wheels) -> tuple[bool, bool]:
        forced = self.faults.stalled
        return wheels.stalled[0] or forced[0], wheels.stalled[1] or forced[1]

    def _touched(self, wheels: Wheels) -> tuple[int, int]:
        front, rear = self._bumpers
        return (
            (wheels.front_bumpers | self.faults.front_bumpers) & ((1 << front) - 1),
            (wheels.rear_bumpers | self.faults.rear_bumpers) & ((1 << rear) - 1),
        )

    # ------------------------------------------------------------------ what it tells

    def _listen_to_sonar(self, now: float) -> None:
        if not self._sonar_on:
            return
        sonars = len(self.spec.sonars)
        if now - self._next_sonar > _SONAR_S * _ARRAY:
            self._next_sonar = now
        while now >= self._next_sonar:
            for index in range(self._sonar_step, sonars, _ARRAY):
                echo = self._chassis.sonar(index)
                self._echoes[index] = _NO_ECHO_MM if echo is None else round(echo * 1000)
            self._sonar_step = (self._sonar_step + 1) % _ARRAY
            self._next_sonar += _SONAR_S

    def _status(self) -> bytes:
        wheels, faults, spec = self._chassis.wheels(), self.faults, self.spec
        x, y, yaw = self.odometry
        speed, turn = wheels.speed_mps * 1000, wheels.turn_rate_radps / spec.wheel_turn
        front, rear = self._touched(wheels)
        # While its motors are relaxed nothing pushes, and the stall still stands.
        stalled = self._stall if self._now < self._relaxed_until else self._stalled(wheels)
        stall = stalled[0] | stalled[1] << 8 | rear << 1 | front << 9
        if faults.phantom_bumpers:
            stall |= 0xFEFE
        flags = self.motors_enabled | self._sonar_on << 1 | faults.stop_pressed << 5 | faults.flags
        if self._sonar_on and len(spec.sonars) > _ARRAY:
            flags |= 1 << 2
        echoes, self._echoes = self._echoes, {}
        turns = round(math.remainder(yaw, 2 * math.pi) / spec.angle_rad)
        battery = 0 if faults.battery_v is None else round(faults.battery_v * 10)
        return packets.StatusFields(
            moving=abs(wheels.speed_mps) > _STANDS_MPS
            or abs(wheels.turn_rate_radps) > _STANDS_RADPS,
            x=round(x * 1000 / spec.distance_mm),
            y=round(y * 1000 / spec.distance_mm),
            heading=turns,
            left=packets.clamped16((speed - turn) / spec.speed_mmps),
            right=packets.clamped16((speed + turn) / spec.speed_mmps),
            battery_dv=self._battest or battery,
            stall=stall,
            flags=flags,
            sonars=echoes,
            charge_state=faults.charge_state,
            turn_rate=packets.clamped16(math.degrees(wheels.turn_rate_radps) * 10),
            temperature=-127 if faults.temperature_c is None else faults.temperature_c,
            state_of_charge=faults.state_of_charge,
        ).data(short=faults.short_status, overrun=faults.sonar_overrun)

    def _encoders(self) -> bytes:
        wheels = self._chassis.wheels()
        # A wheel of 195 mm.
        per_m = _TICKS_PER_TURN / (math.pi * 0.195)
        ways = (round(way * per_m) for way in (wheels.left_m, wheels.right_m))
        return bytes([packets.ENCODER_REPLY]) + struct.pack("<ii", *ways)

    def _config(self) -> bytes:
        spec, limits = self.spec, self._limits
        return packets.ConfigFields(
            subtype=self._subtype,
            name=self._name,
            serial="0000",
            rot_top=round(math.degrees(spec.turn_rate_max_radps)),
            trans_top=round(spec.speed_max_mps * 1000),
            rot_acc_top=round(math.degrees(_HARDEST_RADPS2)),
            trans_acc_top=round(_HARDEST_MPS2 * 1000),
            host_baud=_BAUDS.index(self.baud),
            front_sonar=bool(spec.sonars),
            rear_sonar=len(spec.sonars) > _ARRAY,
            low_battery_dv=110,
            ticks_per_turn=_TICKS_PER_TURN,
            watchdog_ms=round(self._watchdog_s * 1000),
            stall_count=round(_STALL_WAIT_S / 0.005),
            rot_max=round(math.degrees(limits.turn_rate)),
            trans_max=round(limits.speed * 1000),
            rot_acc=round(math.degrees(limits.turn_acceleration)),
            rot_dec=round(math.degrees(limits.turn_deceleration)),
            trans_acc=round(limits.acceleration * 1000),
            trans_dec=round(limits.deceleration * 1000),
            front_bumpers=self._bumpers[0],
            rear_bumpers=self._bumpers[1],
        ).data()


def _bounded(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
