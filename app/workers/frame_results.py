"""Per-frame results that a worker writes for the server, as JSON lines."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
from typing_extensions import TypedDict

from app.contract.events import LiveLine
from observer.jsonl import ObservationLine, StateWord
from observer.truth.matching import TrueBodyEntry


class SeenSpeed(TypedDict):
    """Part of an ``observer.jsonl.ObstacleEntry`` that the server keeps."""

    id: int
    state: StateWord
    velocity_time: float
    speed: float
    speed_std: float | None


@dataclass(frozen=True)
class FrameResult:
    """Part of one frame's result that the server keeps.

    Attributes:
        time, segment: as in the observation's JSON line.
        truth: as in ``ObservationEvent.truth``.
        offset_s: offset of the run's clock from the source's.
    """

    time: float
    segment: int
    obstacles: Sequence[SeenSpeed]
    truth: Sequence[TrueBodyEntry]
    offset_s: float = 0.0


def frame_result(
    line: ObservationLine | LiveLine, truth: Sequence[TrueBodyEntry], offset_s: float = 0.0
) -> FrameResult:
    """Return what the server keeps of an observation's JSON line and its ground truth."""
    obstacles: list[SeenSpeed] = [
        {
            "id": each["id"],
            "state": each["state"],
            "velocity_time": each["velocity_time"],
            "speed": each["speed"],
            "speed_std": each["speed_std"],
        }
        for each in line["obstacles"]
    ]
    return FrameResult(line["time"], line["segment"], obstacles, truth, offset_s)


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
