"""Per-frame results that a worker writes for the server, as JSON lines."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

_OBSTACLE = ("id", "state", "velocity_time", "speed", "speed_std")


@dataclass(frozen=True)
class FrameResult:
    """Part of one frame's result that the server keeps.

    Attributes:
        line: ``time``, ``segment`` and ``obstacles`` of the observation's JSON line.
        truth: entries as in ``ObservationEvent.truth``.
        offset_s: offset of the run's clock from the source's.
    """

    line: dict[str, Any]
    truth: list[dict[str, Any]]
    offset_s: float = 0.0


def frame_result(
    line: Mapping[str, Any], truth: Iterable[Mapping[str, Any]], offset_s: float = 0.0
) -> FrameResult:
    """Return what the server keeps of an observation's JSON line and its ground truth."""
    obstacles = [{name: each[name] for name in _OBSTACLE} for each in line["obstacles"]]
    kept = {"time": line["time"], "segment": line["segment"], "obstacles": obstacles}
    return FrameResult(kept, [dict(each) for each in truth], offset_s)


def result_line(result: FrameResult) -> bytes:
    """Return the result as one line of a results file."""
    return msgspec.json.encode(result) + b"\n"


def read_results(path: Path) -> Iterator[FrameResult]:
    """Yield the results of a file.

    Raises:
        OSError: the file cannot be read. msgspec.MsgspecError: it is damaged.
    """
    decode = msgspec.json.Decoder(FrameResult).decode
    with path.open("rb") as lines:
        yield from map(decode, lines)
