"""Addresses at which a server can be reached."""

from __future__ import annotations

import ipaddress
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from app import addresses
from app.addresses import ServerAddress, is_loopback, network_addresses


@pytest.mark.parametrize(
    ("address", "here"),
    [
        (ServerAddress("127.0.0.1", 8080), "http://127.0.0.1:8080"),
        (ServerAddress("0.0.0.0", 80), "http://localhost:80"),
        (ServerAddress("::", 80), "http://localhost:80"),
        (ServerAddress("::1", 443, tls=True), "https://[::1]:443"),
    ],
)
def test_the_address_for_this_computer_opens_in_a_browser(
    address: ServerAddress, here: str
) -> None:
    assert address.here == here


def show(monkeypatch: pytest.MonkeyPatch, interfaces: dict[str, list[str]]) -> None:
    """Make this a computer with these interfaces."""

    def at(address: str) -> Any:
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        return SimpleNamespace(family=family, address=address)

    monkeypatch.setattr(
        psutil, "net_if_addrs", lambda: {n: [at(a) for a in some] for n, some in interfaces.items()}
    )
    monkeypatch.setattr(
        psutil, "net_if_stats", lambda: {n: SimpleNamespace(isup=n != "eth9") for n in interfaces}
    )
    monkeypatch.setattr(addresses, "_CONTAINER_FILES", ())
    monkeypatch.setattr(addresses, "_outgoing", lambda: {"192.168.1.5", "2001:db8::5"})


@pytest.fixture
def networks(monkeypatch: pytest.MonkeyPatch) -> None:
    """A computer on cable and radio, with containers, a cut cable and link-local addresses."""
    interfaces = {
        "lo": ["127.0.0.1", "::1"],
        "wlan0": ["10.0.0.9", "fd00::9", "fe80::9%wlan0"],
        "eth0": ["192.168.1.5", "2001:db8::5"],
        "eth9": ["192.168.9.9"],
        "docker0": ["172.17.0.1"],
        "br-12ab": ["172.18.0.1"],
        "usb0": ["169.254.7.7"],
    }
    show(monkeypatch, interfaces)


@pytest.mark.usefixtures("networks")
def test_usable_addresses_are_listed_likeliest_first() -> None:
    assert network_addresses() == ("192.168.1.5", "10.0.0.9", "2001:db8::5", "fd00::9")


@pytest.mark.usefixtures("networks")
def test_addresses_for_other_computers_list_names_first() -> None:
    lab = ServerAddress("0.0.0.0", 8080, allowed_hosts=("lab.example", "proxy.example:8443"))
    assert lab.elsewhere == (
        "http://lab.example:8080",
        "http://proxy.example:8443",
        "http://192.168.1.5:8080",
        "http://10.0.0.9:8080",
    )
    both = ServerAddress("::", 8080, tls=True).elsewhere
    assert both[0] == "https://192.168.1.5:8080"
    assert "https://[fd00::9]:8080" in both
    assert ServerAddress("10.0.0.9", 8080).elsewhere == ("http://10.0.0.9:8080",)
    for alone in ("127.0.0.1", "localhost", "::1"):
        assert is_loopback(alone)
        assert ServerAddress(alone, 8080).elsewhere == ()


@pytest.mark.usefixtures("networks")
def test_container_network_addresses_are_omitted_inside_a_container(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    inside = {"eth0": ["172.17.0.2", "fd00::2"], "eth1": ["10.88.0.9"], "eth2": ["192.168.1.5"]}
    show(monkeypatch, inside)
    assert network_addresses() == ("192.168.1.5", "172.17.0.2", "10.88.0.9", "fd00::2")
    monkeypatch.setattr(addresses, "_CONTAINER_FILES", (tmp_path,))
    assert network_addresses() == ("192.168.1.5", "fd00::2")


def test_the_addresses_of_this_computer_are_valid_and_not_loopback() -> None:
    for each in network_addresses():
        assert not ipaddress.ip_address(each).is_loopback
