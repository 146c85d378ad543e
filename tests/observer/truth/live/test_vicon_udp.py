"""Vicon's datagrams on a real port."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from observer.truth.files.units import MOST_METRES
from observer.truth.live import heard, intake, stamps
from observer.truth.live.contract import LiveCaptureReport
from observer.truth.live.heard import LiveCapture
from observer.truth.live.opening import open_live_truth
from observer.truth.live.vicon_stream import ViconObject

from .mishaps import Mishaps, Stream
from .test_vrpn_client import circling, samples, until
from .vicon_sender import ViconSender, pack_frame


@pytest.fixture(autouse=True)
def _soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stamps, "_TICKS_SPAN_S", 1.0)
    monkeypatch.setattr(intake, "_QUIET_S", 0.5)


@pytest.fixture
def udp_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


@contextlib.contextmanager
def capturing(port: int) -> Iterator[LiveCapture]:
    capture = open_live_truth(f"vicon-udp:{port}")
    try:
        yield capture
    finally:
        capture.close()


@contextlib.contextmanager
def streaming(port: int, mishaps: Mishaps | None = None) -> Iterator[ViconSender]:
    sender = ViconSender(port)
    stream = Stream(circling, sender.send, mishaps or Mishaps(), noise_m=1e-6)
    try:
        yield sender
    finally:
        stream.stop()
        sender.stop()


def noted(words: str) -> Callable[[LiveCaptureReport], bool]:
    return lambda report: words in " ".join(report.notes)


def test_objects_arrive_in_metres_with_times_from_frame_numbers(udp_port: int) -> None:
    with capturing(udp_port) as capture, streaming(udp_port):
        collected = samples(capture, 40)
        report = until(capture, lambda r: r.clock)
    assert report.state == "receiving"
    assert not report.notes
    assert {each.name for each in collected} == {"Robot", "Cart/2"}
    for each in collected:
        assert each.position is not None
        assert each.rotation is not None
        if each.name == "Robot":
            # It faces away from the origin.
            x, y = each.rotation[:2, 0]
            assert each.position == pytest.approx([x, y, 0.2], abs=1e-4)
            assert each.rotation @ [0, 0, 1] == pytest.approx([0, 0, 1])
        else:
            assert each.position[[0, 2]] == pytest.approx([2, 0.1], abs=1e-4)
            assert each.rotation == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]))
    robot = [each.time for each in collected if each.name == "Robot"]
    # At 100 Hz, each lost datagram is a missing frame.
    assert np.diff(robot) == pytest.approx(0.01 * np.round(np.diff(robot) / 0.01))


def test_silence_is_reported_and_reception_resumes(udp_port: int) -> None:
    with capturing(udp_port) as capture:
        quiet = until(capture, lambda r: r.state == "waiting" and r.trouble)
        assert "no poses received" in str(quiet.trouble)
        mishaps = Mishaps()
        with streaming(udp_port, mishaps):
            samples(capture, 40)
            mishaps.unseen = 1.0
            time.sleep(0.1)
            capture.drain()
            assert all(each.position is None for each in samples(capture, 20))


def test_garbage_is_counted_and_a_second_sender_is_noted(udp_port: int) -> None:
    with capturing(udp_port) as capture, streaming(udp_port) as sender:
        samples(capture, 20)
        sender.raw(b"\x01\x02")
        sender.raw(bytes(4) + b"\xff" + bytes(3))
        until(capture, lambda r: r.malformed == 2)
        other = ViconSender(udp_port)
        other.raw(b"\x01\0\0\0\0")
        until(capture, noted("also sends to this port"))
        other.stop()
        samples(capture, 20)


def test_absurd_numbers_become_gaps_or_are_noted(udp_port: int) -> None:
    with capturing(udp_port) as capture:
        sender = ViconSender(udp_port)
        wild = (float("nan"), float("inf"), -1e308, 1e308, 5e-324, 0.0)
        tame = ViconObject("Tame", (1.0, 2.0, 3.0), (0.0, 0.0, 0.0))
        for number in range(120):
            x, y = wild[number % 6], wild[number // 6 % 6]
            objects = [ViconObject("Wild", (x, y, 1.0), (y, x, 0.0)), tame]
            sender.raw(pack_frame(number, objects))
            time.sleep(0.01)
        collected = samples(capture, 160)
        until(capture, noted("too far for a room"))
        sender.stop()
    seen = [each.position is not None for each in collected if each.name == "Tame"]
    assert seen == [True] + [False] * (len(seen) - 1)
    for each in collected:
        if each.position is not None:
            assert np.abs(each.position).max() <= MOST_METRES
        if each.rotation is not None:
            assert np.isfinite(each.rotation).all()


def test_tracker_restart_continues_the_time_line(udp_port: int) -> None:
    with capturing(udp_port) as capture, streaming(udp_port) as sender:
        sender.frames_behind = 100_000
        before = samples(capture, 20)
        sender.frames_behind = 0
        until(capture, noted("jumped back"))
        after = samples(capture, 20)
        assert 0 < after[-1].time - before[-1].time < 10


def test_occupied_port_is_reported_and_retried(
    udp_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(heard, "_RETRY_S", 0.05)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", udp_port))
        capture = open_live_truth(f"vicon-udp:{udp_port}")
        report = until(capture, lambda r: "cannot listen on" in (r.trouble or ""))
        assert report.state == "connecting"
    until(capture, lambda r: r.state == "waiting")
    capture.close()
    assert capture.report().state == "connecting"
