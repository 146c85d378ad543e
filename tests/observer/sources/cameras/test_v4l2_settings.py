"""Setting a camera: values it takes are reported, others are refused with a reason."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from observer.errors import SourceError
from observer.sources.cameras.settings import AppliedSettings, CameraSettings
from observer.sources.cameras.v4l2.applying import apply_settings

from .fake_machine import FakeMachine
from .fake_v4l2 import (
    AUTO_EXPOSURE,
    AUTO_FOCUS,
    AUTO_GAIN,
    AUTO_WHITE_BALANCE,
    BOOLEAN,
    EXPOSURE,
    FOCUS,
    GAIN,
    GRABBED,
    INACTIVE,
    INTEGER,
    MAY_LOWER_RATE,
    MENU,
    POWER_LINE,
    READ_ONLY,
    VOLATILE,
    WHITE_BALANCE,
    FakeCamera,
    FakeControl,
    FakeKernel,
    webcam,
)


class Bench:
    """One camera on a machine, and the effect of settings on it."""

    def __init__(self, root: Path) -> None:
        self.machine = FakeMachine(root)
        self.machine.camera(0)
        self.camera: FakeCamera = webcam()
        self.kernel = FakeKernel({"video0": self.camera})

    def apply(self, **settings: object) -> AppliedSettings:
        asked = CameraSettings(**settings)  # type: ignore[arg-type]
        return apply_settings("/dev/video0", asked, root=self.machine.root, access=self.kernel)

    def value(self, number: int) -> int:
        return self.camera.controls[number].value

    def add_focus(self, step: int = 5) -> None:
        self.camera.controls[AUTO_FOCUS] = FakeControl(BOOLEAN, "Focus, Automatic", 0, 1, value=1)
        self.camera.controls[FOCUS] = FakeControl(INTEGER, "Focus, Absolute", 0, 250, step)
        self.camera.governed[AUTO_FOCUS] = ((0,), (FOCUS,))


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def test_reading_describes_all_settings_and_changes_none(bench: Bench) -> None:
    read = apply_settings(
        "/dev/video0", CameraSettings(), root=bench.machine.root, access=bench.kernel
    )
    assert read.accepted == {
        "size": "640x480",
        "pixel format": "MJPG",
        "rate": "30/s (drops in dim light)",
        "exposure": "automatic",
        "gain": "10 (automatic exposure may change it)",
        "white balance": "automatic",
        "power line": "60 Hz",
    }
    assert read.refused == ()
    assert bench.kernel.was_set == []
    assert bench.kernel.opened == {}


def test_values_are_set_after_disabling_automatics_and_read_back(bench: Bench) -> None:
    bench.add_focus()
    applied = bench.apply(exposure=156, gain=20, white_balance=4600, focus=35, power_line_hz=50)
    assert applied.refused == ()
    assert applied.accepted == {
        "size": "640x480",
        "pixel format": "MJPG",
        "rate": "30/s",
        "exposure": "156 (15.6 ms, locked)",
        "gain": "20 (locked)",
        "white balance": "4600 K (locked)",
        "focus": "35 (locked)",
        "power line": "50 Hz",
    }
    order = [number for number, _ in bench.kernel.was_set]
    for automatic, value in (
        (AUTO_EXPOSURE, EXPOSURE), (AUTO_WHITE_BALANCE, WHITE_BALANCE), (AUTO_FOCUS, FOCUS)
    ):  # fmt: skip
        assert order.index(automatic) < order.index(value)
    assert bench.value(AUTO_EXPOSURE) == 1


def test_automatics_are_switched_on_again(bench: Bench) -> None:
    bench.add_focus()
    bench.apply(exposure=156, white_balance=4600, focus=35)
    applied = bench.apply(exposure="auto", white_balance="auto", focus="auto")
    assert applied.refused == ()
    assert bench.value(AUTO_EXPOSURE) == 3
    assert applied.accepted["exposure"] == "automatic"
    assert applied.accepted["white balance"] == "automatic"
    assert applied.accepted["focus"] == "automatic"


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"exposure": 5000}, "exposure 5000: this camera accepts 3 to 2047"),
        ({"gain": 101}, "gain 101: this camera accepts 0 to 100"),
        (
            {"white_balance": 4605},
            "white balance 4605: this camera accepts 2800 to 6500 in steps of 10",
        ),
        ({"focus": 10}, "focus 10: this camera has no focus that can be set"),
        ({"focus": "auto"}, "focus auto: this camera has no automatic focus"),
        (
            {"gain": "auto"},
            "gain auto: this camera has no automatic gain; its automatic exposure may change the "
            "gain as well",
        ),
        (
            {"power_line_hz": "auto"},
            "power line auto: this camera accepts 0 (Disabled), 1 (50 Hz), 2 (60 Hz)",
        ),
    ],
)
def test_an_unsupported_value_is_refused_and_nothing_is_changed(
    bench: Bench, settings: dict[str, object], sentence: str
) -> None:
    before = bench.apply().accepted
    applied = bench.apply(**settings)
    assert applied.refused == (sentence,)
    assert bench.kernel.was_set == []
    assert applied.accepted == before


def test_one_refusal_does_not_keep_the_others_from_being_set(bench: Bench) -> None:
    bench.camera.controls[EXPOSURE].fails = errno.EIO
    applied = bench.apply(exposure=156, gain=20, power_line_hz=0)
    assert applied.refused == (
        "exposure 156: this camera did not answer (Input/output error); unplug it and plug it in "
        "again",
    )
    assert (bench.value(GAIN), bench.value(POWER_LINE)) == (20, 0)
    assert applied.accepted["power line"] == "off"
    assert "exposure" not in applied.accepted


def test_a_value_that_the_camera_changes_is_reported(bench: Bench) -> None:
    bench.camera.controls[EXPOSURE].moved = lambda value: value // 10 * 10
    applied = bench.apply(exposure=156)
    assert applied.refused == ("exposure 156: this camera set 150 instead",)
    assert applied.accepted["exposure"] == "150 (15.0 ms, locked)"


def test_an_automatic_that_cannot_be_switched_off_is_reported(bench: Bench) -> None:
    bench.camera.controls[AUTO_EXPOSURE].menu = {3: "Aperture Priority Mode"}
    applied = bench.apply(exposure=156)
    assert applied.refused == (
        "exposure 156, automatic exposure off: this camera only offers 3 (Aperture Priority Mode)",
    )
    assert applied.accepted["exposure"] == "automatic"


@pytest.mark.parametrize(
    ("flag", "part"),
    [
        (READ_ONLY, "reports it but does not"),
        (GRABBED, "it is currently locked"),
        (INACTIVE, "controls it and cannot be switched off"),
    ],
)
def test_a_control_that_cannot_be_set_is_refused_with_the_reason(
    bench: Bench, flag: int, part: str
) -> None:
    bench.camera.controls[GAIN].flags = flag
    (sentence,) = bench.apply(gain=20).refused
    assert part in sentence
    assert bench.value(GAIN) == 10


@pytest.mark.parametrize(
    ("code", "part"),
    [
        (errno.ERANGE, "this camera accepts 0 to 100"),
        (errno.EBUSY, "in use by another program"),
        (errno.EACCES, "does not let it be set at the moment"),
        (errno.EINVAL, "rejects it, although"),
        (errno.ETIMEDOUT, "did not answer"),
    ],
)
def test_errors_of_the_kernel_are_explained(bench: Bench, code: int, part: str) -> None:
    bench.camera.fails[0x1C] = code
    (sentence,) = bench.apply(gain=20).refused
    assert sentence.startswith("gain 20: ")
    assert part in sentence


def test_cameras_without_manual_mode_use_shutter_priority(bench: Bench) -> None:
    bench.camera.controls[AUTO_EXPOSURE] = FakeControl(
        MENU, "Auto Exposure", 0, 2, menu={0: "Auto Mode", 2: "Shutter Priority Mode"}
    )
    assert bench.apply(exposure=100).refused == ()
    assert bench.value(AUTO_EXPOSURE) == 2
    assert bench.apply(exposure="auto").refused == ()
    assert bench.value(AUTO_EXPOSURE) == 0


def test_a_separate_automatic_gain_is_switched(bench: Bench) -> None:
    bench.camera.controls[AUTO_GAIN] = FakeControl(BOOLEAN, "Gain, Automatic", 0, 1, value=1)
    bench.camera.governed[AUTO_GAIN] = ((0,), (GAIN,))
    bench.camera.controls[GAIN].flags = VOLATILE
    assert bench.apply().accepted["gain"] == "automatic (now 10)"
    assert bench.apply(gain=30).accepted["gain"] == "30 (locked)"
    assert bench.apply(gain="auto").refused == ()
    assert bench.value(AUTO_GAIN) == 1


def test_a_camera_without_automatic_exposure_can_still_be_set(bench: Bench) -> None:
    del bench.camera.controls[AUTO_EXPOSURE]
    bench.camera.governed.clear()
    applied = bench.apply(exposure=156)
    assert applied.refused == ()
    assert applied.accepted["exposure"] == "156 (15.6 ms)"


def test_requesting_a_rate_keeps_the_exposure_from_lowering_it(bench: Bench) -> None:
    applied = bench.apply(rate=30.0)
    assert bench.value(MAY_LOWER_RATE) == 0
    assert applied.accepted["rate"] == "30/s"
    assert applied.refused == ()


def test_an_exposure_longer_than_a_frame_is_reported(bench: Bench) -> None:
    assert bench.apply(exposure=400).accepted["exposure"] == (
        "400 (40.0 ms, locked, longer than a frame, so the rate drops)"
    )


def test_unavailable_sizes_formats_and_rates_are_refused_with_the_offer(
    bench: Bench,
) -> None:
    bench.camera.current, bench.camera.interval = ("YUYV", 1280, 720), (1, 10)
    refused = bench.apply(size=(1920, 1080), pixel_format="H264", rate=30.0).refused
    assert refused == (
        "format H264: this camera delivers YUYV; it offers MJPG, YUYV",
        "size 1920x1080: this camera delivers 1280x720; in YUYV it offers 640x480, 1280x720",
        "rate 30/s: this camera delivers 10/s; at 1280x720 in YUYV it offers 10/s",
    )


def test_a_rate_of_29_97_is_accepted_for_30(bench: Bench) -> None:
    bench.camera.interval = (1001, 30000)
    applied = bench.apply(rate=30.0, size=(640, 480), pixel_format="MJPG")
    assert applied.refused == ()
    assert applied.accepted["rate"] == "29.97/s"


def test_a_camera_is_found_by_its_stable_name(bench: Bench) -> None:
    name = "/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0"
    read = apply_settings(name, CameraSettings(), root=bench.machine.root, access=bench.kernel)
    assert read.accepted["size"] == "640x480"


def test_a_missing_or_vanishing_camera_is_reported(bench: Bench) -> None:
    with pytest.raises(SourceError, match="there is no /dev/video7; plug the camera in"):
        apply_settings(
            "/dev/video7", CameraSettings(), root=bench.machine.root, access=bench.kernel
        )
    bench.camera.fails[0x1C] = errno.ENODEV
    with pytest.raises(SourceError, match="/dev/video0 does not answer"):
        bench.apply(gain=20)
    assert bench.kernel.opened == {}


def test_a_file_that_is_not_a_camera_is_reported(bench: Bench) -> None:
    with pytest.raises(SourceError, match="/dev/video0 is not a video device"):
        apply_settings("/dev/video0", CameraSettings(), root=bench.machine.root)


def test_a_camera_unplugged_while_being_read_is_an_error(
    bench: Bench,
) -> None:
    bench.camera.fails[0x1B] = errno.ENODEV
    with pytest.raises(SourceError, match="does not answer"):
        bench.apply()
