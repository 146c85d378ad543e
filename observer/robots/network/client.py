"""The robot's side of ``observer.robots.network.robot``, on the standard library alone.

Copy this file to your robot, or write the same in another language:

    client = ExternalClient("192.168.1.10", 7700, name="Robbie", key="...", limits={...},
                            outline={...})
    client.connect()
    while True:
        permit = client.permitted()           # from memory, never waits
        robot.drive(permit.speed_mps, permit.turn_rate_radps, brake=permit.stop)
        client.report(x, y, yaw, speed_mps, turn_rate_radps, enabled=not permit.stop)
        time.sleep(0.05)

``permitted()`` returns zero and ``stop`` as soon as the newest permit is older than 250 ms or the
connection ends, and goes on until a stop was received, so that a recovering link does not set the
robot in motion. Call it often and obey it. ``python -m
observer.robots.network.client --demo HOST PORT`` is a simulated robot that does.
"""

from __future__ import annotations

import argparse
import json
import math
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

PROTOCOL = 1
LONGEST_LINE = 4096
LIMITS = {
    "speed_mps": 0.5,
    "turn_rate_radps": 1.5,
    "acceleration_mps2": 0.5,
    "turn_acceleration_radps2": 3.0,
}
OUTLINE = {"radius_m": 0.3, "width_m": 0.4, "length_m": 0.5}
_ANSWER_WITHIN_S = 3.0
# Until the first permit says otherwise.
_EXPIRES_S = 0.25
# What a line of another protocol raises: JSON may be nested too deeply, and numbers be too large.
_UNREADABLE = (ValueError, KeyError, TypeError, OverflowError, RecursionError)
# Window for the lowest permit delay: the last one or two of these.
_BUCKET_S = 10.0


class ExternalClientError(Exception):
    """The server does not answer or refuses; the message is a sentence."""


@dataclass(frozen=True)
class Permitted:
    """Velocity that the robot may drive at this moment.

    Attributes:
        stop: stop as hard as possible, motors off. reason: in words, usually None.
        sequence: of the permit, 0 before the first.
    """

    speed_mps: float
    turn_rate_radps: float
    stop: bool
    reason: str | None
    sequence: int


class ExternalClient:
    """One robot's connection; its methods may be called from any thread.

    Args:
        limits: speed_mps, turn_rate_radps, acceleration_mps2, turn_acceleration_radps2.
        outline: radius_m (of the turning circle), width_m, length_m.
        guarded: the robot drives by itself and is only limited; it then reports ``wanted``.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        name: str = "robot",
        key: str | None = None,
        limits: Mapping[str, float] = LIMITS,
        outline: Mapping[str, float] = OUTLINE,
        guarded: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._address = (host, port)
        self._hello: dict[str, Any] = {
            "type": "hello",
            "protocol": PROTOCOL,
            "name": name,
            "mode": "guarded" if guarded else "driven",
            "limits": dict(limits),
            "outline": dict(outline),
        }
        if key is not None:
            self._hello["key"] = key
        self._clock = clock
        self._lock = threading.Lock()
        self._sending = threading.Lock()
        self._socket: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._sequence = 0
        # Why the connection has ended; None while it is up.
        self._over: str | None = None
        self._forget("not connected")

    def connect(self) -> None:
        """Connect and send the hello, after closing any earlier connection.

        Raises:
            ExternalClientError: nothing listens there, or the robot is refused, with the reason.
        """
        self.close()
        try:
            connection = socket.create_connection(self._address, timeout=_ANSWER_WITHIN_S)
        except OSError as error:
            raise ExternalClientError(
                f"nothing listens at {self._address[0]}:{self._address[1]} ({error})"
            ) from None
        try:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            connection.sendall(_line(self._hello))
            lines = _Lines(connection)
            answer = lines.next(patient=False)
        except (OSError, *_UNREADABLE) as error:
            connection.close()
            raise ExternalClientError(f"the answer is not from this protocol ({error})") from None
        if answer is None or answer.get("type") != "welcome":
            connection.close()
            sentence = (answer or {}).get("sentence", "the connection was closed")
            raise ExternalClientError(f"the robot was refused: {sentence}")
        # Limits sending: a robot must not block in it while its permits get old.
        connection.settimeout(_EXPIRES_S)
        self._socket = connection
        self._sequence = 0
        self._forget(None, "no permit received yet")
        self._thread = threading.Thread(
            target=self._listen, args=(connection, lines), name="external client", daemon=True
        )
        self._thread.start()

    @property
    def connected(self) -> bool:
        """Return whether the connection is up, as far as is known."""
        return self._socket is not None and self._over is None

    def permitted(self) -> Permitted:
        """Return what the robot may do now; never waits, never raises."""
        with self._lock:
            if self._over is not None:
                return Permitted(0.0, 0.0, True, self._over, self._newest.sequence)
            if self._clock() > self._until:
                reason = f"no permit for {1000 * self._expires_s:.0f} ms"
                return Permitted(0.0, 0.0, True, reason, self._newest.sequence)
            return self._newest

    def report(
        self,
        x: float,
        y: float,
        yaw: float,
        speed_mps: float,
        turn_rate_radps: float,
        *,
        enabled: bool,
        wanted: tuple[float, float] | None = None,
        battery_v: float | None = None,
        fault: str | None = None,
    ) -> None:
        """Report the robot's state; call it ten times a second or more.

        Args:
            x, y, yaw: wheel odometry, metres and radians. enabled: its motors are on.
            wanted: speed and turn rate that a guarded robot would drive.

        Raises:
            ExternalClientError: the connection is lost; ``connect`` opens a new one.
        """
        connection = self._socket
        if connection is None or self._over is not None:
            raise ExternalClientError(self._over or "connect first")
        with self._sending:
            self._sequence += 1
            message: dict[str, Any] = {
                "type": "odometry",
                "sequence": self._sequence,
                "time": self._clock(),
                "x": x,
                "y": y,
                "yaw": yaw,
                "speed_mps": speed_mps,
                "turn_rate_radps": turn_rate_radps,
                "enabled": enabled,
                "permit": self._newest.sequence,
                "battery_v": battery_v,
                "fault": fault,
            }
            if wanted is not None:
                message["wanted"] = {"speed_mps": wanted[0], "turn_rate_radps": wanted[1]}
            try:
                connection.sendall(_line(message))
            except OSError as error:
                # Part of a line may have been sent, so nothing after it could be parsed.
                self._end(f"the connection was lost ({error})")
                raise ExternalClientError(f"the connection was lost ({error})") from None

    def close(self) -> None:
        """Close the connection; nothing is permitted any more."""
        self._end("the connection was closed")
        connection, self._socket = self._socket, None
        thread, self._thread = self._thread, None
        if connection is not None:
            connection.close()
        if thread is not None and thread is not threading.current_thread():
            thread.join(1.0)

    def _forget(self, over: str | None, reason: str | None = None) -> None:
        """Reset the state: why the connection is over, and the reason until a permit comes."""
        with self._lock:
            self._over = over
            self._newest = Permitted(0.0, 0.0, True, reason or over, 0)
            self._until = math.inf
            # Whether a permit expired: until a stop is received, no motion is accepted.
            self._lapsed = False
            self._expires_s = _EXPIRES_S
            # Lowest (arrival - send time), in this bucket and in the one before.
            self._least = self._least_before = math.inf
            self._bucket = -math.inf

    def _end(self, reason: str) -> None:
        with self._lock:
            self._over = self._over or reason
        connection = self._socket
        if connection is not None:
            try:
                connection.shutdown(socket.SHUT_RDWR)
            except OSError:
                # The other side has closed it.
                return

    def _listen(self, connection: socket.socket, lines: _Lines) -> None:
        reason = "the connection was closed by the other side"
        try:
            while (message := lines.next(patient=True)) is not None:
                if message.get("type") == "permit":
                    self._take(message)
                elif message.get("type") == "refused":
                    reason = str(message.get("sentence"))
        except (OSError, *_UNREADABLE) as error:
            reason = f"the connection was lost ({error})"
        # A newer connection keeps its own reason.
        if self._socket is connection:
            self._end(reason)

    def _take(self, message: dict[str, Any]) -> None:
        now = self._clock()
        speed, rate = float(message["speed_mps"]), float(message["turn_rate_radps"])
        sequence, said = int(message["sequence"]), float(message["time"])
        expires_s = float(message["expires_ms"]) / 1000
        if not all(map(math.isfinite, (speed, rate, said, expires_s))):
            raise ValueError("the numbers of a permit must be finite")
        with self._lock:
            if sequence <= self._newest.sequence:
                return
            if now - self._bucket > _BUCKET_S:
                self._least_before, self._least, self._bucket = self._least, math.inf, now
            self._least = min(self._least, now - said)
            # Send time on our clock, estimated from the permits with the lowest delay.
            said_here = said + min(self._least, self._least_before)
            reason = message.get("reason")
            stop = message["stop"] is not False
            self._lapsed = not stop and (
                self._lapsed or (now > self._until and not self._newest.stop)
            )
            if self._lapsed:
                stop, reason = True, "permits arrived too late; a stop must be received first"
            self._newest = Permitted(
                0.0 if stop else speed,
                0.0 if stop else rate,
                stop,
                None if reason is None else str(reason),
                sequence,
            )
            self._expires_s = expires_s
            self._until = said_here + expires_s


class _Lines:
    """Reader of JSON objects, one per line."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._rest = b""

    def next(self, *, patient: bool) -> dict[str, Any] | None:
        """Return the next one, waiting forever if ``patient``; None at the connection's end."""
        while b"\n" not in self._rest:
            if len(self._rest) > LONGEST_LINE:
                raise ValueError("a line exceeds the maximum message length")
            try:
                data = self._connection.recv(LONGEST_LINE)
            except TimeoutError:
                # Silence is judged by ``permitted``, not here.
                if patient:
                    continue
                raise
            if not data:
                return None
            self._rest += data
        line, _, self._rest = self._rest.partition(b"\n")
        message = json.loads(line)
        if not isinstance(message, dict):
            raise ValueError("a message must be an object")
        return message


def _line(message: Mapping[str, Any]) -> bytes:
    return json.dumps(message, allow_nan=False).encode() + b"\n"


class DemoRobot:
    """A simulated robot: follows the permitted velocity within its acceleration, brakes harder.

    Attributes:
        x, y, yaw, speed, turn_rate: in metres, radians and seconds.
    """

    def __init__(self) -> None:
        self.x = self.y = self.yaw = self.speed = self.turn_rate = 0.0

    def step(self, permit: Permitted, dt: float) -> None:
        """Drive for ``dt`` seconds as permitted."""
        slower = abs(permit.speed_mps) < abs(self.speed)
        # m/s^2: it brakes harder than it accelerates.
        most = dt * (2.0 if slower or permit.stop else LIMITS["acceleration_mps2"])
        self.speed += max(-most, min(most, permit.speed_mps - self.speed))
        self.turn_rate = permit.turn_rate_radps
        self.yaw += self.turn_rate * dt
        self.x += self.speed * dt * math.cos(self.yaw)
        self.y += self.speed * dt * math.sin(self.yaw)


def demo(client: ExternalClient, seconds: float = math.inf, period_s: float = 0.05) -> None:
    """Act as a simulated robot, and reconnect whenever the connection is lost."""
    robot = DemoRobot()
    printed: str | None = None
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        permit = client.permitted()
        robot.step(permit, period_s)
        line = f"{robot.speed:.1f} m/s" if permit.reason is None else permit.reason
        if line != printed:
            printed = line
            print(f"x {robot.x:.2f} y {robot.y:.2f}: {line}", flush=True)  # noqa: T201
        try:
            if not client.connected:
                client.connect()
            state = robot.x, robot.y, robot.yaw, robot.speed, robot.turn_rate
            client.report(*state, enabled=not client.permitted().stop)
        except ExternalClientError as error:
            if str(error) != printed:
                printed = str(error)
                print(printed, file=sys.stderr, flush=True)  # noqa: T201
            time.sleep(0.5)
        time.sleep(period_s)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run ``--demo HOST PORT [--key KEY] [--seconds S]``."""
    parser = argparse.ArgumentParser(description="A simulated robot that connects by itself.")
    parser.add_argument("--demo", nargs=2, metavar=("HOST", "PORT"), required=True)
    parser.add_argument("--key", help="key required by the other side")
    parser.add_argument("--name", default="demo robot")
    parser.add_argument("--seconds", type=float, default=math.inf)
    given = parser.parse_args(arguments)
    host, port = given.demo
    if not port.isdecimal() or not 1 <= int(port) <= 65535:
        parser.error(f"{port} is not a port; give a number from 1 to 65535")
    client = ExternalClient(host, int(port), name=given.name, key=given.key)
    try:
        demo(client, given.seconds)
    except KeyboardInterrupt:
        parser.exit(130)
    finally:
        client.close()


if __name__ == "__main__":
    main()
