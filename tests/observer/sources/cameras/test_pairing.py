"""Which images form a pair, and which frames are fresh: with arrays and numbers only."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from observer.sources.cameras.capture import is_monotonic_stamp
from observer.sources.cameras.freshness import Backlog, Lag, Period, Repeats
from observer.sources.cameras.messages import (
    Failed,
    Grabbed,
    Open,
    Opened,
    decode_command,
    decode_notice,
    encode,
)
from observer.sources.cameras.pairing import Skews, judge
from observer.sources.cameras.settings import CameraSettings
from observer.sources.cameras.usb import bandwidth_hints

T = 1 / 30


def test_half_a_frame_is_the_limit() -> None:
    assert judge(1.0, 1.0 + 0.5 * T - 1e-9, T) == "pair"
    assert judge(1.0 + 0.5 * T - 1e-9, 1.0, T) == "pair"
    assert judge(1.0, 1.0 + 0.51 * T, T) == "drop left"
    assert judge(1.0 + 0.51 * T, 1.0, T) == "drop right"


def test_the_skew_covers_only_the_last_seconds() -> None:
    skews = Skews()
    for index in range(9):
        skews.add(index * T, 0.001)
    assert skews.median_and_p95() == (None, None)
    for index in range(101):
        skews.add(100.0 + index * T, -0.0001 * index)
    median, p95 = skews.median_and_p95()
    assert median == pytest.approx(0.005)
    assert p95 == pytest.approx(0.0095)


def test_the_period_is_measured_even_after_an_interruption() -> None:
    period = Period(60.0)
    assert period.seconds == pytest.approx(1 / 60)
    for index in range(9):
        period.add(5.0 + index * T)
    assert period.measured
    assert not period.settled
    assert period.seconds == pytest.approx(T)
    period.interrupt()
    period.add(50.0)
    for index in range(1, 24):
        period.add(50.0 + index * T)
    assert period.settled
    assert period.seconds == pytest.approx(T)
    assert Period().seconds == pytest.approx(T)


def test_frames_delayed_by_a_stall_are_old() -> None:
    backlog = Backlog()
    # Frames buffered while the stream was opened.
    assert [backlog.holds(0.001 * index, T) for index in range(4)] == [True] * 4
    at_pace = [backlog.holds(0.003 + T * (1 + index), T) for index in range(10)]
    assert not any(at_pace)
    # One late frame is not a stall; two lost ones are.
    assert not backlog.holds(0.003 + T * 12.2, T)
    burst = 0.003 + T * 16
    assert [backlog.holds(burst + 0.001 * index, T) for index in range(4)] == [True] * 4
    assert not backlog.holds(burst + 0.003 + 0.9 * T, T)


@pytest.mark.parametrize("decoded_hz", [40.0, 60.0, 90.0, 200.0])
@pytest.mark.parametrize("stall_s", [0.5, 0.8, 2.0, 5.0])
def test_a_queue_that_drains_slowly_is_old_to_its_end(decoded_hz: float, stall_s: float) -> None:
    backlog, period, free, fresh = Backlog(), Period(), 0.0, []
    for index in range(900):
        made = index * T
        arrival = max(5.0 + stall_s if 5.0 <= made < 5.0 + stall_s else made, free)
        free = arrival + 1 / decoded_hz
        if not backlog.holds(arrival, period.seconds):
            fresh.append(arrival - made)
        if backlog.drains:
            period.interrupt()
        period.add(arrival)
    assert max(fresh) < 0.12
    # At the camera's pace again, every frame is accepted.
    assert len(fresh) > 900 - 30 * stall_s * decoded_hz / (decoded_hz - 30) - 10


def test_frames_at_pace_are_new_although_a_stall_may_have_queued_more() -> None:
    backlog = Backlog()
    for index in range(30):
        backlog.holds(T * index, T)
    # The network lost what came in two seconds.
    held = [backlog.holds(3.0 + T * index, T) for index in range(30)]
    assert held[0]
    assert not any(held[6:])


@pytest.mark.parametrize("pace", [1.0, 1.05, 1.1, 2.0])
@pytest.mark.parametrize("start", [0.0, -7000.0, 1.7e9])
def test_timestamps_tell_the_age_of_a_queue_that_drains_at_any_pace(
    pace: float, start: float
) -> None:
    lag, free = Lag(), 0.0
    fresh: list[float] = []
    old: list[float] = []
    for index in range(1500):
        made = index * T
        arrival = max(10.8 if 10.0 <= made < 10.8 else made, free)
        free = arrival + T / pace if made >= 10.0 else arrival
        # The camera's clock runs a little too fast.
        held = lag.holds(arrival + 0.01 * (index % 2), start + made * 1.0001, T)
        (old if held else fresh).append(arrival - made)
    assert max(fresh) < 0.13
    assert min(old) > 0.08
    assert len(old) > 8


def test_another_clock_of_the_timestamps_makes_no_frame_old() -> None:
    lag, held = Lag(), []
    for index in range(400):
        # The camera restarts its clock, then sets it ahead.
        sent = T * index - (5.0 if index >= 100 else 0.0) + (3.0 if index >= 200 else 0.0)
        held.append(lag.holds(T * index, sent, T))
    assert not any(held)
    # A step back of the clock by hours and one ahead, both beyond what a queue explains.
    assert not lag.holds(400 * T, -9000.0, T)
    assert not lag.holds(401 * T, 9000.0, T)


def test_a_camera_slower_than_assumed_is_accepted_once_its_period_is_measured() -> None:
    backlog, period, held = Backlog(), Period(), []
    for index in range(40):
        held.append(backlog.holds(0.1 * index, period.seconds))
        if backlog.drains:
            period.interrupt()
        period.add(0.1 * index)
    assert period.seconds == pytest.approx(0.1)
    assert not any(held[20:])


def test_a_constantly_bursty_stream_is_eventually_accepted() -> None:
    backlog = Backlog()
    held = [backlog.holds(0.01 * index, T) for index in range(300)]
    assert all(held[:100])
    assert not held[-1]


def test_only_stamps_of_the_hosts_clock_are_accepted() -> None:
    now = 46_000.0
    assert is_monotonic_stamp(now - 0.03, now)
    assert is_monotonic_stamp(now, now)
    for other in (0.0, now - 3.0, now + 0.1, 1.7e9, -1.0):
        assert not is_monotonic_stamp(other, now)


def test_repeated_images_are_counted_but_not_dark_ones() -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (48, 64, 3)).astype(np.uint8)
    repeats = Repeats()
    assert [repeats.add(image.copy()) for _ in range(4)] == [0, 1, 2, 3]
    other = image.copy()
    other[20, 3, 1] ^= 1
    assert repeats.add(other) == 0
    assert repeats.add(other) == 1
    for level in (0, 255):
        flat = np.full((48, 64), level, np.uint8)
        assert [repeats.add(flat) for _ in range(4)] == [0, 0, 0, 0]


def test_messages_round_trip_and_notices_fit_into_an_atomic_write() -> None:
    asked = CameraSettings(size=(640, 480), exposure="auto", power_line_hz=50)
    opening = Open("rtsp://a:b@c/d", asked, "module:function")
    back = decode_command(encode(opening).rstrip(b"\n"))
    assert isinstance(back, Open)
    assert back.settings == asked
    opened = Opened(640, 480, 3, None, {"size": "640x480"}, ("gain 7 is not offered",))
    assert decode_notice(encode(opened)) == opened
    grabbed = Grabbed(2**53, *[123456.123456789] * 4)
    assert decode_notice(encode(grabbed)) == grabbed
    assert len(encode(grabbed)) <= 512
    assert decode_notice(encode(Failed("has stopped\nsending", alive=False))) == Failed(
        "has stopped\nsending", alive=False
    )
    assert encode(Failed("a\nb", alive=True)).count(b"\n") == 1


def _plug_in(root: Path, node: str, bus: int, port: str, speed: str) -> str:
    """Add a video device to a fake file system, as the kernel shows it."""
    usb = root / f"sys/devices/pci0000:00/0000:00:14.0/usb{bus}/{port}"
    interface = usb / f"{port}:1.0"
    interface.mkdir(parents=True)
    (usb / "busnum").write_text(f"{bus}\n")
    (usb / "speed").write_text(f"{speed}\n")
    shown = root / f"sys/class/video4linux/{node}"
    shown.mkdir(parents=True)
    (shown / "device").symlink_to(interface)
    (root / "dev").mkdir(exist_ok=True)
    (root / "dev" / node).touch()
    return f"/dev/{node}"


def test_a_hint_is_given_when_a_shared_bus_is_too_slow(tmp_path: Path) -> None:
    left = _plug_in(tmp_path, "video0", 1, "1-2", "480")
    right = _plug_in(tmp_path, "video2", 1, "1-3", "480")
    elsewhere = _plug_in(tmp_path, "video4", 3, "3-1", "480")
    fast = [_plug_in(tmp_path, f"video{6 + i}", 2, f"2-{i + 1}", "5000") for i in range(2)]

    def hints(*devices: str, rate: float = 30.0, size: int = 1, form: str = "YUYV") -> list[str]:
        return list(
            bandwidth_hints(
                devices, width=640 * size, height=480 * size, rate=rate, pixel_format=form,
                root=tmp_path,
            )
        )  # fmt: skip

    (hint,) = hints(left, right)
    assert "about 37 MB/s" in hint
    assert "format=MJPG" in hint
    assert hints(left, right, form="MJPG") == []
    (hint,) = hints(left, right, form="MJPG", size=3)
    assert "use a smaller size" in hint
    assert hints(left, right, rate=15.0) == []
    assert hints(left, elsewhere) == []
    assert hints(*fast) == []
    assert hints("/dev/video90", "/dev/video91") == []
