"""Reading a recorded source to its end, with what it skipped."""

from __future__ import annotations

import pytest

from observer.sources.contract import NoFrame, SkippedFrame, Source
from observer.types import StereoFrame


def played(source: Source) -> list[StereoFrame | SkippedFrame]:
    result: list[StereoFrame | SkippedFrame] = []
    while (item := source.read()) is not None:
        assert not isinstance(item, NoFrame)
        result.append(item)
        assert len(result) < 1000
    return result


def frames(source: Source) -> list[StereoFrame]:
    return [item for item in played(source) if isinstance(item, StereoFrame)]


def reasons(source: Source) -> dict[int, str]:
    return {item.index: item.reason for item in played(source) if isinstance(item, SkippedFrame)}


def number_of(frame: StereoFrame) -> int:
    """Return the number that ``marked_image`` encoded; fail if left and right are swapped."""
    left, right = frame.left.mean(), frame.right.mean()
    assert right - left == pytest.approx(20, abs=1)
    return round((left - 40) / 4)
