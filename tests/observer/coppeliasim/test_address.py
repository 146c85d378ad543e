"""Texts that name a simulator, or a robot in its scene."""

from __future__ import annotations

import pytest

from observer.coppeliasim.address import Address, parse_address, parse_robot
from observer.errors import InputError, SourceError
from observer.opening import exclusive_world, live_devices, shown_spec


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("192.168.1.7:23001", "192.168.1.7", 23001),
        ("lab-pc", "lab-pc", 23000),
        ("", "127.0.0.1", 23000),
        (":23002", "127.0.0.1", 23002),
    ],
)
def test_missing_host_and_port_get_defaults(text: str, host: str, port: int) -> None:
    assert parse_address(text) == Address(host, port)


@pytest.mark.parametrize("text", ["pc:0", "pc:65536", "pc:x", "a b:1", "a/b:1", "::1:23000"])
def test_an_invalid_address_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(SourceError, match=r"coppeliasim:127\.0\.0\.1:23000"):
        parse_address(text)


def test_a_robot_is_named_by_its_path() -> None:
    address, path = parse_robot("coppeliasim:127.0.0.1:23000/PioneerP3DX[1]")
    assert (str(address), path) == ("127.0.0.1:23000", "/PioneerP3DX[1]")
    for wrong in ("coppeliasim:127.0.0.1:23000", "coppeliasim:127.0.0.1:23000/", "/dev/ttyUSB0"):
        with pytest.raises(InputError):
            parse_robot(wrong)


def test_one_simulator_is_one_exclusive_world() -> None:
    assert exclusive_world("coppeliasim:") == exclusive_world("CoppeliaSim:127.0.0.1:23000")
    assert exclusive_world("coppeliasim:a:1") != exclusive_world("coppeliasim:a:2")
    for other in ("simulated:lab", "/tmp/folder", "camera:0,1", "coppeliasim:a:b"):
        assert exclusive_world(other) is None
    assert live_devices("coppeliasim:") == ()
    assert shown_spec("coppeliasim:a:1") == "coppeliasim:a:1"
