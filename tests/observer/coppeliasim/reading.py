"""Frames of an opened source, and the end of its simulation."""

from __future__ import annotations

from observer.coppeliasim.connection import Connection
from observer.opening import OpenedSource
from observer.types import StereoFrame

from ...waiting import until


def frame_of(opened: OpenedSource) -> StereoFrame:
    """Read the next frame; anything else fails the test."""
    frame = opened.source.read()
    assert isinstance(frame, StereoFrame)
    return frame


def wait_until_stopped(connection: Connection) -> None:
    """Wait until the simulation has stopped, which undoes any change made before."""
    stopped = connection.constant("simulation_stopped")
    until(lambda: connection.call("getSimulationState") == stopped)
