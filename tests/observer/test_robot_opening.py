"""Texts that name a robot's port."""

from __future__ import annotations

import pytest

from observer.errors import InputError
from observer.robot_opening import check_port, open_robot
from observer.robots.pioneer import Pioneer
from observer.robots.ports import shown_port


@pytest.mark.parametrize(
    "port",
    [
        "/dev/ttyUSB0",
        "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A1-if00-port0",
        "./robot",
        "socket://127.0.0.1:8101",
        "socket://[::1]:8101",
        "socket://robot-1.lab:8101/",
        "external:127.0.0.1:9000",
        "coppeliasim:127.0.0.1:23000/PioneerP3DX",
        "coppeliasim:127.0.0.1:23000/room/PioneerP3DX[1]",
    ],
)
def test_valid_ports_are_accepted(port: str) -> None:
    check_port(port)


@pytest.mark.parametrize(
    "port",
    [
        "", " ", "ttyUSB0", "/", "//", "socket://", "socket://host", "socket://host:0",
        "socket://host:65536", "socket://host:port", "socket://host:8101/more", "http://host:8101",
        "external:", "external:9000", "external:host:9000/x", "coppeliasim:host:23000",
        "coppeliasim:host:23000/", "/dev/tty\0USB0", "/dev/ttyUSB0\n", "simulated:lab",
    ],
)  # fmt: skip
def test_invalid_ports_are_refused_in_a_single_line(port: str) -> None:
    with pytest.raises(InputError) as refused:
        check_port(port)
    assert "\n" not in str(refused.value)
    with pytest.raises(InputError):
        open_robot(port, None)


SECRET = "0123456789abcdefSECRET"


@pytest.mark.parametrize(
    ("port", "shown"),
    [
        (f"external:0.0.0.0:7700?key={SECRET}", "external:0.0.0.0:7700"),
        ("external:127.0.0.1:7700", "external:127.0.0.1:7700"),
        (f"EXTERNAL:0.0.0.0:7700&KEY={SECRET}", "EXTERNAL:0.0.0.0:7700"),
        ("socket://10.0.0.7:8101", "socket://10.0.0.7:8101"),
        ("/dev/serial/by-id/usb-what?key=1", "/dev/serial/by-id/usb-what?key=1"),
        ("coppeliasim:localhost:23000/Pioneer#0", "coppeliasim:localhost:23000/Pioneer#0"),
    ],
)
def test_a_port_is_shown_without_its_key(port: str, shown: str) -> None:
    assert shown_port(port) == shown


@pytest.mark.parametrize(
    "port",
    [
        f"external:0.0.0.0:7700?kay={SECRET}", f"external:0.0.0.0:7700&key={SECRET}",
        f"external:7700?key={SECRET}", f"External:0.0.0.0:7700?key={SECRET}",
        f"socket://host?key={SECRET}", f"external:0.0.0.0:7700?key={SECRET}\n",
        f"external:0.0.0.0:7700?key={SECRET}!",
    ],
)  # fmt: skip
def test_no_error_contains_a_key(port: str) -> None:
    with pytest.raises(InputError) as refused:
        check_port(port)
    assert SECRET not in str(refused.value)


def test_an_unknown_model_is_refused_before_a_port_is_opened() -> None:
    with pytest.raises(InputError, match="no robot model 'roomba'"):
        open_robot("/dev/nonesuch", "roomba")


def test_a_serial_device_opens_as_a_pioneer() -> None:
    robot = open_robot("/dev/nonesuch", "amigo-sh")
    try:
        assert isinstance(robot, Pioneer)
        assert robot.report().model == "amigo-sh"
    finally:
        robot.close()
