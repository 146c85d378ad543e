"""Queries to a device, answered with the kernel's bytes."""

from __future__ import annotations

import ctypes
import errno
import os
import termios
from pathlib import Path

import pytest

from observer.sources.cameras.v4l2.device import LinuxAccess, V4l2Device
from observer.sources.cameras.v4l2.modes import CameraMode, camera_modes

from .fake_v4l2 import (
    AUTO_EXPOSURE,
    DISABLED,
    EXPOSURE,
    FOCUS,
    GAIN,
    INTEGER,
    INTEGER_MENU,
    POWER_LINE,
    VOLATILE,
    WHITE_BALANCE,
    FakeCamera,
    FakeControl,
    FakeKernel,
    metadata_node,
    webcam,
)


@pytest.fixture
def node(tmp_path: Path) -> Path:
    file = tmp_path / "video0"
    file.touch()
    return file


def opened(node: Path, camera: FakeCamera) -> V4l2Device:
    return V4l2Device(node, FakeKernel({"video0": camera}))


def test_a_device_identifies_itself(node: Path) -> None:
    identity = opened(node, webcam("Left Eye", "usb-3")).identity()
    assert (identity.driver, identity.card, identity.bus) == ("uvcvideo", "Left Eye", "usb-3")


def test_the_capabilities_of_the_node_count_not_of_the_device(node: Path) -> None:
    assert opened(node, metadata_node()).identity().capabilities & 1 == 0
    old = webcam()
    old.old_driver = True
    assert opened(node, old).identity().capabilities == 1


def test_modes_are_listed_by_format_and_size_with_the_highest_rate_first(node: Path) -> None:
    assert camera_modes(opened(node, webcam())) == (
        CameraMode("MJPG", 640, 480, (30.0, 15.0)),
        CameraMode("MJPG", 1280, 720, (30.0,)),
        CameraMode("YUYV", 640, 480, (30.0, 15.0)),
        CameraMode("YUYV", 1280, 720, (10.0,)),
    )


def test_ranges_of_sizes_and_rates_become_common_values(node: Path) -> None:
    camera = FakeCamera(
        formats={"YUYV": {}},
        stepwise=(320, 1296, 16, 240, 972, 4),
        interval_range=((1, 42), (1, 12)),
    )
    modes = camera_modes(opened(node, camera))
    assert [(mode.width, mode.height) for mode in modes] == [
        (320, 240), (640, 360), (640, 480), (800, 600), (1280, 480), (1280, 720), (1280, 960),
        (1296, 972),
    ]  # fmt: skip
    assert modes[0].rates == (42.0, 30.0, 25.0, 20.0, 15.0)


def test_the_current_size_format_and_rate_are_read(node: Path) -> None:
    camera = webcam()
    camera.current, camera.interval = ("YUYV", 800, 600), (1001, 30000)
    device = opened(node, camera)
    assert device.size_and_format() == ((800, 600), "YUYV")
    assert device.rate() == pytest.approx(29.97, abs=0.001)
    camera.interval = (0, 0)
    assert device.rate() is None


def test_controls_are_listed_with_ranges_menus_and_flags(node: Path) -> None:
    camera = webcam()
    camera.controls[0x9A0913] = FakeControl(
        INTEGER_MENU, "Auto Exposure, Bias", 0, 2, menu={0: -1000, 2: 1000}
    )
    camera.controls[FOCUS] = FakeControl(INTEGER, "Focus", 0, 250, 5, flags=VOLATILE)
    camera.controls[GAIN].flags = DISABLED
    controls = {control.id: control for control in opened(node, camera).controls()}
    assert GAIN not in controls
    assert 0x980001 not in controls  # a heading
    assert controls[AUTO_EXPOSURE].menu == {1: "Manual Mode", 3: "Aperture Priority Mode"}
    assert controls[0x9A0913].menu == {0: "-1000", 2: "1000"}
    exposure = controls[EXPOSURE]
    assert (exposure.minimum, exposure.maximum, exposure.inactive) == (3, 2047, True)
    assert controls[FOCUS].range_text == "0 to 250 in steps of 5"
    assert controls[FOCUS].volatile
    assert controls[POWER_LINE].range_text == "0 (Disabled), 1 (50 Hz), 2 (60 Hz)"
    assert [controls[WHITE_BALANCE].takes(each) for each in (2790, 2800, 2805, 2810, 6510)] == [
        False, True, False, True, False,
    ]  # fmt: skip


def test_a_driver_that_does_not_list_its_controls_is_queried_for_each(node: Path) -> None:
    camera = webcam()
    camera.old_driver = True
    assert EXPOSURE in {control.id for control in opened(node, camera).controls()}


def test_steps_are_counted_from_the_lowest_value(node: Path) -> None:
    camera = webcam()
    camera.controls[FOCUS] = FakeControl(INTEGER, "Focus", 3, 21, 6)
    focus = opened(node, camera).control(FOCUS)
    assert focus is not None
    assert [value for value in range(30) if focus.takes(value)] == [3, 9, 15, 21]


def test_a_driver_that_repeats_a_control_ends_the_list(node: Path) -> None:
    camera = webcam()
    camera.repeats = True
    controls = opened(node, camera).controls()
    assert len(controls) == len({control.id for control in controls})
    assert EXPOSURE in {control.id for control in controls}


def test_unplugging_is_an_error_and_not_the_end_of_a_list(node: Path) -> None:
    camera = webcam()
    camera.fails[2] = errno.ENODEV
    with pytest.raises(OSError, match=os.strerror(errno.ENODEV)):
        camera_modes(opened(node, camera))


def test_descriptors_are_closed_once(node: Path) -> None:
    kernel = FakeKernel({"video0": webcam()})
    with V4l2Device(node, kernel) as device:
        assert len(kernel.opened) == 1
    device.close()
    assert kernel.opened == {}
    with pytest.raises(OSError, match="closed"):
        device.identity()


def test_the_real_kernel_refuses_a_file_that_is_not_a_video_device(node: Path) -> None:
    before = len(os.listdir("/proc/self/fd"))
    with V4l2Device(node, LinuxAccess()) as device, pytest.raises(OSError, match="ioctl") as caught:
        device.identity()
    assert caught.value.errno == errno.ENOTTY
    assert len(os.listdir("/proc/self/fd")) == before


class WindowSize(ctypes.Structure):
    """``struct winsize`` of ``<asm-generic/termios.h>``."""

    _fields_ = [
        ("rows", ctypes.c_ushort),
        ("columns", ctypes.c_ushort),
        ("width", ctypes.c_ushort),
        ("height", ctypes.c_ushort),
    ]


def test_the_real_kernels_answer_is_written_to_the_structure() -> None:
    # A terminal, because there is no camera; the answer takes the same path.
    ours, theirs = os.openpty()
    try:
        os.close(theirs)
        termios.tcsetwinsize(ours, (37, 111))
        size = WindowSize()
        LinuxAccess().ioctl(ours, termios.TIOCGWINSZ, size)
    finally:
        os.close(ours)
    assert (size.rows, size.columns) == (37, 111)
