"""Pairs decoded while the observer works, from scripted cameras."""

from __future__ import annotations

import signal
import statistics
import time
from pathlib import Path

import pytest

from observer.sources.cameras.source import CameraSource
from observer.sources.contract import NoFrame
from observer.types import StereoFrame

from .scripted_camera import OPENER, scripted_spec, write_script
from .watching import Watch, grabbers

PERIOD_S = 1 / 30
LATE_S = 0.05


def tend_for(source: CameraSource, seconds: float) -> float:
    """Tend the cameras while working; return the median duration of a call, seconds."""
    looks, until = [], time.monotonic() + seconds
    while (began := time.monotonic()) < until:
        source.tend()
        looks.append(time.monotonic() - began)
        time.sleep(0.003)
    return statistics.median(looks)


def read_while_stopped(source: CameraSource) -> StereoFrame | NoFrame:
    """Read while no camera process can run."""
    children = grabbers()
    for child in children:
        child.send_signal(signal.SIGSTOP)
    try:
        return source.read()
    finally:
        for child in children:
            child.send_signal(signal.SIGCONT)


@pytest.mark.parametrize("tended", [False, True])
def test_a_tended_pair_is_available_while_its_cameras_are_stopped(
    watch: Watch, tended: bool
) -> None:
    # A newer pair may have arrived just before the stop; then the read waits for that one. So they
    # are stopped at different phases of the period.
    tries = 12 if tended else 3
    for k in range(tries):
        watch.read_frames(2)
        waited_s = (4 + k / tries) * PERIOD_S
        if tended:
            tend_for(watch.source, waited_s)
        else:
            time.sleep(waited_s)
        frame = read_while_stopped(watch.source)
        if isinstance(frame, StereoFrame):
            assert tended, "decoding had not been requested"
            assert frame.time > watch.frames[-1].time + 2 * PERIOD_S
            return
    assert not tended, "none of many pairs was decoded ahead"


def test_the_newest_pair_is_read_and_skipped_ones_are_not_counted(watch: Watch) -> None:
    watch.read_frames(5)
    for busy_s in (0.05, 0.3, 1.2):
        before = watch.source.report()
        assert tend_for(watch.source, busy_s) < 0.003, "tending never waits"
        watch.read_frames(1)
        frame, after = watch.frames[-1], watch.source.report()
        assert time.monotonic() - frame.time < 2 * PERIOD_S + LATE_S
        assert after.pairs == before.pairs + 1
        assert after.dropped == before.dropped
        assert frame.index == watch.frames[-2].index + 1
    times = [frame.time for frame in watch.frames]
    assert times == sorted(set(times))
    assert watch.troubles == []


def test_an_outdated_pair_is_replaced(watch: Watch) -> None:
    watch.read_frames(5)
    for _ in range(3):
        tend_for(watch.source, 3 * PERIOD_S)
        # Not tended for this long, so the decoded pair is out of date.
        time.sleep(10 * PERIOD_S)
        asked = time.monotonic()
        watch.read_frames(1)
        assert watch.frames[-1].received > asked - 2 * PERIOD_S


def test_images_too_far_apart_are_dropped_while_tending(watch: Watch, right: Path) -> None:
    watch.read_frames(5)
    write_script(right, phase=0.2, late=0.6)
    time.sleep(2 * PERIOD_S)
    before = watch.source.report().dropped
    until = time.monotonic() + 8.0
    while watch.source.report().dropped < before + 3 and time.monotonic() < until:
        tend_for(watch.source, 2 * PERIOD_S)
        watch.read()
    assert watch.source.report().dropped >= before + 3
    for frame in watch.frames:
        assert frame.right_time is not None
        assert abs(frame.right_time - frame.time) <= 0.5 * PERIOD_S + 1e-6


def test_images_that_decode_slower_than_they_arrive_are_still_read(
    watch: Watch, left: Path, right: Path
) -> None:
    watch.read_frames(5)
    write_script(left, decoding_s=0.045)
    write_script(right, phase=0.2, decoding_s=0.045)
    for _ in range(4):
        tend_for(watch.source, 3 * PERIOD_S)
        watch.read_frames(1)
    assert watch.troubles == []


def test_a_camera_lost_after_decoding_leaves_no_mismatched_pair(watch: Watch) -> None:
    watch.read_frames(5)
    tend_for(watch.source, 4 * PERIOD_S)
    last = watch.frames[-1].time
    grabbers()[-1].kill()
    time.sleep(0.02)
    tend_for(watch.source, 2 * PERIOD_S)
    began = time.monotonic()
    watch.read_until(lambda: watch.troubles)
    assert "its process exited unexpectedly" in watch.troubles[0][1]
    assert time.monotonic() - began < 0.2 + LATE_S
    count = len(watch.frames)
    watch.read_until(lambda: len(watch.frames) >= count + 3)
    assert watch.frames[-1].time > last
    for frame in watch.frames:
        assert frame.right_time is not None
        assert abs(frame.right_time - frame.time) <= 0.5 * PERIOD_S + 1e-6


def test_a_single_device_can_be_tended_even_when_closed(left: Path) -> None:
    write_script(left, size=[128, 48])
    source = CameraSource(scripted_spec(left), opener=OPENER)
    try:
        watch = Watch(source)
        watch.read_frames(2)
        tend_for(source, 3 * PERIOD_S)
        watch.read_frames(2)
        assert watch.frames[-1].left.shape == (48, 64, 3)
    finally:
        source.close()
    source.tend()
    assert grabbers() == []
