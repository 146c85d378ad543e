"""Pairs from scripted cameras, behind the real camera process."""

from __future__ import annotations

import dataclasses
import itertools
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import psutil
import pytest

from observer.errors import SourceError
from observer.sources.cameras.settings import CameraSettings
from observer.sources.cameras.source import CameraSource
from observer.sources.cameras.spec import parse_devices
from observer.sources.contract import LiveSource

from .scripted_camera import OPENER, scripted_spec, write_script
from .watching import Watch, grabbers

PERIOD_S = 1 / 30
# Seconds: allowance for a slow machine, two cores shared with others.
LATE_S = 0.05


def tell(measured: str) -> None:
    """Print a measurement, shown when run with -s."""
    sys.stdout.write(f"{measured}\n")


def test_pairs_have_the_stamps_of_their_exposures(watch: Watch) -> None:
    watch.read_frames(40)
    frames = watch.frames
    skews = [frame.right_time - frame.time for frame in frames if frame.right_time is not None]
    assert len(skews) == 40
    assert max(abs(skew - 0.2 * PERIOD_S) for skew in skews) < 1e-5
    assert all(frame.received >= frame.right_time for frame in frames if frame.right_time)
    assert [f.index for f in frames] == sorted({f.index for f in frames})
    report = watch.source.report()
    assert report.skew_median_s == pytest.approx(0.2 * PERIOD_S, abs=1e-5)
    assert report.skew_p95_s == pytest.approx(0.2 * PERIOD_S, abs=1e-5)
    assert report.pairs == 40
    assert report.dropped == 0
    assert report.reopened == 0
    steps = np.diff([frame.time for frame in frames])
    assert statistics.median(steps) == pytest.approx(PERIOD_S, abs=1e-4)


def test_source_info_describes_the_cameras(left: Path, right: Path) -> None:
    spec = scripted_spec(left, right, settings=CameraSettings(gain=7))
    source = CameraSource(spec, opener=OPENER)
    try:
        info = source.info
        assert (info.kind, info.live, info.width, info.height) == ("camera", True, 64, 48)
        assert info.frame_rate == pytest.approx(30.0)
        assert info.frame_count is None
        assert info.devices == ("left", "right")
        assert source.calibration is None
        assert isinstance(source, LiveSource)
        with pytest.raises(SourceError, match="cannot be rewound"):
            source.rewind()
        cameras = source.report().cameras
        assert [each.side for each in cameras] == ["left", "right"]
        assert [each.state for each in cameras] == ["open", "open"]
        assert cameras[0].settings == {"size": "64x48"}
        assert cameras[0].refused == ("gain 7 is not offered by it",)
    finally:
        source.close()


def test_one_device_with_swapped_images(left: Path) -> None:
    write_script(left, size=[128, 48])
    spec = dataclasses.replace(scripted_spec(left), swapped=True)
    source = CameraSource(spec, opener=OPENER)
    try:
        watch = Watch(source)
        watch.read_frames(3)
        assert all((frame.left & 1).all() for frame in watch.frames)
        assert not any((frame.right & 1).any() for frame in watch.frames)
    finally:
        source.close()


def test_one_device_with_both_images(left: Path) -> None:
    write_script(left, size=[128, 48])
    source = CameraSource(scripted_spec(left), opener=OPENER)
    try:
        watch = Watch(source)
        watch.read_frames(12)
        assert (source.info.width, source.info.height) == (64, 48)
        assert source.info.devices == ("left",)
        for frame in watch.frames:
            assert frame.left.shape == frame.right.shape == (48, 64, 3)
            assert not (frame.left & 1).any()
            assert (frame.right & 1).all()
            assert frame.right_time is None
        report = source.report()
        assert [each.side for each in report.cameras] == ["both"]
        assert report.skew_median_s is None
        write_script(left, size=[128, 48], mode="hang in grab")
        watch.trouble_after("the camera (left) no longer sends images")
    finally:
        source.close()


def test_images_without_contrast_are_no_camera_trouble(watch: Watch, left: Path) -> None:
    write_script(left, mode="black")
    watch.read_until(lambda: watch.frames and not watch.frames[-1].left.any())
    watch.read_frames(20)
    assert watch.troubles == []


def test_a_pair_with_a_repeated_image_is_left_out(watch: Watch, left: Path) -> None:
    write_script(left, mode="twice")
    time.sleep(3 * PERIOD_S)
    watch.read_frames(1)
    first = len(watch.frames)
    watch.read_frames(12)
    for before, after in itertools.pairwise(watch.frames[first:]):
        assert (before.left != after.left).any()
    assert watch.troubles == []


def test_cameras_that_repeat_images_alternately_still_deliver(
    watch: Watch, left: Path, right: Path
) -> None:
    write_script(left, mode="twice")
    write_script(right, mode="twice, later", phase=0.2)
    time.sleep(3 * PERIOD_S)
    began = time.monotonic()
    watch.read_frames(15)
    # Every second pair; a busy machine may miss some.
    assert time.monotonic() - began < 3 * 15 * 2 * PERIOD_S
    assert watch.troubles == []


def test_pairs_further_apart_than_half_a_frame_are_dropped_and_counted(
    watch: Watch, right: Path
) -> None:
    watch.read_frames(5)
    # Every fifth frame of the right camera is 0.2 + 0.6 of a frame behind.
    write_script(right, phase=0.2, late=0.6)
    time.sleep(2 * PERIOD_S)
    start = watch.frames[-1].index
    before = watch.source.report().dropped
    began = time.monotonic()
    watch.read_until(lambda: watch.source.report().dropped >= before + 4)
    late_frames = (time.monotonic() - began) / (5 * PERIOD_S)
    tell(f"dropped 4 pairs where {late_frames:.1f} frames were late")
    assert late_frames > 3.0
    assert watch.frames[-1].index - start > len([f for f in watch.frames if f.index > start])
    for frame in watch.frames:
        assert frame.right_time is not None
        assert abs(frame.right_time - frame.time) <= 0.5 * PERIOD_S + 1e-6
    assert watch.troubles == []


def test_frames_are_fresh_after_the_observer_was_busy(watch: Watch) -> None:
    watch.read_frames(5)
    for busy_s in (0.08, 0.3, 1.5):
        time.sleep(busy_s)
        watch.read_frames(1)
        assert watch.troubles == []
        frame = watch.frames[-1]
        assert time.monotonic() - frame.time < 2 * PERIOD_S + LATE_S


def test_frames_that_waited_in_a_drivers_queue_do_not_count_as_fresh(
    watch: Watch, left: Path, right: Path
) -> None:
    watch.read_frames(5)
    write_script(left, mode="stall")
    write_script(right, mode="stall", phase=0.2)
    before = watch.frames[-1].time
    watch.read_until(lambda: watch.frames[-1].time - before > 0.6)
    for frame in watch.frames:
        assert frame.received - frame.time < 2 * PERIOD_S + LATE_S
    # The queue is emptied at once.
    gap = max(after.time - one.time for one, after in itertools.pairwise(watch.frames))
    assert gap > 0.45


def test_a_camera_whose_stamps_are_always_late_delivers_but_is_never_fresh(
    left: Path, right: Path
) -> None:
    for path in (left, right):
        write_script(path, behind_s=0.5)
    source = CameraSource(scripted_spec(left, right), opener=OPENER)
    try:
        watch = Watch(source)
        for _ in range(10):
            watch.read_frames(1)
            assert time.monotonic() - watch.frames[-1].received >= 0.4
    finally:
        source.close()


def test_arrival_times_are_used_without_exposure_stamps(left: Path, right: Path) -> None:
    for path in (left, right):
        write_script(path, stamps="none")
    source = CameraSource(scripted_spec(left, right), opener=OPENER)
    try:
        watch = Watch(source)
        watch.read_frames(10)
        for frame in watch.frames:
            assert frame.received == max(frame.time, frame.right_time or 0.0)
    finally:
        source.close()


def test_reading_takes_little_of_the_observers_processor_time(left: Path, right: Path) -> None:
    for path in (left, right):
        write_script(path, size=[640, 480])
    source = CameraSource(scripted_spec(left, right), opener=OPENER)
    try:
        watch = Watch(source)
        watch.read_frames(5)
        before = time.thread_time()
        latencies = []
        for _ in range(45):
            watch.read_frames(1)
            latencies.append(time.monotonic() - watch.frames.pop().received)
        cost_s = (time.thread_time() - before) / 45
        tell(
            f"640x480 at 30 per s: {cost_s * 1e3:.2f} ms of the reading thread per pair; handed "
            f"over {statistics.median(latencies) * 1e3:.2f} ms after the later one was grabbed"
        )
        assert cost_s < 0.003
    finally:
        source.close()


def test_cameras_that_cannot_be_opened_are_reported_at_once(left: Path, right: Path) -> None:
    write_script(right, mode="busy")
    began = time.monotonic()
    with pytest.raises(SourceError, match=r"the right camera \(right\) is in use by another"):
        CameraSource(scripted_spec(left, right), opener=OPENER)
    assert time.monotonic() - began < 10.0
    right.unlink()
    began = time.monotonic()
    with pytest.raises(SourceError, match=r"the right camera \(right\) is not connected"):
        CameraSource(scripted_spec(left, right), opener=OPENER)
    assert time.monotonic() - began < 1.0
    write_script(right, size=[32, 24])
    with pytest.raises(SourceError, match=r"64x48 pixels and the right camera .* 32x24"):
        CameraSource(scripted_spec(left, right), opener=OPENER)
    write_script(left, size=[63, 48])
    with pytest.raises(SourceError, match="an even width"):
        CameraSource(scripted_spec(left), opener=OPENER)


def test_closing_leaves_nothing_behind_and_may_be_repeated(left: Path, right: Path) -> None:
    process = psutil.Process()
    descriptors = process.num_fds()
    threads = threading.active_count()
    for mode in ("good", "hang in grab"):
        write_script(left)
        source = CameraSource(scripted_spec(left, right), opener=OPENER)
        watch = Watch(source)
        watch.read_frames(2)
        write_script(left, mode=mode)
        watch.read_for(0.3)
        began = time.monotonic()
        source.close()
        assert time.monotonic() - began < 1.0
        source.close()
        assert grabbers() == []
        with pytest.raises(SourceError, match="closed"):
            source.read()
    assert process.num_fds() == descriptors
    assert threading.active_count() == threads


def test_cameras_outlive_the_thread_that_opened_them(left: Path, right: Path) -> None:
    opened: list[CameraSource] = []
    spec = scripted_spec(left, right)
    thread = threading.Thread(target=lambda: opened.append(CameraSource(spec, opener=OPENER)))
    thread.start()
    thread.join()
    try:
        watch = Watch(opened[0])
        watch.read_frames(10)
        assert watch.troubles == []
    finally:
        opened[0].close()


def test_a_file_that_is_not_a_camera_is_refused(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / name).write_bytes(b"no camera")
    with pytest.raises(SourceError, match=r"(one|two)\) cannot be used: .* not a camera"):
        CameraSource(parse_devices(f"{tmp_path / 'one'},{tmp_path / 'two'}"))


def test_camera_processes_end_when_their_parent_is_killed(left: Path, right: Path) -> None:
    """A separate parent process is killed: its cameras must not keep the devices."""
    code = (
        f"from observer.sources.cameras.source import CameraSource\n"
        f"from observer.sources.cameras.spec import CamerasSpec, CameraTarget\n"
        f"from observer.sources.cameras.settings import CameraSettings\n"
        f"import time\n"
        f"targets = [CameraTarget(each, each, False) for each in {[str(left), str(right)]!r}]\n"
        f"spec = CamerasSpec('', tuple(targets), CameraSettings())\n"
        f"source = CameraSource(spec, opener={OPENER!r})\n"
        f"print('open', flush=True)\n"
        f"time.sleep(60)\n"
    )
    parent = subprocess.Popen([sys.executable, "-P", "-c", code], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    assert parent.stdout.readline() == b"open\n"
    children = psutil.Process(parent.pid).children()
    assert len(children) == 2
    write_script(left, mode="hang in grab")
    time.sleep(3 * PERIOD_S)
    parent.kill()
    parent.wait()
    parent.stdout.close()
    gone, alive = psutil.wait_procs(children, timeout=2.0)
    assert len(gone) == 2
    assert alive == []
