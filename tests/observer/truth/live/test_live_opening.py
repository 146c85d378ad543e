"""Texts that name live motion capture."""

from __future__ import annotations

import pytest

from observer.errors import TruthError
from observer.truth.live.opening import check_live


@pytest.mark.parametrize(
    "spec",
    [
        "vrpn:vicon.lab",
        "vrpn:10.0.0.5:3884",
        "vrpn:[::1]:3883/Robot,Cart 2",
        "VRPN:host/Robot",
        "vicon-udp:51001",
        "vicon-udp:",
    ],
)
def test_valid_live_addresses_are_accepted(spec: str) -> None:
    check_live(spec)


@pytest.mark.parametrize(
    ("spec", "words"),
    [
        ("vrpn:", "has no host"),
        ("vrpn:ho st", "has no host"),
        ("vrpn:host:0", "port from 1 to 65535"),
        ("vrpn:host:65536", "port from 1 to 65535"),
        ("vicon-udp:x", "port from 1 to 65535"),
        ("vicon-udp:99999", "port from 1 to 65535"),
        ("truth.csv", "live motion capture is given as vrpn:HOST"),
    ],
)
def test_invalid_live_addresses_are_refused_with_a_reason(spec: str, words: str) -> None:
    with pytest.raises(TruthError, match=words):
        check_live(spec)
