"""What goes in and out of the routes of runs: kept, found again, compared with truth, drawn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field

from app.http.api.robot_models import ProgrammeStart
from app.http.api.values import Changes, Finite, Identifier, In, Name, Spec, Tag, Text, notes_on
from app.storage import RunRecord
from observer.truth.alignment.camera_on_body import FARTHEST_M, LARGEST_DEG

Track = Annotated[str, Field(pattern=r"^\d{1,9}[/:]\d{1,9}$")]
Body = Annotated[
    str, Field(strict=True, min_length=1, max_length=200, pattern=r"^[^\x00-\x1f\x7f]+$")
]


class RunStart(In):
    name: Name | None = None
    source: Spec | None = Field(None, description="None: what is open.")
    calibration: Identifier | None = Field(None, description="None: the source's own.")
    preset: Name | None = None
    parameters: Changes = Field(default_factory=dict, description="Made to the preset, if any.")
    programme: ProgrammeStart | None = Field(
        None, description="Driven from the run's beginning, and ended with it."
    )
    record: Literal["none", "jpeg", "lossless"] = Field(
        "jpeg", description="Which images its recording keeps; all else is always recorded."
    )


class Run(BaseModel):
    id: str
    name: str
    state: Literal["running", "finished", "interrupted", "failed"]
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
    record: Literal["none", "jpeg", "lossless"] | None = Field(
        description="Which images are recorded; None: nothing is."
    )
    recording_bytes: int | None
    tags: list[str] = Field(description="In the order of their text.")
    notes: str = Field(description="A person's own words.")
    truth_id: str | None = Field(description="The truth file that it is compared with.")
    aligned: bool = Field(description="Whether motion capture was laid over it.")
    rerun_of: str | None = Field(description="The run whose recording it observed again.")
    deleted_at: str | None = Field(description="Since when it is hidden.")


class StartedRun(Run):
    parameter_notes: list[str] = Field(
        description="One sentence on each given parameter that does not act with the method."
    )

    @classmethod
    def of(cls, run: RunRecord, given: Iterable[str]) -> StartedRun:
        """Return a run that was just started with these parameters, by dotted name."""
        facts = Run.model_validate(run, from_attributes=True).model_dump()
        return cls(**facts, parameter_notes=notes_on(given, run.parameters))


class RunChange(In):
    """What is given is changed."""

    name: Name | None = None
    tags: Annotated[list[Tag], Field(max_length=50)] | None = Field(
        None, description="All of them, in place of those before."
    )
    notes: Text | None = None


class DiskUse(BaseModel):
    used_bytes: int = Field(description="By the data folder.")
    free_bytes: int


class History(BaseModel):
    runs: list[Run] = Field(description="Newest first.")
    total: int = Field(description="How many there are in all.")
    tags: dict[str, int] = Field(description="Every tag, and how many runs bear it.")
    disk: DiskUse
    undo_days: float = Field(description="How long a deleted run can be had back.")


class SpeedEntry(BaseModel):
    time: float = Field(description="Source time, s.")
    role: str
    source: Literal["estimate", "truth", "commanded", "encoder"]
    track_id: int | None = Field(description="None for what a robot says of itself.")
    speed: float | None = Field(description="m/s; None is a gap.")
    std: float | None
    segment: int


class ChartCurve(BaseModel):
    """One curve: arrays of one length."""

    kind: Literal["estimate", "truth", "commanded", "encoder"]
    label: str
    role: str
    track_id: int | None
    body: str | None = Field(description="Which body it is of, or was taken for.")
    segment: int | None = Field(description="None where it is of the whole run.")
    times: list[float] = Field(description="Source time, s.")
    speeds: list[float | None] = Field(description="m/s; None is a gap.")
    stds: list[float | None] | None = Field(description="Standard deviations, m/s.")


class IdentityChange(BaseModel):
    """Another track took a body's place; tracks are named SEGMENT:NUMBER."""

    time: float
    body: str
    before: str
    after: str


class SpeedErrorsEntry(BaseModel):
    """Errors of speed of one group of samples; None is what there is nothing to draw from."""

    group: Literal["all", "body", "track", "direction", "way"]
    label: str
    body: str | None
    samples: int
    bias_mps: float | None
    rmse_mps: float | None
    maximum_mps: float | None
    coverage: float | None = Field(description="Share within the band of 95 %.")
    covered_of: int
    seen_share: float | None


class AlignmentMatch(BaseModel):
    body: str | None = Field(description="None: the track belongs to none.")
    by: str
    distance_m: float | None


class CameraOnBodyFacts(BaseModel):
    """Where the left camera sits on a body of motion capture, in the body's axes."""

    x_m: float
    y_m: float
    z_m: float
    pan_deg: float = Field(description="About the body's z, from x towards y.")
    tilt_deg: float = Field(description="Away from the body's z, down where z is up.")
    roll_deg: float = Field(description="Clockwise as seen from behind the camera.")


def _up_to(limit: float) -> Any:
    return Field(ge=-limit, le=limit)


class CameraOnBodyIn(In):
    """With all angles 0 it looks along the body's x and has the body's z above."""

    x_m: Annotated[Finite, _up_to(FARTHEST_M)]
    y_m: Annotated[Finite, _up_to(FARTHEST_M)]
    z_m: Annotated[Finite, _up_to(FARTHEST_M)]
    pan_deg: Annotated[Finite, _up_to(LARGEST_DEG["pan_deg"])]
    tilt_deg: Annotated[Finite, _up_to(LARGEST_DEG["tilt_deg"])]
    roll_deg: Annotated[Finite, _up_to(LARGEST_DEG["roll_deg"])]


class AlignmentFacts(BaseModel):
    """How truth was laid over a run."""

    offset_s: float = Field(description="To be added to truth's times.")
    sigma_s: float
    drift_ppm: float
    drift_sigma_ppm: float | None
    correlation: float
    overlap_s: float
    residual_mps: float
    samples: int
    frame_residual_m: float | None = Field(description="None: only the clocks are aligned.")
    observer: str | None
    camera_on_body: CameraOnBodyFacts | None = Field(
        None, description="Of the observer's body; None where it is not known."
    )
    roles: dict[str, str]
    matches: dict[str, AlignmentMatch] = Field(description="By track, SEGMENT:NUMBER.")
    notes: list[str]


class AlignedRunEntry(Run):
    """A run with the truth that was just laid over it."""

    alignment: AlignmentFacts | None = Field(description="None: truth was on the run's clock.")
    sentence: str


class AlignStart(In):
    truth_id: Name | None = Field(
        None, description="None: the motion capture that was received live with the run."
    )
    observer: Body | None = Field(
        None, description="The body that carries the cameras; none: it is found out."
    )
    ignore: Annotated[list[Body], Field(max_length=200)] = Field(
        default_factory=list, description="Bodies that are neither observer nor obstacle."
    )
    matches: Annotated[dict[Track, Body | None], Field(max_length=500)] = Field(
        default_factory=dict,
        description="Which body a track (SEGMENT/NUMBER) is, null: none of them.",
    )
    expected_offset_s: Annotated[Finite, Field(ge=-1e12, le=1e12)] | None = Field(
        None,
        description="To be added to truth's times, to within 2 s; for motions that repeat "
        "themselves. None: it is found out.",
    )
    camera_on_body: CameraOnBodyIn | None = Field(
        None,
        description="Of the left camera, on the observer's body. None: it is found out, or as the "
        "rig says.",
    )


class AlignChoicesEntry(BaseModel):
    """What a person said before truth was laid over a run."""

    observer: str | None
    ignore: list[str]
    matches: dict[str, str | None] = Field(description="By track, SEGMENT:NUMBER.")
    expected_offset_s: float | None
    camera_on_body: CameraOnBodyFacts | None


class RerunStart(In):
    name: Name | None = None
    preset: Name | None = None
    parameters: Changes = Field(
        default_factory=dict, description="Made to the preset, or to the run's own."
    )


class RunChart(BaseModel):
    run: Run
    aligned: bool = Field(description="Whether there is truth to compare with.")
    sentence: str | None = Field(description="Where truth comes from, or why there is none.")
    alignment: AlignmentFacts | None
    choices: AlignChoicesEntry | None = Field(
        description="What was said for the alignment; None where there is none."
    )
    curves: list[ChartCurve]
    changes: list[IdentityChange]
    errors: list[SpeedErrorsEntry]
