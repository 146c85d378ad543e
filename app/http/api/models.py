"""What goes in and out of the REST interface, as OpenAPI shows it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, Field, StrictBool, StrictInt

from app.http.api.calibration_models import CalibratingFacts
from app.http.api.live_truth_models import LiveTruthStatus
from app.http.api.values import Finite, Identifier, In, Name, Spec

# --- status ---------------------------------------------------------------------------------


class EngineStatus(BaseModel):
    state: Literal["idle", "preview", "running", "calibrating", "failed"]
    reason: str | None = Field(description="Why it failed, one sentence.")
    pid: int | None
    generation: int = Field(description="Engine processes so far.")
    restarts: int
    heartbeat_age_s: float | None = Field(description="Since its loop's last sign of life.")


class SourceStatus(BaseModel):
    spec: str
    kind: str
    width: int
    height: int
    frame_rate: float
    frame_count: int | None
    live: bool
    mount_height_m: float | None
    mount_tilt_rad: float | None
    devices: list[str] = Field(description="Names by which live cameras are found again.")


class PlaybackStatus(BaseModel):
    paused: bool
    rate: float
    loop: bool
    frame: int | None = Field(description="Position within the source.")
    frame_count: int | None
    ended: bool
    seekable: bool = Field(False, description="Whether it can go on from any frame.")
    achieved_rate: float | None = Field(None, description="Source seconds per second, measured.")


class LiveCamera(BaseModel):
    side: Literal["left", "right", "both"]
    device: str
    state: Literal["open", "waiting", "failed"]
    trouble: str | None
    settings: dict[str, str] = Field(description="What the camera really accepted.")
    refused: list[str] = Field(description="Settings that it did not accept.")


class LiveStatus(BaseModel):
    """How a live source is."""

    cameras: list[LiveCamera]
    pairs: int
    dropped: int = Field(description="Pairs whose images were too far apart in time.")
    skew_median_s: float | None
    skew_p95_s: float | None
    reopened: int
    hints: list[str]
    trouble: str | None = Field(description="What keeps it from delivering at this moment.")


class RecordingStatus(BaseModel):
    """The run's recording, which is on."""

    images: Literal["none", "jpeg", "lossless"]
    bytes: int = Field(description="Of the file.")
    seconds: float
    dropped: int = Field(description="Messages lost because the disk did not keep up.")
    trouble: str | None = Field(description="Why nothing is recorded any more.")


class MountStatus(BaseModel):
    """How the left camera is mounted, as the method uses it."""

    height_m: float
    tilt_rad: float
    forward_m: float | None
    left_m: float | None
    roll_rad: float
    pan_rad: float


class RowDriftStatus(BaseModel):
    """How far the rows of left and right are apart."""

    now_px: float | None
    median_px: float | None
    roll_rad: float | None
    since_s: float | None
    trend_px_per_min: float | None
    warning: str | None
    history: list[tuple[float, float]] = Field(description="Seconds watched, pixels.")


class VergenceStatus(BaseModel):
    status: Literal["unobserved", "consistent", "drifted"]
    vergence_rad: float | None
    std_rad: float | None
    sentence: str
    way_m: float


class AgeingStatus(BaseModel):
    rows: RowDriftStatus
    vergence: VergenceStatus


class CameraStatus(BaseModel):
    """The rectified pair."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float


class RunReference(BaseModel):
    id: str
    name: str
    started_at: str


class CalibrationReference(BaseModel):
    id: str
    name: str


class Rates(BaseModel):
    unique_frames_per_s: float


class DenseStereoStatus(BaseModel):
    """The cloud and the disparity view, made beside the loop while somebody watches one."""

    per_s: float
    age_s: float | None = Field(description="Since the reception of the newest one's pair.")
    median_ms: float | None = Field(description="To make one, lately.")
    coarseness: int | None = Field(
        description="How many pixels lie along one that is matched: more than 1 for large images."
    )


class LatencyStatus(BaseModel):
    """From a frame's reception to the page's acknowledgement after painting, milliseconds."""

    median: float | None
    p95: float | None
    count: int


class Decomposition(BaseModel):
    """A planar model's affine part, as the paper's table I takes it apart."""

    translation_px: list[float] = Field(description="Along u and v.")
    rotation_rad: float
    shear: float | None
    scale: list[float] = Field(description="Along u and v; 1 is unchanged.")


class CameraMotion(BaseModel):
    """Where the camera went, in its own axes: right, down, forward."""

    rotation_rad: list[float] = Field(description="Rotation vector.")
    translation_m: list[float]


class EgoMotionStatus(BaseModel):
    """How the camera moved from the frame that the newest one was compared with."""

    model: str
    status: Literal["ok", "degraded", "lost"]
    matches: int
    inliers: int
    dt: float | None = Field(description="Between the two frames, s.")
    decomposition: Decomposition | None = Field(description="Of planar models only.")
    motion: CameraMotion | None = Field(description="None where it is not known.")


class Drops(BaseModel):
    frames_skipped: int = Field(description="Frames of the source that could not be read.")
    observations_lost: int = Field(description="Not passed on, because the server was busy.")
    live_messages_dropped: int = Field(description="Not sent, because a page was slow.")
    writes_dropped: int = Field(description="Not kept, because the database was not to be had.")


class SkippedFrame(BaseModel):
    index: int
    reason: str


class Status(BaseModel):
    engine: EngineStatus
    source: SourceStatus | None
    playback: PlaybackStatus | None
    camera: CameraStatus | None
    run: RunReference | None
    mount: MountStatus | None = Field(description="None: it is not known.")
    ageing: AgeingStatus | None = Field(description="How the calibration in use holds.")
    recording: RecordingStatus | None = Field(description="None: nothing is recorded.")
    truth: LiveTruthStatus | None = Field(description="None: no motion capture is listened to.")
    live: LiveStatus | None = Field(description="None for what is not live.")
    calibrating: CalibratingFacts | None = Field(description="None: nothing is calibrated.")
    calibration: CalibrationReference | None = Field(description="None: the source's own.")
    parameters_revision: int
    guard_revision: int = Field(
        description="Grows with every change of a guard.* parameter since the server started."
    )
    rates: Rates
    dense_stereo: DenseStereoStatus
    frames_observed: int
    latency_ms: LatencyStatus
    timings_ms: dict[str, float] = Field(description="Median of each stage.")
    ego_motion: EgoMotionStatus | None
    drops: Drops
    skipped: list[SkippedFrame]
    viewers: int = Field(description="Open live pages.")
    has_truth: bool
    warnings: list[str]
    version: str


# --- sources and playback -------------------------------------------------------------------


class SourceEntry(BaseModel):
    spec: str
    title: str
    help: str


class SourceChoice(In):
    source: Spec
    calibration: Identifier | None = Field(None, description="None: the source's own.")


class PlaybackChange(In):
    """What is given is changed."""

    paused: StrictBool | None = None
    rate: Annotated[Finite, Field(ge=0.1, le=4.0)] | None = None
    loop: StrictBool | None = None
    step: Annotated[StrictInt, Field(ge=0, le=1000)] = Field(
        0, description="Show so many further frames while paused."
    )
    restart: StrictBool = False
    seek: Annotated[StrictInt, Field(ge=0)] | None = Field(
        None, description="Go on from this frame of a recording, and show it also while paused."
    )


# --- pixels ---------------------------------------------------------------------------------


class PixelObstacle(BaseModel):
    id: int
    reported: bool = Field(description="Whether it was seen often enough to be reported.")
    why: str = Field(description="Why it counts as dynamic.")


class Pixel(BaseModel):
    """Why one pixel of the newest observed frame counts as what it does."""

    frame: int
    segment: int
    u: float
    v: float
    verdict: Literal[
        "dynamic", "static", "undecided", "too_far", "too_few_features", "ego_motion_lost"
    ]
    sentence: str
    numbers: dict[str, float | None] = Field(
        description="The figures behind it, by names that end with their unit; null = not known."
    )
    would_change: str = Field(description="What would give another answer, with its value.")
    obstacle: PixelObstacle | None = Field(description="The one that a dynamic pixel is part of.")


# --- parameters -----------------------------------------------------------------------------


class ParametersNow(BaseModel):
    revision: int = Field(description="Grows with every change but those of guard.* parameters.")
    guard_revision: int = Field(
        description="Grows with every change of a guard.* parameter since the server started."
    )
    values: dict[str, Any]
    preset: str | None = Field(description="The preset with exactly these values.")
    frame: int | None = Field(description="The first frame they act on, as far as known.")


class ParametersChanged(ParametersNow):
    notes: list[str] = Field(
        description="One sentence on each given parameter that does not act with the method."
    )


class ParameterEntry(BaseModel):
    """All that a form needs to know of one parameter."""

    name: str
    group: str
    group_help: str
    title: str
    help: str
    type: Literal["number", "integer", "boolean", "choice"]
    unit: str
    default: Any
    models: list[str] = Field(
        description="With which ego_motion.model it acts on what is observed."
    )
    cloud: bool = Field(
        False, description="Whether it acts with every model on the dense cloud that is shown."
    )
    minimum: float | None = None
    maximum: float | None = None
    step: float | None = None
    choices: list[str] | None = None


class Preset(BaseModel):
    name: str
    help: str
    values: dict[str, Any]
    built_in: bool


class PresetName(In):
    name: Name
    help: Annotated[str, Field(strict=True, max_length=300)] = ""
