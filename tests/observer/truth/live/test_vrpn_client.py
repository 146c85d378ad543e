"""A VRPN server over real TCP, healthy and faulty."""

from __future__ import annotations

import contextlib
import errno
import socket
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from observer.geometry import Pose
from observer.truth.live import heard, intake, stamps, vrpn_client
from observer.truth.live.contract import LiveCaptureReport
from observer.truth.live.heard import LiveCapture
from observer.truth.live.opening import open_live_truth
from observer.truth.live.vrpn import POSE_TYPE
from observer.truth.motion_capture import BodySample

from .... import waiting
from .mishaps import Mishaps, Poses, Stream
from .vrpn_server import VrpnServer, deaf_host, pose_body

_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def circling(now: float) -> dict[str, Pose | None]:
    """Return two bodies, one turned by 90 degrees."""
    c, s = float(np.cos(now)), float(np.sin(now))
    return {
        "Robot": Pose(np.array([[c, -s, 0.0], [s, c, 0.0], [0, 0, 1.0]]), np.array([c, s, 0.2])),
        "Cart/2": Pose(_TURN, np.array([2.0, s, 0.1])),
    }


@contextlib.contextmanager
def streaming(
    server: VrpnServer, mishaps: Mishaps | None = None, poses: Poses = circling, **more: Any
) -> Iterator[Mishaps]:
    mishaps = mishaps or Mishaps()
    stream = Stream(poses, server.send, mishaps, **more)
    try:
        yield mishaps
    finally:
        stream.stop()


@contextlib.contextmanager
def serving(**more: Any) -> Iterator[VrpnServer]:
    server = VrpnServer(["Robot", "Cart"], **more)
    try:
        yield server
    finally:
        server.stop()


@contextlib.contextmanager
def capturing(port: int, rest: str = "") -> Iterator[LiveCapture]:
    capture = open_live_truth(f"vrpn:127.0.0.1:{port}{rest}")
    try:
        yield capture
    finally:
        capture.close()


def until(
    capture: LiveCapture, reached: Callable[[LiveCaptureReport], object], within_s: float = 8.0
) -> LiveCaptureReport:
    return waiting.until(capture.report, within_s=within_s, accept=reached)


def samples(capture: LiveCapture, count: int, within_s: float = 8.0) -> list[BodySample]:
    found: list[BodySample] = []
    end = time.monotonic() + within_s
    while len(found) < count:
        found += capture.drain()
        assert time.monotonic() < end, capture.report()
        time.sleep(0.005)
    return found


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heard, "_RETRY_S", 0.1)
    monkeypatch.setattr(stamps, "_SECONDS_SPAN_S", 0.2)


@pytest.mark.parametrize("piece", [None, 7])
def test_every_sensor_of_every_sender_arrives_with_its_pose(piece: int | None) -> None:
    planted = Mishaps(offset_s=1.7e9)
    with serving(piece=piece) as server, streaming(server, planted, noise_m=1e-9):
        with capturing(server.port) as capture:
            collected = samples(capture, 80)
            report = capture.report()
        assert server.cookies == [b"vrpn: ver. 07.35  0\0\0\0\0\0"]
    assert {each.name for each in collected} == {"Robot", "Cart/2"}
    for each in collected:
        expected = circling(each.time - planted.offset_s)[each.name]
        assert expected is not None
        assert each.position is not None
        assert each.rotation is not None
        # Stamps have microsecond resolution.
        assert each.position == pytest.approx(expected.translation, abs=1e-5)
        assert each.rotation == pytest.approx(expected.rotation, abs=1e-5)
        assert 0 <= each.received + planted.offset_s - each.time < 1
    assert report.state == "receiving"
    assert report.trouble is None
    assert not report.notes
    assert report.rate_hz["Robot"] == pytest.approx(100, rel=0.4)
    assert report.seen == {"Robot": 1.0, "Cart/2": 1.0}


def test_only_requested_bodies_are_received() -> None:
    with serving() as server, streaming(server):
        with capturing(server.port, "/Cart") as capture:
            assert {each.name for each in samples(capture, 30)} == {"Cart/2"}
        with capturing(server.port, "/Robot,Cart/2") as capture:
            assert {each.name for each in samples(capture, 30)} == {"Robot", "Cart/2"}


def test_clock_is_estimated_over_a_jittering_network() -> None:
    planted = Mishaps(offset_s=1.7e9, delay_s=0.005, jitter_s=0.003)
    with serving() as server, streaming(server, planted), capturing(server.port) as capture:
        fit = until(capture, lambda r: r.clock and r.clock.span_s > 1.0).clock
        assert fit is not None
        now = time.monotonic()
        # The offset includes the smallest delay.
        assert fit.to_host(now + planted.offset_s) - now == pytest.approx(0.005, abs=0.004)


def test_preempted_thread_does_not_date_samples_into_the_future(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Other threads run between learning that there is data and having read it."""
    read, pauses = (
        vrpn_client.VrpnCapture._receive,
        iter(np.random.default_rng(3).exponential(0.02, 10_000).tolist()),
    )

    def preempted(self: vrpn_client.VrpnCapture, connection: socket.socket) -> bytes:
        pause = next(pauses)
        if pause > 0.02:
            time.sleep(pause)
        return read(self, connection)

    monkeypatch.setattr(vrpn_client.VrpnCapture, "_receive", preempted)
    planted = Mishaps(offset_s=1.7e9)
    with (
        serving() as server,
        streaming(server, planted, rate_hz=200.0),
        capturing(server.port) as capture,
    ):
        report = until(capture, lambda r: r.clock and r.clock.span_s > 3.0)
    assert report.clock is not None
    now = time.monotonic()
    late = report.clock.to_host(now + planted.offset_s) - now
    assert 0 <= late < 0.005
    assert report.clock.sigma_s < 0.005
    assert report.notes == ()


@pytest.mark.parametrize("fault", ["unseen", "repeat"])
def test_drop_outs_are_gaps(fault: str) -> None:
    with serving() as server, streaming(server) as mishaps, capturing(server.port) as capture:
        samples(capture, 40)
        if fault == "unseen":
            mishaps.unseen = 1.0
        else:
            mishaps.repeat = True
        time.sleep(0.1)
        capture.drain()
        gap = samples(capture, 40)
        assert all(each.position is None and each.rotation is None for each in gap)
        mishaps.unseen, mishaps.repeat = 0.0, False
        time.sleep(0.1)
        capture.drain()
        assert all(each.position is not None for each in samples(capture, 40))


@pytest.mark.parametrize("step_s", [0.0, 5.0, -5.0])
def test_a_tracker_that_returns_after_silence_is_followed(step_s: float) -> None:
    planted = Mishaps(offset_s=1.7e9)
    with serving() as server, streaming(server, planted), capturing(server.port) as capture:
        before = samples(capture, 200)
        planted.drop = 1.0
        report = until(capture, lambda r: r.state == "waiting")
        assert "no poses received" in (report.trouble or "")
        time.sleep(0.5)
        # As when its computer's clock is corrected in the meantime.
        planted.offset_s += step_s
        before += capture.drain()
        planted.drop = 0.0
        after = samples(capture, 200)
        report = capture.report()
    assert report.connections == 1
    assert report.trouble is None
    assert [note.split(" by ")[0] for note in report.notes] == (
        [f"the server's clock jumped {'ahead' if step_s > 0 else 'back'}"] if step_s else []
    )
    for name in ("Robot", "Cart/2"):
        times = [each.time for each in before + after if each.name == name]
        assert (np.diff(times) > 0).all()
    # The time line goes on as if the clock had not been set.
    delays = [each.received - each.time for each in before + after]
    assert np.ptp([min(delays[: len(before)]), min(delays[len(before) :])]) < 0.02


def test_lost_connection_is_reported_and_reestablished() -> None:
    with serving() as server, streaming(server), capturing(server.port) as capture:
        samples(capture, 40)
        server.drop_clients()
        until(capture, lambda r: r.connections == 2 and r.state == "receiving")
        later = samples(capture, 40)
        for name in ("Robot", "Cart/2"):
            assert (np.diff([each.time for each in later if each.name == name]) > 0).all()
        port = server.port
        server.stop()
        lost = until(capture, lambda r: r.state == "connecting" and "listens" in (r.trouble or ""))
        assert f"127.0.0.1:{port}" in str(lost.trouble)
        # Restarted, with a clock that begins at 0.
        again = VrpnServer(["Robot", "Cart"], port=port)
        try:
            with streaming(again, Mishaps(offset_s=-time.monotonic())):
                report = until(capture, lambda r: "different" in " ".join(r.notes))
                assert report.connections == 3
                newest = samples(capture, 40)
                assert newest[-1].time > later[-1].time
        finally:
            again.stop()


def test_dead_host_does_not_block_the_caller(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vrpn_client, "_CONNECT_WITHIN_S", 0.2)
    with deaf_host() as port:
        began = time.monotonic()
        capture = open_live_truth(f"vrpn:127.0.0.1:{port}")
        assert capture.drain() == ()
        assert capture.report().state == "connecting"
        assert time.monotonic() - began < 0.2
        until(capture, lambda r: "answer within" in (r.trouble or ""))
        began = time.monotonic()
        capture.close()
        capture.close()
        assert time.monotonic() - began < 0.5


def test_connection_failures_are_distinguished() -> None:
    with serving(cookie=b"vrpn: ver. 06.04  0") as server, capturing(server.port) as capture:
        report = until(capture, lambda r: "06.04" in (r.trouble or ""))
        assert "07 is needed" in str(report.trouble)
    with serving(cookie=b"HTTP/1.1 400 Bad Request") as server, capturing(server.port) as capture:
        until(capture, lambda r: "not a VRPN server" in (r.trouble or ""))
    with serving(cookie=b"vrpn: ver. 07.33  0") as server, capturing(server.port) as capture:
        report = until(capture, lambda r: r.state == "waiting")
        assert "07.33" in report.notes[0]
    capture = open_live_truth("vrpn:no-such-host.invalid")
    until(capture, lambda r: "name is known" in (r.trouble or ""))
    capture.close()


def test_address_without_a_socket_is_skipped(monkeypatch: pytest.MonkeyPatch) -> None:
    found, opened = socket.getaddrinfo, socket.socket

    def two(host: str, port: int, **more: Any) -> Any:
        known = found(host, port, **more)
        return [(socket.AF_INET6, *known[0][1:]), *known]

    def unsupported(family: int = -1, *more: Any, **named: Any) -> socket.socket:
        if family == socket.AF_INET6:
            raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")
        return opened(family, *more, **named)

    with serving() as server, streaming(server):
        monkeypatch.setattr(socket, "getaddrinfo", two)
        monkeypatch.setattr(socket, "socket", unsupported)
        with capturing(server.port) as capture:
            samples(capture, 4)
            assert capture.report().trouble is None


@pytest.mark.parametrize("at", ["socket", "wait"])
def test_shortage_of_open_files_is_reported_and_the_next_connection_works(
    monkeypatch: pytest.MonkeyPatch, at: str
) -> None:
    refused = threading.Event()

    def once(do: Callable[..., Any]) -> Callable[..., Any]:
        def done(*some: Any, **named: Any) -> Any:
            listening = threading.current_thread().name.startswith("vrpn 127.0.0.1")
            if listening and not refused.is_set():
                refused.set()
                raise OSError(errno.EMFILE, "Too many open files")
            return do(*some, **named)

        return done

    with serving() as server, streaming(server), monkeypatch.context() as patched:
        patched.setattr(heard, "_RETRY_S", 1.0)
        if at == "socket":
            patched.setattr(socket, "socket", once(socket.socket))
        else:
            patched.setattr(heard.Wakeup, "wait", once(heard.Wakeup.wait))
        with capturing(server.port) as capture:
            until(
                capture,
                lambda r: (r.trouble or "").endswith("cannot be used: too many open files"),
            )
            samples(capture, 4)


def test_silent_listener_is_abandoned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vrpn_client, "_COOKIE_WITHIN_S", 0.2)
    silent = socket.create_server(("127.0.0.1", 0))
    with silent, capturing(silent.getsockname()[1]) as capture:
        until(capture, lambda r: "did not identify itself" in (r.trouble or ""))


def test_garbage_ends_the_connection_and_the_next_one_works() -> None:
    with serving() as server, streaming(server), capturing(server.port) as capture:
        samples(capture, 30)
        server.raw(b"\xff" * 100)
        report = until(capture, lambda r: r.connections == 2 and r.state == "receiving")
        assert report.malformed >= 1
        samples(capture, 30)


def test_silent_server_is_pinged_and_then_abandoned(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(vrpn_client, "_ASK_AFTER_S", 0.1)
    monkeypatch.setattr(vrpn_client, "_ASK_EVERY_S", 0.1)
    monkeypatch.setattr(vrpn_client, "_GIVE_UP_AFTER_S", 0.6)
    monkeypatch.setattr(intake, "_QUIET_S", 0.2)
    with serving() as server, capturing(server.port) as capture:
        report = until(capture, lambda r: r.state == "waiting" and r.trouble)
        assert "no poses received" in str(report.trouble)
        time.sleep(0.8)
        # Its answers show that it is alive.
        assert capture.report().connections == 1
        assert "Robot" in server.pinged
        server.answers = False
        until(capture, lambda r: r.connections > 1)


def test_ping_is_answered() -> None:
    with serving() as server, capturing(server.port) as capture:
        until(capture, lambda r: r.state == "waiting")
        end = time.monotonic() + 5
        while not server.clients:
            assert time.monotonic() < end
            time.sleep(0.005)
        server.say("vrpn_Base ping_message", "Cart", time.time())
        while not server.ponged:
            assert time.monotonic() < end
            time.sleep(0.005)
        assert server.ponged == ["Cart"]


def test_millimetres_are_noted() -> None:
    planted = Mishaps(millimetres=True)
    with serving() as server, streaming(server, planted), capturing(server.port) as capture:
        until(capture, lambda r: "set it to m" in " ".join(r.notes))


def test_ticks_are_noted_and_converted_to_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stamps, "_TICKS_SPAN_S", 1.0)
    planted = Mishaps(tick_hz=1e6)
    with serving() as server, streaming(server, planted), capturing(server.port) as capture:
        collected = samples(capture, 40)
        assert "ticks, 1e+06 per second" in capture.report().notes[0]
        sent = [planted.stamp(each.received) / 1e6 for each in collected]
        assert collected[30].time - collected[0].time == pytest.approx(sent[30] - sent[0], abs=0.3)


def test_clock_step_is_noted() -> None:
    with serving() as server, streaming(server) as mishaps, capturing(server.port) as capture:
        before = samples(capture, 40)[-1]
        mishaps.offset_s += 3600
        until(capture, lambda r: "jumped ahead by 3.6e+03 s" in " ".join(r.notes))
        capture.drain()
        after = samples(capture, 20)[-1]
        assert 0 < after.time - before.time < 8


def test_undrained_samples_are_counted_and_the_newest_retained(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(intake, "MOST_KEPT", 50)
    with serving() as server, streaming(server), capturing(server.port) as capture:
        until(capture, lambda r: r.dropped > 50)
        kept = capture.drain()
        assert len(kept) == 50
        assert time.monotonic() - kept[-1].received < 0.5


def test_invalid_rotation_leaves_the_position() -> None:
    with serving() as server, capturing(server.port) as capture:
        until(capture, lambda r: r.state == "waiting")
        while not server.clients:
            time.sleep(0.005)
        for number in range(80):
            server.say(
                POSE_TYPE, "Robot", time.time(), pose_body(0, (1.0, 2.0, number + 1.0, 0, 0, 0, 0))
            )
            time.sleep(0.01)
        collected = samples(capture, 10)
    assert collected[0].rotation is None
    assert collected[0].position == pytest.approx([1, 2, 1])
