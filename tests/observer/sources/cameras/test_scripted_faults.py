"""Faults of a scripted camera: reported by name and in time, and recovered from."""

from __future__ import annotations

import signal
import sys
import time
from pathlib import Path

import pytest

from observer.sources.cameras.source import CameraSource
from observer.sources.contract import LIVE_PATIENCE_S

from .scripted_camera import OPENER, scripted_spec, write_script
from .watching import Watch, grabbers

# Seconds: allowance for a slow machine, two cores shared with others.
LATE_S = 0.05


def tell(measured: str) -> None:
    """Print a measurement, shown when run with -s."""
    sys.stdout.write(f"{measured}\n")


@pytest.mark.parametrize(
    ("mode", "words", "borne_s"),
    [
        # Faults that may pass by themselves are tolerated for a second before it is reopened.
        ("hang in grab", "no longer sends images", 1.2),
        ("hang in retrieve", "no longer sends images", 1.2),
        ("no image", "sends images that cannot be decoded", 1.2),
        ("frozen", "sends the same image again and again", 1.2),
        ("gone", "has stopped sending images", 0.1),
        ("raise", "failed in its driver (RuntimeError)", 0.1),
        ("die", "its process exited unexpectedly", 0.1),
    ],
)
def test_a_fault_is_reported_by_name_in_time_and_recovered_from(
    watch: Watch, right: Path, mode: str, words: str, borne_s: float
) -> None:
    watch.read_frames(5)
    write_script(right, phase=0.2, mode=mode)
    after_s = watch.trouble_after(words)
    tell(f"{mode}: told {after_s * 1e3:.0f} ms after the last frame was received")
    assert after_s < 0.2 + LATE_S
    assert watch.troubles[-1][1].startswith("the right camera (right) ")
    watch.read_for(borne_s)
    fault = watch.source.report().cameras[1]
    assert words in str(fault.trouble)
    before = watch.frames[-1]
    write_script(right, phase=0.2)
    healed = time.monotonic()
    watch.read_frames(5)
    back_s = watch.frames[-5].received - healed
    tell(f"{mode}: back {back_s:.2f} s after it healed")
    assert back_s < 5.0
    assert watch.frames[-5].index > before.index
    times = [frame.time for frame in watch.frames]
    assert times == sorted(set(times))
    report = watch.source.report()
    assert report.reopened >= 1
    assert [each.trouble for each in report.cameras] == [None, None]
    assert len(grabbers()) == 2
    # Restarting a process after the fault was reported may take long on a busy machine.
    assert watch.longest_read_s < LIVE_PATIENCE_S + 4 * LATE_S


def test_an_unplugged_camera_is_reopened_when_it_is_back(watch: Watch, left: Path) -> None:
    watch.read_frames(5)
    left.unlink()
    after_s = watch.trouble_after("the left camera (left) is not connected; plug it in again")
    assert after_s < 0.2 + LATE_S
    watch.read_for(0.3)
    ready = set(grabbers())
    watch.read_for(0.8)
    report = watch.source.report()
    assert report.cameras[0].state == "waiting"
    assert set(grabbers()) == ready  # none is started in vain for what is not there
    write_script(left)
    plugged = time.monotonic()
    watch.read_frames(3)
    assert watch.frames[-3].received - plugged < 5.0


def test_a_hung_reopening_is_given_up_and_retried(watch: Watch, left: Path) -> None:
    watch.read_frames(5)
    write_script(left, mode="hang in opening")
    grabbers()[0].kill()
    watch.trouble_after("the left camera (left) was lost because its process exited unexpectedly")
    watch.read_until(lambda: "does not answer" in watch.troubles[-1][1])
    write_script(left)
    watch.read_frames(3)
    assert len(grabbers()) == 2


def test_a_camera_that_falls_behind_is_reopened(left: Path, right: Path) -> None:
    write_script(left, stamps="none", pace=1.0)
    write_script(right, phase=0.2, stamps="none", pace=1.0)
    source = CameraSource(scripted_spec(left, right), opener=OPENER)
    try:
        watch = Watch(source)
        watch.read_frames(5)
        write_script(right, phase=0.2, stamps="none", pace=0.7)
        watch.trouble_after("the right camera (right) falls behind because the network or this")
        write_script(right, phase=0.2, stamps="none", pace=1.0)
        count = len(watch.frames)
        watch.read_until(lambda: len(watch.frames) >= count + 5)
        report = source.report()
        assert report.reopened == 1
        assert [each.trouble for each in report.cameras] == [None, None]
    finally:
        source.close()


@pytest.mark.parametrize("sent", [signal.SIGSTOP, signal.SIGKILL])
def test_a_stopped_or_killed_process_is_replaced(watch: Watch, sent: signal.Signals) -> None:
    watch.read_frames(5)
    victim = grabbers()[0]
    victim.send_signal(sent)
    after_s = watch.trouble_after("camera")
    tell(f"{sent.name}: told {after_s * 1e3:.0f} ms after the last frame was received")
    assert after_s < 0.2 + LATE_S
    count = len(watch.frames)
    watch.read_until(lambda: len(watch.frames) >= count + 5)
    assert watch.source.report().reopened == 1
    assert not victim.is_running()
    assert len(grabbers()) == 2


def test_a_changed_size_is_reported_until_it_is_set_back(watch: Watch, left: Path) -> None:
    watch.read_frames(5)
    write_script(left, size=[32, 24])
    after_s = watch.trouble_after("changed its images from 64x48 to 32x24 pixels")
    assert after_s < 0.2 + LATE_S
    watch.read_until(lambda: "now delivers 32x24 pixels instead of 64x48" in watch.troubles[-1][1])
    assert watch.source.report().cameras[0].state == "failed"
    count = len(watch.frames)
    watch.read_for(0.5)
    assert len(watch.frames) == count
    write_script(left)
    watch.read_frames(3)
    assert watch.frames[-1].left.shape == (48, 64, 3)


def test_stamps_that_do_not_advance_are_a_fault(watch: Watch, left: Path) -> None:
    watch.read_frames(5)
    write_script(left, stamps="standing")
    assert watch.trouble_after("images whose timestamps do not advance") < 0.2 + LATE_S
    write_script(left)
    watch.read_frames(3)
