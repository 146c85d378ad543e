"""Frames of an opened source."""

from __future__ import annotations

from observer.opening import OpenedSource
from observer.types import StereoFrame


def frame_of(opened: OpenedSource) -> StereoFrame:
    """Read the next frame; anything else fails the test."""
    frame = opened.source.read()
    assert isinstance(frame, StereoFrame)
    return frame
