"""Records that enter and leave the storage: plain frozen data without a database.

Wall-clock times are ISO 8601 text in UTC with microseconds, e.g.
``2026-01-31T12:00:00.000000+00:00``: one fixed width, so that text order is time order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from app.contract.parameters import StoredValues
from app.contract.robots import StopMeasured
from app.contract.runs import SpeedSource
from app.contract.values import JsonObject
from observer.recording.payloads import Images


def utc_now() -> str:
    """Return the present time as stored text."""
    return datetime.now(UTC).isoformat(timespec="microseconds")


def mapping(stored: Any) -> JsonObject:
    """Return a stored map; an empty one where the row was damaged by hand."""
    return stored if isinstance(stored, dict) else {}


class RunState(StrEnum):
    """State of a run. ``interrupted``: the process ended before the run did."""

    RUNNING = "running"
    FINISHED = "finished"
    INTERRUPTED = "interrupted"
    FAILED = "failed"


@dataclass(frozen=True)
class RunRecord:
    """Run with all its settings.

    Attributes:
        begin_s, duration_s: source's time of its first frame, and its length on that clock, as
            ``observer.recording.run_time`` says; None without a frame, or before they were kept.
        parameters: every parameter at the start, dotted name -> value; later changes are
            ``ParameterRevision`` records of this run.
        versions: name -> version of the software that computed it.
        updated_at: the last heartbeat; the end of an interrupted run.
        reason: why it failed or was interrupted, one sentence.
        tags: sorted by text. notes: the user's own words.
        deleted_at: time of hiding; it is permanently deleted later.
        rig: text of ``rig.yaml`` at its start.
        record: which images are recorded: ``none``, ``jpeg`` or ``lossless``; None: no
            recording.
        recording_bytes: size of its recording, None if there is none.
        alignment: alignment of the truth with the run, as ``Alignment.as_dict``.
        truth_id: truth file for its comparison.
        rerun_of: the run whose recording it re-ran, which may be gone by now.
        recording_name: name for people if ``source`` is the recording of a run.
    """

    id: str
    name: str
    state: RunState
    source: str
    calibration_id: str | None
    preset: str | None
    parameters: StoredValues
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
    record: Images | None = None
    recording_bytes: int | None = None
    alignment: JsonObject | None = None
    truth_id: str | None = None
    rerun_of: str | None = None
    begin_s: float | None = None
    duration_s: float | None = None
    recording_name: str | None = None

    @property
    def source_name(self) -> str:
        """Return what people call its source."""
        return self.recording_name or self.source

    @property
    def aligned(self) -> bool:
        """Return whether motion capture was aligned with it."""
        return self.alignment is not None


@dataclass(frozen=True)
class RunPage:
    """Page of the requested runs, and their total number."""

    runs: tuple[RunRecord, ...]
    total: int


@dataclass(frozen=True)
class TruthRecord:
    """Uploaded file of ground truth.

    Attributes:
        id: SHA-256 of its content, hexadecimal.
        format: recognised format, a word of ``observer.truth.files``.
        file: its name in the folder ``truths`` of the data folder.
        info: recognised contents (bodies, rate, gaps, ...), for lists.
        listed: False once a user deleted it while runs still refer to it.
    """

    id: str
    name: str
    format: str
    file: str
    info: JsonObject
    created_at: str
    listed: bool = True


@dataclass(frozen=True)
class SpeedRow:
    """Speed of one body at one time. ``speed`` None is a gap, drawn as one.

    Attributes:
        time: on the run's clock, s: source time, continued when an engine is replaced.
        role: ``obstacle`` or ``observer``.
        source: origin of the value.
        track_id: its track or body; None for what a robot reports about itself.
        speed, std: m/s; a value that is not finite is unknown and becomes None.
        body: name of the body in motion capture; None for other sources.
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
    """Incident that stopped a robot during a run, or switched its motors off.

    Attributes:
        at: wall clock. role: None if it concerns all robots.
        kind: as ``app.contract.drive.IncidentEvent``. sentence: for people.
        speed_mps: speed at that moment, None if unknown.
        stops: by role, for each robot that moved and whose stop was measured.
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
    """Change of parameters: from ``frame`` on (None: no source was open) these differ."""

    run_id: str | None
    frame: int | None
    revision: int
    difference: StoredValues
    created_at: str


@dataclass(frozen=True)
class SavedParameters:
    """Last parameters.

    Attributes:
        preset: None once a value differs from it. based_on: the preset that they come from.
    """

    revision: int
    values: StoredValues
    preset: str | None
    based_on: str | None = None


@dataclass(frozen=True)
class PresetRecord:
    """Parameter values saved by a user under a name."""

    name: str
    values: StoredValues
    created_at: str
    help: str = ""


@dataclass(frozen=True)
class CalibrationRecord:
    """Calibration that was uploaded or used by a run.

    Attributes:
        id: see ``calibration_id``.
        text: the file's own text, unchanged.
        info: recognised contents (width, height, baseline_m, ...), for lists.
        listed: False once a user deleted it while runs still refer to it.
    """

    id: str
    name: str
    text: str
    created_at: str
    info: JsonObject = field(default_factory=dict)
    listed: bool = True
