"""Recorded runs: their history, comparison with ground truth, and charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.parameters import StoredValues
from app.contract.values import means
from observer.recording.payloads import Images

SpeedSource = Literal["estimate", "truth", "commanded", "encoder"]


@dataclass(frozen=True)
class Run:
    id: str
    name: str
    state: Literal["running", "finished", "interrupted", "failed"]
    source: str
    source_name: Annotated[
        str, means("Display name: the run whose recording is the source, or the source itself.")
    ]
    calibration_id: str | None
    preset: str | None
    parameters: StoredValues
    started_at: str
    updated_at: str
    ended_at: str | None
    begin_s: Annotated[
        float | None, means("Source time of the first kept frame, where the run's time begins.")
    ]
    duration_s: Annotated[
        float | None,
        means(
            "The run's length: from its first to its last recorded frame on the source's "
            "clock, which continues if the engine was replaced. null without a frame."
        ),
    ]
    frames: int
    segments: int
    versions: Mapping[str, str]
    reason: str | None
    record: Annotated[
        Images | None,
        means("Which images are recorded; null: nothing is recorded."),
    ]
    recording_bytes: int | None
    tags: Annotated[Sequence[str], means("In alphabetical order.")]
    notes: Annotated[str, means("Free text.")]
    truth_id: Annotated[str | None, means("The ground-truth file that it is compared with.")]
    aligned: Annotated[bool, means("Whether motion capture was aligned with it.")]
    rerun_of: Annotated[str | None, means("The run that this is a re-run of.")]
    deleted_at: Annotated[str | None, means("Time of its deletion.")]


@dataclass(frozen=True)
class StartedRun(Run):
    parameter_notes: Annotated[
        Sequence[str],
        means("One sentence on each given parameter that does not act with the method."),
    ]


@dataclass(frozen=True)
class DiskUse:
    used_bytes: Annotated[int, means("Space used by the data folder.")]
    free_bytes: int


@dataclass(frozen=True)
class History:
    runs: Annotated[Sequence[Run], means("Newest first.")]
    total: Annotated[int, means("How many there are in all.")]
    tags: Annotated[Mapping[str, int], means("Every tag with the number of runs that have it.")]
    disk: DiskUse
    undo_days: Annotated[float, means("Days for which a deleted run can be restored.")]


@dataclass(frozen=True)
class SpeedEntry:
    time: Annotated[float, means("On the run's clock, s.")]
    role: str
    source: SpeedSource
    track_id: Annotated[int | None, means("null for values that a robot reports of itself.")]
    speed: Annotated[float | None, means("m/s; null is a gap.")]
    std: float | None
    segment: int


@dataclass(frozen=True)
class ChartCurve:
    """One curve: arrays of one length."""

    kind: SpeedSource
    label: str
    role: str
    track_id: int | None
    body: Annotated[str | None, means("The body of the curve, or to which its track was matched.")]
    segment: Annotated[int | None, means("null if it covers the whole run.")]
    times: Annotated[Sequence[float], means("On the run's clock, s.")]
    speeds: Annotated[Sequence[float | None], means("m/s; null is a gap.")]
    stds: Annotated[Sequence[float | None] | None, means("Standard deviations, m/s.")]


@dataclass(frozen=True)
class IdentityChange:
    """A body continues under another track; tracks are named SEGMENT:NUMBER."""

    time: float
    body: str
    before: str
    after: str


@dataclass(frozen=True)
class SpeedErrorsEntry:
    """Speed errors of one group of samples; null: no samples."""

    group: Literal["all", "body", "track", "direction", "way"]
    label: str
    body: str | None
    samples: int
    bias_mps: float | None
    rmse_mps: float | None
    maximum_mps: float | None
    coverage: Annotated[float | None, means("Share within the 95 % interval.")]
    covered_of: int
    seen_share: float | None


@dataclass(frozen=True)
class AlignmentMatch:
    body: Annotated[str | None, means("null: the track belongs to no body.")]
    by: str
    distance_m: float | None


@dataclass(frozen=True)
class CameraOnBodyFacts:
    """Pose of the left camera on a body of motion capture, in the body's axes."""

    x_m: float
    y_m: float
    z_m: float
    pan_deg: Annotated[float, means("About the body's z, from x towards y.")]
    tilt_deg: Annotated[float, means("Away from the body's z, down where z is up.")]
    roll_deg: Annotated[float, means("Clockwise as seen from behind the camera.")]


@dataclass(frozen=True, kw_only=True)
class AlignmentFacts:
    """Alignment of ground truth with a run."""

    offset_s: Annotated[float, means("Offset to add to the times of the ground truth.")]
    sigma_s: float
    drift_ppm: float
    drift_sigma_ppm: float | None
    correlation: float
    overlap_s: float
    residual_mps: float
    samples: int
    frame_residual_m: Annotated[float | None, means("null: only the clocks are aligned.")]
    observer: str | None
    camera_on_body: Annotated[
        CameraOnBodyFacts | None,
        means("Pose of the camera on the observer's body; null if unknown."),
    ] = None
    roles: Mapping[str, str]
    matches: Annotated[Mapping[str, AlignmentMatch], means("By track, SEGMENT:NUMBER.")]
    notes: Sequence[str]


@dataclass(frozen=True)
class AlignedRunEntry(Run):
    """A run with the ground truth just aligned with it."""

    alignment: Annotated[
        AlignmentFacts | None, means("null: the ground truth was on the run's clock.")
    ]
    sentence: str


@dataclass(frozen=True)
class AlignChoicesEntry:
    """A person's choices before ground truth was aligned with a run."""

    observer: str | None
    ignore: Sequence[str]
    matches: Annotated[Mapping[str, str | None], means("By track, SEGMENT:NUMBER.")]
    expected_offset_s: float | None
    camera_on_body: CameraOnBodyFacts | None


@dataclass(frozen=True)
class ChartValues:
    aligned: Annotated[bool, means("Whether there is ground truth to compare with.")]
    sentence: Annotated[str | None, means("Where ground truth comes from, or why there is none.")]
    alignment: AlignmentFacts | None
    curves: Sequence[ChartCurve]
    changes: Sequence[IdentityChange]
    errors: Sequence[SpeedErrorsEntry]


@dataclass(frozen=True)
class RunChart(ChartValues):
    run: Run
    choices: Annotated[
        AlignChoicesEntry | None,
        means("Choices made for the alignment; null if there is none."),
    ]


@dataclass(frozen=True)
class ClipFile:
    file: Annotated[str, means("Within the data folder; it opens as any recording does.")]
    bytes: int
    seconds: Annotated[float, means("Its duration.")]


@dataclass(frozen=True)
class ClipEntry:
    """A saved half minute."""

    name: str
    run_id: Annotated[str | None, means("The run that was in progress.")]
    saved_at: str
    bytes: int
    source: Annotated[str, means("Text that opens it as a source.")]
