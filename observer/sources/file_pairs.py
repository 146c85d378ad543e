"""Sequence of stereo pairs stored as image files, the base of all dataset layouts."""

from __future__ import annotations

import statistics
import time
from bisect import bisect_left
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path

from observer.camera import StereoCalibration
from observer.errors import CalibrationError, SourceError
from observer.image_files.listing import FilePair, MissingPair
from observer.image_files.reading import BitDepth, read_image
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.types import Image, StereoFrame

# Seconds. Nothing could be tracked at a longer interval, and no camera has a shorter one: such
# times are in another unit.
_LONGEST_INTERVAL_S = 4.0
_SHORTEST_INTERVAL_S = 2e-4
_UNITS_S = {"milliseconds": 1e-3, "microseconds": 1e-6, "nanoseconds": 1e-9}

# Returns the calibration for images of this width and height, None if there is none.
Calibrate = Callable[[int, int], StereoCalibration | None]


class FilePairSource:
    """Plays a list of image pairs; implements ``Source`` for every dataset layout.

    Frames whose files are missing, damaged, of another size or not later than their predecessor
    are skipped with the reason, as are pairs taken more than half an interval apart; the
    sequence's size is that of its first readable pair.

    Args:
        spec: the text it was opened by. kind: the layout's name, for people.
        entries: one for each frame, in order.
        calibrate: called once, with the images' size.

    Attributes:
        calibration: the one beside the images; None where there was none.
        calibration_notes: what was decided while it was read, one sentence each.

    Raises:
        SourceError: fewer than two pairs can be played, the times do not increase, or they are in
            another unit.
        CalibrationError: the calibration beside the images cannot be used with them.
    """

    def __init__(
        self,
        *,
        spec: str,
        kind: str,
        entries: Sequence[FilePair | MissingPair],
        calibrate: Calibrate,
    ) -> None:
        in_order = _without_time_jumps(entries, spec)
        interval = statistics.median(b.time - a.time for a, b in pairwise(_pairs(in_order, spec)))
        _check_interval(interval, spec)
        self._entries = _of_one_moment(in_order, interval / 2)
        pairs = _pairs(self._entries, spec)
        width, height = _first_size(pairs, spec)
        self.calibration = calibrate(width, height)
        self.calibration_notes: tuple[str, ...] = ()
        name = f"the calibration in {spec}"
        check_size(self.calibration, width, height, name=name, images="these")
        self.info = SourceInfo(
            spec=spec,
            kind=kind,
            width=width,
            height=height,
            frame_rate=1 / interval,
            frame_count=len(self._entries),
        )
        self._depth = BitDepth()
        self._next = 0

    def read(self) -> StereoFrame | SkippedFrame | None:
        if self._next >= len(self._entries):
            return None
        index = self._next
        entry = self._entries[index]
        self._next += 1
        if isinstance(entry, MissingPair):
            return SkippedFrame(index, entry.reason)
        try:
            left, right = self._image(entry.left), self._image(entry.right)
        except SourceError as error:
            return SkippedFrame(index, str(error))
        return StereoFrame(
            index=index,
            time=entry.time,
            left=left,
            right=right,
            received=time.monotonic(),
            right_time=entry.right_time,
        )

    def skip(self, count: int) -> None:
        """Skip frames without reading their files."""
        self._next += count

    def rewind(self) -> None:
        self._next = 0

    def close(self) -> None:
        """Do nothing: no file is kept open between reads."""

    def _image(self, path: Path) -> Image:
        image = read_image(path, self._depth)
        height, width = image.shape[:2]
        if (width, height) != (self.info.width, self.info.height):
            raise SourceError(
                f"{path.parent.name}/{path.name} is {width}x{height} pixels where the sequence "
                f"has {self.info.width}x{self.info.height}"
            )
        return image


def _pairs(entries: Sequence[FilePair | MissingPair], spec: str) -> list[FilePair]:
    """Return the entries that can be played; raise ``SourceError`` for fewer than two."""
    pairs = [entry for entry in entries if isinstance(entry, FilePair)]
    if len(pairs) < 2:
        found = "only one stereo pair" if pairs else "no stereo pair"
        why = next((e.reason for e in entries if isinstance(e, MissingPair)), "")
        raise SourceError(
            f"{spec} contains {found}{f' ({why})' if why else ''}; at least two are needed to "
            "detect motion"
        )
    return pairs


def _of_one_moment(
    entries: Sequence[FilePair | MissingPair], most_s: float
) -> list[FilePair | MissingPair]:
    """Return the entries, with pairs replaced whose images were taken further apart."""
    result: list[FilePair | MissingPair] = []
    for entry in entries:
        if isinstance(entry, FilePair) and entry.right_time is not None:
            apart = abs(entry.right_time - entry.time)
            if apart > most_s:
                entry = MissingPair(
                    f"the two images named {entry.left.name} were taken {apart:.3f} s apart"
                )
        result.append(entry)
    return result


def _first_size(pairs: Sequence[FilePair], spec: str) -> tuple[int, int]:
    first_problem = ""
    for pair in pairs:
        try:
            left, right = read_image(pair.left), read_image(pair.right)
        except SourceError as error:
            first_problem = first_problem or str(error)
            continue
        if left.shape[:2] == right.shape[:2]:
            return left.shape[1], left.shape[0]
        first_problem = first_problem or (
            f"{pair.left.name} is {left.shape[1]}x{left.shape[0]} pixels on the left and "
            f"{right.shape[1]}x{right.shape[0]} on the right"
        )
    raise SourceError(f"{spec} contains no usable image pair: {first_problem}")


def check_size(
    calibration: StereoCalibration | None, width: int, height: int, *, name: str, images: str
) -> None:
    """Refuse a calibration for images of another size, pixels; messages use ``name``, ``images``.

    Raises:
        CalibrationError: it is for another size.
    """
    if calibration is not None and (calibration.width, calibration.height) != (width, height):
        raise CalibrationError(
            f"{name} is for images of {calibration.width}x{calibration.height} pixels, but "
            f"{images} are {width}x{height}"
        )


def _check_interval(interval: float, spec: str) -> None:
    """Raise ``SourceError`` if times at such an interval are in another unit."""
    if interval < _SHORTEST_INTERVAL_S:
        raise SourceError(
            f"the times of {spec} are {interval:.3g} s apart, which no camera achieves; check "
            "their unit"
        )
    if interval <= _LONGEST_INTERVAL_S:
        return
    fitting = (unit for unit, s in _UNITS_S.items() if interval * s <= _LONGEST_INTERVAL_S)
    unit = next(fitting, "another unit")
    raise SourceError(
        f"the times of {spec} are {interval:g} s apart, so they seem to be in {unit}; they must be "
        "the exposure times in seconds"
    )


def _without_time_jumps(
    entries: Sequence[FilePair | MissingPair], spec: str
) -> list[FilePair | MissingPair]:
    """Return the entries, with pairs whose time breaks the increase replaced by missing ones."""
    result = list(entries)
    pairs = [(k, e) for k, e in enumerate(entries) if isinstance(e, FilePair)]
    kept = _longest_rise([pair.time for _, pair in pairs])
    if len(kept) < 2 <= len(pairs):
        raise SourceError(
            f"the times of {spec} do not increase from frame to frame; they must be the exposure "
            "times in seconds, in the order of the images"
        )
    for position, (k, pair) in enumerate(pairs):
        if position not in kept:
            result[k] = MissingPair(
                f"{pair.left.name} has the time {pair.time:g} s, which is not between those of the "
                "neighbouring frames"
            )
    return result


def _longest_rise(values: Sequence[float]) -> set[int]:
    """Return the positions of a longest strictly rising subsequence (patience sorting, O(n log n)).

    This drops the values that break the rise, not all that follow, so that a wrong time loses
    only its own frame, however wrong it is.
    """
    ends: list[float] = []  # smallest value that ends a rise of each length
    at: list[int] = []  # its position
    before: list[int] = []  # for each position, its predecessor in the best rise
    for position, value in enumerate(values):
        length = bisect_left(ends, value)
        before.append(at[length - 1] if length else -1)
        ends[length : length + 1] = [value]
        at[length : length + 1] = [position]
    kept: set[int] = set()
    position = at[-1] if at else -1
    while position >= 0:
        kept.add(position)
        position = before[position]
    return kept
