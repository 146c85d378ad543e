"""A robot of one's own over real TCP: our side, the reference client, and what is between them."""

from __future__ import annotations

import json
import selectors
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from observer.errors import InputError
from observer.robots import external_client, external_link
from observer.robots.contract import Explained, RobotPhase, RobotReport
from observer.robots.external import ExternalRobot, open_external, parse_external
from observer.robots.external_client import ExternalClient, ExternalClientError, demo

KEY = "a-key-of-the-tests-only"


def until(condition: Callable[[], Any], within_s: float = 5.0) -> float:
    """Seconds until it holds; fails if it does not."""
    began = time.monotonic()
    while not condition():
        assert time.monotonic() - began < within_s
        time.sleep(0.001)
    return time.monotonic() - began


def tell(sentence: str) -> None:
    sys.stdout.write(sentence + "\n")


@pytest.fixture
def robot(free_port: int) -> Iterator[ExternalRobot]:
    robot = open_external(f"external:127.0.0.1:{free_port}")
    until(lambda: robot.report().phase is RobotPhase.WAITING)
    yield robot
    robot.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_driver_that_fails_waits_for_nobody(
    free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def failing(*_: object) -> None:
        raise RuntimeError("a mistake in the driver")

    monkeypatch.setattr(external_link.ExternalLink, "_serve", failing)
    robot = open_external(f"external:127.0.0.1:{free_port}")
    until(lambda: robot.report().phase is RobotPhase.REFUSED)
    assert robot.report().trouble == "its driver failed"
    robot.close()


@contextmanager
def reporting(port: int, **more: Any) -> Iterator[ExternalClient]:
    """A client that says every 20 ms how its robot, which stands, is."""
    client = ExternalClient("127.0.0.1", port, **more)
    client.connect()
    ending = threading.Event()

    def run() -> None:
        while not ending.wait(0.02):
            try:
                enabled = not client.permitted().stop
                client.report(0, 0, 0, 0, 0, enabled=enabled, wanted=(0.4, 0.0))
            except ExternalClientError:
                return

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield client
    finally:
        ending.set()
        thread.join()
        client.close()


@contextmanager
def driving(robot: ExternalRobot, client: ExternalClient) -> Iterator[None]:
    """Armed, and 0.3 m/s asked for every 20 ms as the drive loop does."""
    until(lambda: robot.report().received is not None)
    robot.clear()
    robot.enable()
    ending = threading.Event()

    def run() -> None:
        while not ending.wait(0.02):
            robot.drive(0.3, 0.1)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        until(lambda: client.permitted().speed_mps == 0.3)
        yield
    finally:
        ending.set()
        thread.join()


class Wire:
    """Between both sides: passes on what they say, until it is held back or cut."""

    def __init__(self, port: int) -> None:
        self._target = port
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.held = threading.Event()
        self._ending = threading.Event()
        self._pair: tuple[socket.socket, ...] = ()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        near, _ = self._listener.accept()
        far = socket.create_connection(("127.0.0.1", self._target))
        self._pair = (near, far)
        with selectors.DefaultSelector() as selector:
            selector.register(near, selectors.EVENT_READ, far)
            selector.register(far, selectors.EVENT_READ, near)
            while not self._ending.is_set():
                if self.held.is_set():
                    time.sleep(0.002)
                    continue
                for key, _ in selector.select(0.005):
                    try:
                        data = key.fileobj.recv(65536)  # type: ignore[union-attr]
                        if not data:
                            return
                        key.data.sendall(data)
                    except OSError:
                        return

    def reset(self) -> None:
        """Both connections end without a goodbye, as by a crash."""
        self._ending.set()
        self._thread.join()
        for each in self._pair:
            each.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            each.close()

    def close(self) -> None:
        self._ending.set()
        self._thread.join()
        self._listener.close()
        for each in self._pair:
            each.close()


@pytest.fixture
def wire(free_port: int) -> Iterator[Wire]:
    wire = Wire(free_port)
    yield wire
    wire.close()


class RawRobot:
    """Says whatever a test wants."""

    HELLO: dict[str, Any] = {  # noqa: RUF012
        "type": "hello", "protocol": 1, "name": "raw", "limits": external_client.LIMITS,
        "outline": external_client.OUTLINE,
    }  # fmt: skip

    def __init__(self, port: int, **changes: Any) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=5)
        self.file = self.socket.makefile("rb")
        self.say(**{**self.HELLO, **changes})

    def say(self, **message: Any) -> None:
        self.socket.sendall(json.dumps(message).encode() + b"\n")

    def odometry(self, sequence: int, **changes: Any) -> None:
        message = {
            "type": "odometry", "sequence": sequence, "time": time.monotonic(), "x": 0, "y": 0,
            "yaw": 0, "speed_mps": 0, "turn_rate_radps": 0, "enabled": False, "permit": 0,
        }  # fmt: skip
        self.say(**{**message, **changes})

    def next(self) -> dict[str, Any] | None:
        line = self.file.readline()
        return json.loads(line) if line else None

    def last(self) -> dict[str, Any] | None:
        """What was said before the connection ended."""
        last = None
        while (message := self.next()) is not None:
            last = message
        return last

    def close(self) -> None:
        self.file.close()
        self.socket.close()


def test_what_the_robot_says_is_reported_and_what_is_driven_is_permitted(
    robot: ExternalRobot, free_port: int
) -> None:
    with reporting(free_port, name="Robbie") as client:
        until(lambda: robot.report().received is not None)
        report = robot.report()
        assert (report.phase, report.name, report.fault) == (RobotPhase.CONNECTED, "Robbie", None)
        assert (report.radius_m, report.width_m, report.length_m) == (0.3, 0.4, 0.5)
        assert report.limits is not None
        assert report.limits.speed_mps == 0.5
        assert (report.watchdog_s, report.motors_enabled, report.wanted) == (0.25, False, None)
        until(lambda: client.permitted().reason == "not armed")
        with driving(robot, client):
            permit = client.permitted()
            assert (permit.speed_mps, permit.turn_rate_radps, permit.stop) == (0.3, 0.1, False)
            assert robot.drive(7.0, 0.0).speed_mps == 0.5
            until(lambda: robot.report().motors_enabled)
        # Nobody drives on.
        until(lambda: client.permitted().speed_mps == 0)
        assert client.permitted().reason == "nothing says how fast to drive"
        assert not client.permitted().stop
        assert isinstance(robot, Explained)
        robot.explain("1.2 m before an obstacle")
        robot.drive(0.1, 0.0)
        until(lambda: client.permitted().reason == "1.2 m before an obstacle")
        robot.disable()
        until(lambda: client.permitted().stop)


def test_a_guarded_robot_says_what_it_wants(robot: ExternalRobot, free_port: int) -> None:
    with reporting(free_port, guarded=True):
        until(lambda: robot.report().wanted == (0.4, 0.0))


def test_a_stop_arrives_within_50_ms(robot: ExternalRobot, free_port: int) -> None:
    worst = 0.0
    with reporting(free_port) as client:
        for _ in range(20):
            with driving(robot, client):
                robot.stop()
                worst = max(worst, until(lambda: client.permitted().reason == "stopped"))
    tell(f"worst of 20 stops: {1000 * worst:.1f} ms")
    assert worst < 0.05


@pytest.mark.parametrize(
    ("stall_s", "fault"),
    [(0.6, "its odometry has not come for 0.5 s"), (0.4, "its motors went off by themselves")],
)
def test_a_link_that_stalls_stops_the_robot_and_its_recovery_does_not_move_it(
    robot: ExternalRobot, wire: Wire, stall_s: float, fault: str
) -> None:
    with reporting(wire.port) as client, driving(robot, client):
        wire.held.set()
        began = time.monotonic()
        stopped = until(lambda: client.permitted().stop)
        tell(f"stopped {1000 * stopped:.0f} ms after the link stalled")
        # What was said last may be 50 ms old, and on a busy machine be taken in later.
        assert 0.15 < stopped < 0.45
        assert client.permitted().reason == "nothing was permitted for 250 ms"
        time.sleep(max(0.0, began + stall_s - time.monotonic()))
        before = client.permitted().sequence
        wire.held.clear()
        until(lambda: client.permitted().sequence > before)
        deadline = time.monotonic() + 0.5
        while time.monotonic() < deadline:
            assert client.permitted().speed_mps == 0
            time.sleep(0.001)
        # All is well again, and yet it stands until somebody clears and arms it.
        assert client.permitted().reason == robot.report().fault == fault
        robot.clear()
        robot.enable()
        until(lambda: client.permitted().speed_mps == 0.3)


def test_a_robot_that_falls_silent_has_a_fault(robot: ExternalRobot, free_port: int) -> None:
    raw = RawRobot(free_port)
    assert raw.next() == {
        "type": "welcome", "protocol": 1, "interval_ms": 50, "expires_ms": 250,
    }  # fmt: skip
    raw.odometry(1)
    until(lambda: robot.report().motors_enabled is False)
    took = until(lambda: robot.report().fault is not None)
    tell(f"a silent robot has a fault after {1000 * took:.0f} ms")
    assert 0.4 < took < 0.6
    raw.close()


def test_a_link_that_breaks_stops_both_sides(robot: ExternalRobot, wire: Wire) -> None:
    with reporting(wire.port) as client, driving(robot, client):
        wire.reset()
        assert until(lambda: client.permitted().stop) < 0.25
        assert until(lambda: robot.report().fault is not None) < 0.25
        assert not client.connected
        assert robot.report().phase is RobotPhase.WAITING
        with pytest.raises(ExternalClientError, match="the connection"):
            client.report(0, 0, 0, 0, 0, enabled=False)


def test_closing_our_side_stops_the_robot_and_frees_the_port(
    robot: ExternalRobot, free_port: int
) -> None:
    with reporting(free_port) as client, driving(robot, client):
        robot.close()
        assert until(lambda: client.permitted().stop) < 0.25
    robot.close()
    assert robot.report().phase is RobotPhase.CLOSED
    with pytest.raises(ExternalClientError, match="nobody listens"):
        ExternalClient("127.0.0.1", free_port).connect()
    again = open_external(f"external:127.0.0.1:{free_port}")
    until(lambda: again.report().phase is RobotPhase.WAITING)
    with reporting(free_port):
        assert again.report().phase is RobotPhase.CONNECTED
    again.close()


def test_replayed_messages_change_nothing(robot: ExternalRobot, free_port: int) -> None:
    raw = RawRobot(free_port)
    began = time.monotonic()
    for sequence in (1, 2, 3):
        raw.odometry(sequence, x=sequence)
    until(lambda: robot.report().counters["packets"] == 3)
    # Only replays from here on: they are no sign of life.
    while robot.report().fault is None:
        raw.odometry(2, x=50.0, time=began)
        time.sleep(0.02)
        assert time.monotonic() < began + 2
    report = robot.report()
    assert report.fault == "its odometry has not come for 0.5 s"
    assert report.odometry is not None
    assert report.odometry.x == 2
    assert report.counters["bad_packets"] > 5
    raw.close()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (b"GET / HTTP/1.1\r\n\r\n", "one JSON object on one line"),
        (b'{"type": "odometry", "enabled": true, "sequence": NaN}\n', "sequence must be"),
        (b"x" * 5000, "at most 4096 bytes"),
        (2000 * b"[" + b"\n", "one JSON object on one line"),
        (b'{"type": "permit"}\n', '"type": "odometry" is due'),
        (1001 * (json.dumps({"type": "odometry", "sequence": 0, "time": 0, "x": 0, "y": 0,
         "yaw": 0, "speed_mps": 0, "turn_rate_radps": 0, "enabled": False, "permit": 0})
         .encode() + b"\n"), "at most 1000 messages a second"),
    ],
)  # fmt: skip
def test_garbage_ends_the_connection_with_one_sentence(
    robot: ExternalRobot, free_port: int, text: bytes, sentence: str
) -> None:
    raw = RawRobot(free_port)
    raw.odometry(1)
    until(lambda: robot.report().received is not None)
    raw.socket.sendall(text)
    last = raw.last()
    assert last is not None
    assert last["type"] == "refused"
    assert sentence in last["sentence"]
    fault = robot.report().fault
    assert fault is not None
    assert fault.startswith("the robot said what is no message: ")
    assert robot.report().phase is RobotPhase.WAITING
    raw.close()


def test_a_second_robot_is_refused_while_the_first_speaks(
    robot: ExternalRobot, free_port: int
) -> None:
    with reporting(free_port, name="first") as client, driving(robot, client):
        with pytest.raises(ExternalClientError, match="another robot is connected here already"):
            ExternalClient("127.0.0.1", free_port, name="second").connect()
        time.sleep(0.1)
        assert client.permitted().speed_mps == 0.3
        assert robot.report().name == "first"
        assert robot.report().fault is None


def test_a_robot_that_comes_anew_takes_the_place_of_its_silent_connection(
    robot: ExternalRobot, free_port: int
) -> None:
    raw = RawRobot(free_port)
    raw.odometry(1)
    until(lambda: robot.report().fault is not None)
    with reporting(free_port, name="again") as client:
        until(lambda: robot.report().name == "again")
        last = raw.last()
        assert last is not None
        assert last["sentence"] == "another robot took its place"
        assert client.permitted().stop
        with driving(robot, client):
            assert robot.report().counters["reconnects"] == 1
    raw.close()


def test_one_who_does_not_say_hello_is_sent_away(
    robot: ExternalRobot, free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("observer.robots.external_link._HELLO_WITHIN_S", 0.2)
    with socket.create_connection(("127.0.0.1", free_port), timeout=5) as silent:
        assert b"say hello within" in silent.makefile("rb").readline()
    strangers = [socket.create_connection(("127.0.0.1", free_port), timeout=5) for _ in range(8)]
    until(lambda: all(each.recv(1) for each in strangers))
    for each in strangers:
        each.close()
    with reporting(free_port):
        assert robot.report().phase is RobotPhase.CONNECTED


def test_a_key_is_asked_for_where_one_is_set(free_port: int) -> None:
    robot = open_external(f"external:127.0.0.1:{free_port}?key={KEY}")
    until(lambda: robot.report().phase is RobotPhase.WAITING)
    for wrong in (None, "", "wrong", KEY + "x"):
        with pytest.raises(ExternalClientError, match="not the key"):
            ExternalClient("127.0.0.1", free_port, key=wrong).connect()
    assert "not the key" in (robot.report().trouble or "")
    assert KEY not in str(robot.report())
    with reporting(free_port, key=KEY):
        assert robot.report().phase is RobotPhase.CONNECTED
        assert robot.report().trouble is None
    robot.close()


def test_where_to_listen_is_read_strictly() -> None:
    assert parse_external("external:localhost:7700").host == "localhost"
    assert parse_external("external:[::1]:7700").host == "::1"
    open_to_others = parse_external(f"external:0.0.0.0:7700?key={KEY}")
    assert (open_to_others.port, open_to_others.key) == (7700, KEY)
    for text, sentence in (
        ("external:0.0.0.0:7700", "can be reached by others; add a key"),
        ("external:[::]:7700", "can be reached by others; add a key"),
        ("external:robot.lab:7700", "can be reached by others; add a key"),
        ("external:127.0.0.1", "write it as external:127.0.0.1:7700"),
        ("external:127.0.0.1:0", "write it as"),
        ("external:127.0.0.1:70000", "write it as"),
        ("external:127.0.0.1:7700/x", "write it as"),
        ("127.0.0.1:7700", "write it as"),
        ("external:127.0.0.1:7700?key=short", "16 to 128"),
        ("external:127.0.0.1:7700?token=" + KEY, "stands key="),
    ):
        with pytest.raises(InputError, match=sentence) as refused:
            parse_external(text)
        assert KEY not in str(refused.value)
    with pytest.raises(InputError, match="no robot model"):
        open_external("external:127.0.0.1:7700", "tank")


def test_a_port_that_is_taken_is_said_and_tried_again(
    free_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("observer.robots.external_link._RETRY_S", 0.05)
    with socket.create_server(("127.0.0.1", free_port)):
        robot = open_external(f"external:127.0.0.1:{free_port}")
        until(lambda: "nobody can listen" in (robot.report().trouble or ""))
    until(lambda: "no robot has connected" in (robot.report().trouble or ""))
    robot.close()


def test_the_demo_drives_and_comes_back_after_a_loss(
    robot: ExternalRobot, free_port: int, capsys: pytest.CaptureFixture[str]
) -> None:
    client = ExternalClient("127.0.0.1", free_port, name="demo")
    thread = threading.Thread(target=demo, args=(client, 2.5, 0.02))
    thread.start()
    until(lambda: robot.report().received is not None)
    with driving(robot, client):
        until(lambda: (robot.report().speed_mps or 0) > 0.25)
        client.close()
        until(lambda: robot.report().fault is not None)
        until(lambda: robot.report().phase is RobotPhase.CONNECTED)
        # It came back by itself, and stands.
        until(lambda: robot.report().speed_mps == 0)
        assert client.permitted().speed_mps == 0
    thread.join()
    report: RobotReport = robot.report()
    assert report.odometry is not None
    assert report.odometry.x > 0.02
    client.close()
    assert "0.3 m/s" in capsys.readouterr().out


def test_the_reference_client_needs_nothing_but_python(
    robot: ExternalRobot, free_port: int
) -> None:
    file = Path(external_client.__file__)
    # Isolated and without site-packages: nothing of ours can be imported.
    command = [sys.executable, "-I", "-S", str(file), "--demo", "127.0.0.1", str(free_port)]
    with subprocess.Popen(
        [*command, "--name", "alone"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        until(lambda: robot.report().name == "alone")
        process.kill()
        _, err = process.communicate()
    assert err == b""
    until(lambda: robot.report().phase is RobotPhase.WAITING)
    refused = subprocess.run(
        [*command[:-1], "no"], capture_output=True, text=True, timeout=20, check=False
    )
    assert refused.returncode == 2
    assert "no is no port" in refused.stderr
