"""What goes into the storage and comes out of it: plain frozen data, no database in it.

Wall-clock times are ISO 8601 text in UTC with microseconds, e.g.
``2026-01-31T12:00:00.000000+00:00``: one fixed width, so that text order is time order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, Literal

from app.contract.robots import StopMeasured

SpeedSource = Literal["estimate", "truth", "commanded", "encoder"]


def utc_now() -> str:
    """The present moment as stored text."""
    return datetime.now(UTC).isoformat(timespec="microseconds")


class RunState(StrEnum):
    """Where a run stands. ``interrupted``: the process ended before the run did."""

    RUNNING = "running"
    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True)
class RunRecord:
    """One kept observation with all its settings.

    Attributes:
        parameters: every parameter at the start, dotted name -> value; later changes are
            ``ParameterRevision`` records of this run.
        versions: name -> version of what computed it.
        updated_at: the last sign of life; the end of an interrupted run.
        reason: why it failed or was interrupted, one sentence.
        tags: in the order of their text. notes: a person's own words.
        deleted_at: since when it is hidden, to be deleted for good later.
        rig: the text of ``rig.yaml`` at its start.
        record: which images are recorded: ``none``, ``jpeg`` or ``lossless``; None: nothing is.
        recording_bytes: the size of its recording, None where there is none.
        alignment: how the truth was laid over the run, as ``Alignment.as_dict``.
        truth_id: the truth file it is compared with.
        rerun_of: the run whose recording it observed again, which may be gone by now.
    """

    id: str
    name: str
    state: RunState
    source: str
    calibration_id: str | None
    preset: str | None
    parameters: dict[str, Any]
    started_at: str
    updated_at: str
    ended_at: str | None
    frames: int
    segments: int
    versions: dict[str, str]
    reason: str | None
    tags: tuple[str, ...] = ()
    notes: str = ""
    deleted_at: str | None = None
    rig: str | None = None
    record: str | None = None
    recording_bytes: int | None = None
    alignment: dict[str, Any] | None = None
    truth_id: str | None = None
    rerun_of: str | None = None

    @property
    def aligned(self) -> bool:
        """Whether motion capture was laid over it."""
        return self.alignment is not None


@dataclass(frozen=True)
class RunPage:
    """A part of the runs that were asked for, and how many there are in all."""

    runs: tuple[RunRecord, ...]
    total: int


@dataclass(frozen=True)
class TruthRecord:
    """A file of true motion that was uploaded.

    Attributes:
        id: SHA-256 of its content, hexadecimal.
        format: what it was understood as, a word of ``observer.truth.files``.
        file: its name in the folder ``truths`` of the data folder.
        info: what was understood of it (bodies, rate, gaps, ...), for lists.
        listed: False once a person deleted it while runs still refer to it.
    """

    id: str
    name: str
    format: str
    file: str
    info: dict[str, Any]
    created_at: str
    listed: bool = True


@dataclass(frozen=True)
class SpeedRow:
    """One speed of one body at one time. ``speed`` None is a gap, drawn as one.

    Attributes:
        time: source time, s.
        role: ``obstacle`` or ``observer``.
        source: who says so.
        track_id: the track or body it belongs to; None for what a robot says of itself.
        speed, std: m/s; a value that is not finite is unknown and becomes None.
        body: the name that motion capture gives to whose speed it is; None for other sources.
    """

    run_id: str
    time: float
    role: str
    source: SpeedSource
    track_id: int | None
    speed: float | None
    std: float | None
    segment: int
    body: str | None = None

    def __post_init__(self) -> None:
        if not math.isfinite(self.time):
            raise ValueError(f"a speed needs a finite time, not {self.time}")
        for name in ("speed", "std"):
            value = getattr(self, name)
            if value is not None and not math.isfinite(value):
                object.__setattr__(self, name, None)


@dataclass(frozen=True)
class IncidentRecord:
    """Something stopped a robot during a run, or took its motors away.

    Attributes:
        at: wall clock. role: None where all robots were meant.
        kind: as ``app.contract.drive.IncidentEvent``. sentence: for people.
        speed_mps: at that moment, None where unknown.
        stops: by role, of each robot that moved and whose stop was measured.
    """

    run_id: str
    at: str
    role: str | None
    kind: str
    sentence: str
    speed_mps: float | None
    stops: Mapping[str, StopMeasured] = field(default_factory=dict)


@dataclass(frozen=True)
class ParameterRevision:
    """Parameters changed: from ``frame`` on (None: no source was open) these differ."""

    run_id: str | None
    frame: int | None
    revision: int
    difference: dict[str, Any]
    created_at: str


@dataclass(frozen=True)
class SavedParameters:
    """The parameters as they were left; ``preset`` is None once something differs from it."""

    revision: int
    values: dict[str, Any]
    preset: str | None


@dataclass(frozen=True)
class PresetRecord:
    """Parameter values that a person saved under a name."""

    name: str
    values: dict[str, Any]
    created_at: str
    help: str = ""


@dataclass(frozen=True)
class CalibrationRecord:
    """A calibration that was uploaded or used by a run.

    Attributes:
        id: see ``calibration_id``.
        text: the file's own text, unchanged.
        info: what was understood of it (width, height, baseline_m, ...), for lists.
        listed: False once a person deleted it while runs still refer to it.
    """

    id: str
    name: str
    text: str
    created_at: str
    info: dict[str, Any] = field(default_factory=dict)
    listed: bool = True
