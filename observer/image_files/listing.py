"""Listing of image files: pairs matched by name, times matched by line."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from observer.errors import SourceError
from observer.image_files.reading import IMAGE_SUFFIXES
from observer.text_files import NUMBER


@dataclass(frozen=True)
class FilePair:
    """The files of one frame; times are the exposures on the source's clock, seconds."""

    left: Path
    right: Path
    time: float
    right_time: float | None = None


@dataclass(frozen=True)
class MissingPair:
    """A frame that is known to be missing, and the sentence that says why."""

    reason: str


def image_names(folder: Path) -> list[str]:
    """Names of the image files in a folder, sorted with numbers in numerical order.

    Raises:
        SourceError: the folder is missing, unreadable or without images.
    """
    try:
        names = [p.name for p in folder.iterdir() if p.suffix.lower() in IMAGE_SUFFIXES]
    except FileNotFoundError:
        raise SourceError(f"the folder {folder} is missing") from None
    except OSError as error:
        raise SourceError(f"the folder {folder} cannot be read: {error.strerror}") from None
    # macOS leaves files on foreign disks that look like images but are not.
    names = [name for name in names if not name.startswith(".")]
    if not names:
        raise SourceError(
            f"the folder {folder} contains no images (PNG, JPEG, BMP, PGM, TIFF, WebP)"
        )
    return sorted(names, key=natural_order)


def natural_order(name: str) -> tuple[tuple[int, str, str], ...]:
    """Sorting key that puts ``2.png`` before ``10.png``."""
    parts = re.findall(r"(\d+)|(\D+)", name, re.ASCII)
    # Numbers are compared as text, the longer being greater: int() refuses thousands of digits.
    numbers = ((digits.lstrip("0"), text) for digits, text in parts)
    return tuple((len(number), number, text) for number, text in numbers)


def read_times(path: Path) -> list[float]:
    """Read times in seconds, one a line; empty lines and lines that begin with # do not count.

    Raises:
        SourceError: the file is missing or a line is not a finite number.
    """
    times = []
    for number, line in read_lines(path):
        # Python also accepts 1_000 and the digits of other scripts, which are never meant here.
        value = float(line) if NUMBER.fullmatch(line) else math.nan
        if not math.isfinite(value):
            raise SourceError(
                f"{path.name} line {number} must be a time in seconds, not {line[:40]!r}"
            )
        times.append(value)
    return times


def read_lines(path: Path) -> list[tuple[int, str]]:
    """The lines of a text file with their numbers, without empty lines and # comments.

    Raises:
        SourceError: the file is missing, unreadable or not text.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise SourceError(
            f"{path} is missing; speeds cannot be measured without the time of each frame"
        ) from None
    except OSError as error:
        raise SourceError(f"{path} cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise SourceError(f"{path.name} must be a text file") from None
    lines = ((k, line.strip()) for k, line in enumerate(text.splitlines(), 1))
    return [(k, line) for k, line in lines if line and not line.startswith("#")]


def pairs_by_name(
    left: Path,
    right: Path,
    times: Sequence[float],
    times_name: str,
    right_times: Sequence[float] | None = None,
) -> list[FilePair | MissingPair]:
    """One entry for each frame of two folders with equal file names.

    Line n of the times belongs to the n-th name. If there are more or fewer times than names,
    names that are numbers are taken as line numbers from 0, so that a lost image shifts no times;
    with other names the match is unknown, and the sequence is refused. ``right_times`` are the
    right images' own times, for the same lines; beyond their end the times are unknown.

    Raises:
        SourceError: a folder cannot be used, no name is in both, or the counts do not match.
    """
    left_names, right_names = set(image_names(left)), set(image_names(right))
    names = sorted(left_names | right_names, key=natural_order)
    if not left_names & right_names:
        raise SourceError(
            f"no file name occurs in both {left.name} and {right.name} of {left.parent}; the two "
            "images of a pair must have the same name"
        )
    by_line = dict(enumerate(names))
    if len(times) != len(names):
        by_line = _by_number(names)
        if len(by_line) != len(names) or not any(line < len(times) for line in by_line):
            raise SourceError(
                f"{times_name} contains {len(times)} times for {len(names)} image pairs in "
                f"{left.parent}; it needs one line per pair"
            )
    entries: list[FilePair | MissingPair] = []
    for line in range(min(by_line), max(by_line) + 1):
        name = by_line.get(line)
        if name is None:
            entries.append(MissingPair(f"frame {line} is missing in {left.name} and {right.name}"))
        elif name not in left_names:
            entries.append(MissingPair(f"{name} is missing in {left.name}"))
        elif name not in right_names:
            entries.append(MissingPair(f"{name} is missing in {right.name}"))
        elif line >= len(times):
            entries.append(MissingPair(f"{name} has no time: {times_name} ends before it"))
        else:
            right_time = right_times[line] if right_times and line < len(right_times) else None
            entries.append(FilePair(left / name, right / name, times[line], right_time))
    beyond = len(times) - 1 - max(by_line)
    if beyond > 0:
        entries.append(MissingPair(f"{times_name} has {beyond} more lines after the last image"))
    return entries


def _by_number(names: Sequence[str]) -> dict[int, str]:
    """Names that consist of a number, by that number; fewer than ``names`` if some do not."""
    found = {}
    for name in names:
        stem = Path(name).stem
        if stem.isascii() and stem.isdecimal() and len(stem) <= 9:
            found[int(stem)] = name
    return found
