"""A window of a run's frame results, cut out of the stored JSON of all frames.

An hour of frames takes tens of megabytes, of which a page shows one frame at a time.
"""

from __future__ import annotations

import msgspec

from app.contract.frame_plan import PlanMap


class _Frames(msgspec.Struct):
    """``app.contract.run_frames.RunFrames`` with each frame left as undecoded JSON."""

    width: int
    height: int
    frames: list[msgspec.Raw]
    truth: bool
    observed_ms: float | None
    first: int
    every: int
    count: int
    maps: list[PlanMap]


def some_frames(content: bytes, first: int, count: int | None, most: int | None) -> bytes:
    """Return the JSON of a window of frames, or of some that are evenly spaced within it.

    Args:
        content: JSON of all frames.
        first: position of the first frame. count: size of the window; None: all from there on.
        most: maximum number of frames to return; None: all.
    """
    found = msgspec.json.decode(content, type=_Frames)
    end = found.count if count is None else min(first + count, found.count)
    inside = max(0, end - first)
    found.every = 1 if most is None else max(1, -(-inside // most))
    found.first = first
    found.frames = found.frames[first : end : found.every]
    near = found.maps if found.every == 1 else []
    found.maps = [one for one in near if one.first < end and one.last >= first]
    return msgspec.json.encode(found)
