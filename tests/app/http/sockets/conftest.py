"""A simulated world to drive in."""

from __future__ import annotations

from typing import Any

import pytest

from observer.robots.contract import RobotPort


@pytest.fixture
def world(peer: Any) -> None:
    """A simulated world with both robots."""
    peer.world = "simulated:lab/1"
    peer.robots = (
        RobotPort("observer", "socket://127.0.0.1:5001", "amigo-sh", "the observer"),
        RobotPort("obstacle", "socket://127.0.0.1:5002", "amigo-sh", "the obstacle"),
    )
