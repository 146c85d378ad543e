"""Listing a machine's cameras, and what prevents their use."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from observer.sources.cameras.device_files import Holder, User, permission_advice
from observer.sources.cameras.devices import CameraDevice, list_devices, shared_bus_hints

from .fake_machine import CONTROLLER, FakeMachine
from .fake_v4l2 import EXPOSURE, FakeCamera, FakeKernel, metadata_node, webcam

STRANGER = User("ada", frozenset({54321}))


@pytest.fixture
def machine(tmp_path: Path) -> FakeMachine:
    return FakeMachine(tmp_path)


def test_two_webcams_are_listed_with_names_modes_controls_and_place(machine: FakeMachine) -> None:
    machine.camera(0, by_id="Maker_HD_1234")
    machine.camera(1, index=1)
    machine.camera(2, port="1-4.2", speed="480")
    kernel = FakeKernel({"video0": webcam(), "video1": metadata_node(), "video2": webcam("Other")})
    first, second, third = list_devices(machine.root, kernel)
    assert (first.path, second.path, third.path) == ("/dev/video0", "/dev/video1", "/dev/video2")
    assert first.by_path == f"/dev/v4l/by-path/pci-{CONTROLLER}-usb-0:1:1.0-video-index0"
    assert first.by_id == "/dev/v4l/by-id/usb-Maker_HD_1234-video-index0"
    assert third.by_id is None
    assert third.stable_path.endswith("usb-0:4.2:1.0-video-index0")
    assert (first.use, second.use, third.use) == ("images", "metadata", "images")
    assert second.modes == ()
    assert len(first.modes) == 4
    assert EXPOSURE in {control.id for control in first.controls}
    assert (third.card, third.driver, third.trouble) == ("Other", "uvcvideo", None)
    assert first.usb is not None
    assert third.usb is not None
    assert (third.usb.bus, third.usb.controller, third.usb.port, third.usb.speed_mbit) == (
        1, CONTROLLER, "1-4.2", 480.0,
    )  # fmt: skip
    assert kernel.opened == {}


def test_devices_are_sorted_by_their_numbers(machine: FakeMachine) -> None:
    for number in (10, 2, 0):
        machine.camera(number, port=f"1-{number}")
    kernel = FakeKernel({f"video{number}": webcam() for number in (0, 2, 10)})
    assert [device.path for device in list_devices(machine.root, kernel)] == [
        "/dev/video0", "/dev/video2", "/dev/video10",
    ]  # fmt: skip


def test_a_machine_without_devices_lists_none(tmp_path: Path) -> None:
    assert list_devices(tmp_path) == ()
    (tmp_path / "dev").mkdir()
    assert list_devices(tmp_path) == ()


def test_a_camera_outside_usb_and_without_names_is_listed(machine: FakeMachine) -> None:
    (machine.root / "dev" / "video0").touch()
    (device,) = list_devices(machine.root, FakeKernel({"video0": webcam()}))
    assert (device.usb, device.by_path, device.stable_path) == (None, None, "/dev/video0")
    assert device.trouble is None


def test_missing_permission_names_the_group_and_how_to_join_it(machine: FakeMachine) -> None:
    machine.camera(0, name="Locked Cam")
    kernel = FakeKernel({"video0": webcam()}, denied={"video0"})
    (device,) = list_devices(machine.root, kernel, STRANGER)
    assert device.trouble == (
        "only the group video may use /dev/video0; join it, then sign out and in again: sudo "
        "usermod -aG video ada"
    )
    assert (device.use, device.card) == ("unknown", "Locked Cam")


@pytest.mark.parametrize(
    ("lines", "groups", "part"),
    [
        (["video:x:{own}:bob,ada"], {54321}, "you were added to the group video after you signed"),
        (["video:x:{own}:"], {54321, None}, "let the group read and write it: sudo chmod g+rw"),
        (["root:x:{own}:"], {54321}, "only root may use"),
        (["video:x:77:"], {54321}, "only root may use"),
    ],
)
def test_each_cause_of_missing_permission_has_its_own_advice(
    machine: FakeMachine, lines: list[str], groups: set[int | None], part: str
) -> None:
    node = machine.camera(0)
    own = node.stat().st_gid
    machine.groups(*(line.format(own=own) for line in lines))
    user = User("ada", frozenset(own if each is None else each for each in groups))
    if lines == ["video:x:77:"] and own != 0:
        part = f"in a container add --group-add {own}"
    assert part in permission_advice(node, machine.root, user)


def test_a_camera_in_use_names_the_process(machine: FakeMachine) -> None:
    machine.camera(0)
    machine.process(812, "firefox", "/dev/null", "/dev/video0")
    machine.process(9, "bash", "/dev/video01")
    (device,) = list_devices(machine.root, FakeKernel({"video0": webcam()}))
    assert device.used_by == (Holder(812, "firefox"),)
    assert device.trouble == (
        "/dev/video0 is open in firefox (process 812), and a camera delivers images to "
        "only one program at a time; close it there"
    )
    assert device.modes  # it can be asked all the same


def test_a_camera_held_by_our_own_process_is_not_in_use(machine: FakeMachine) -> None:
    machine.camera(0)
    machine.process(900, "engine) 1 (", parent=os.getpid())
    machine.process(901, "python", "/dev/video0", parent=900)
    (device,) = list_devices(machine.root, FakeKernel({"video0": webcam()}))
    assert device.used_by == ()
    assert device.trouble is None


@pytest.mark.parametrize(
    ("code", "part"),
    [
        (errno.EBUSY, "/dev/video0 is in use by another program; sudo fuser -v /dev/video0 shows"),
        (errno.ENODEV, "/dev/video0 does not answer"),
        (errno.ENOTTY, "/dev/video0 is not a video device"),
        (errno.EMFILE, "/dev/video0 cannot be used (Too many open files)"),
    ],
)
def test_a_bad_device_does_not_hide_the_others(machine: FakeMachine, code: int, part: str) -> None:
    machine.camera(0)
    machine.camera(2, port="1-2")
    kernel = FakeKernel({"video0": webcam(), "video2": webcam()}, refused={"video0": code})
    bad, good = list_devices(machine.root, kernel)
    assert part in (bad.trouble or "")
    assert (good.use, good.trouble) == ("images", None)


def test_a_camera_that_fails_while_being_listed_keeps_its_name(machine: FakeMachine) -> None:
    machine.camera(0)
    camera = webcam()
    camera.fails[74] = errno.EIO
    (device,) = list_devices(machine.root, FakeKernel({"video0": camera}))
    assert (device.card, device.use) == ("HD Webcam", "images")
    assert "unplug the camera and plug it in again" in (device.trouble or "")


@pytest.mark.parametrize(
    ("capabilities", "use"),
    [
        (0x1, "images"), (0x1000, "images"), (0x8000, "codec"), (0x4000, "codec"),
        (0x2, "output"), (0x3, "images"), (0x00800000, "metadata"), (0x00010000, "other"),
    ],
)  # fmt: skip
def test_the_use_of_a_node_follows_from_its_capabilities(
    machine: FakeMachine, capabilities: int, use: str
) -> None:
    machine.camera(0)
    node = FakeCamera(capabilities=capabilities)
    (device,) = list_devices(machine.root, FakeKernel({"video0": node}))
    assert device.use == use


def test_a_node_without_formats_is_reported_as_unsupported(
    machine: FakeMachine,
) -> None:
    machine.camera(0)
    (device,) = list_devices(machine.root, FakeKernel({"video0": FakeCamera()}))
    assert "libcamera" in (device.trouble or "")


def listed(machine: FakeMachine, *cameras: FakeCamera) -> tuple[CameraDevice, ...]:
    return list_devices(
        machine.root, FakeKernel({f"video{2 * i}": each for i, each in enumerate(cameras)})
    )


def test_two_cameras_on_one_bus_get_a_hint_with_the_data_rates(machine: FakeMachine) -> None:
    machine.camera(0, port="1-1")
    machine.camera(2, port="1-2.4")
    (hint,) = shared_bus_hints(listed(machine, webcam(), webcam()))
    assert hint == (
        "/dev/video0 and /dev/video2 share one USB 2 bus (bus 1 of the controller 0000:00:14.0), "
        "which carries about 35 to 40 MB/s: uncompressed (YUYV) 640x480 at 30 fps needs 18.4 MB/s "
        "per camera, 36.9 MB/s in total, which fits barely, if at all; use compressed images with "
        "format=MJPG, or plug one camera into a port of another controller"
    )


def test_cameras_without_compression_get_another_hint(machine: FakeMachine) -> None:
    machine.camera(0, port="1-1")
    machine.camera(2, port="1-2")
    machine.camera(4, port="1-3")
    raw = webcam()
    del raw.formats["MJPG"]
    (hint,) = shared_bus_hints(listed(machine, webcam(), raw, webcam()))
    assert "/dev/video0, /dev/video2 and /dev/video4 share one USB 2 bus" in hint
    assert "55.3 MB/s in total, which does not fit" in hint
    assert "choose a smaller size or rate (/dev/video2: no MJPG)" in hint


@pytest.mark.parametrize(
    "second",
    [
        {"port": "3-1", "bus": 3},  # another bus of the same controller
        {"port": "1-2", "controller": "0000:05:00.0"},
        {"port": "1-2", "speed": "5000"},
        {"port": "1-1"},  # another node of the same camera
    ],
)
def test_cameras_that_do_not_share_a_bus_get_no_hint(
    machine: FakeMachine, second: dict[str, object]
) -> None:
    machine.camera(0, port="1-1")
    machine.camera(2, **second)  # type: ignore[arg-type]
    assert shared_bus_hints(listed(machine, webcam(), webcam())) == ()
