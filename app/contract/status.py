"""State of the server, as the page and ``GET /api/status`` show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.calibrating import CalibratingFacts
from app.contract.live_truth import LiveTruthStatus
from app.contract.values import means
from observer.calibration.ageing.words import VergenceWord
from observer.jsonl import StatusWord
from observer.recording.payloads import Images
from observer.sources.contract import CameraSide, CameraState

# Seconds after which what is shown is said to be stale.
STALE_AFTER_S = 1.0

EngineWord = Literal["idle", "preview", "running", "calibrating", "failed"]


@dataclass(frozen=True)
class EngineStatus:
    state: EngineWord
    reason: Annotated[str | None, means("Why it failed, or is not ready, one sentence.")]
    pid: int | None
    generation: Annotated[int, means("Number of engine processes so far.")]
    restarts: int
    heartbeat_age_s: Annotated[float | None, means("Time since the last heartbeat of its loop.")]


@dataclass(frozen=True)
class SourceStatus:
    spec: str
    name: Annotated[str, means("Display name: the run whose recording it is, or the spec.")]
    before: Annotated[
        str | None, means("The source before the recording of a run; POST /source/back opens it.")
    ]
    kind: str
    width: int
    height: int
    frame_rate: float
    frame_count: int | None
    live: bool
    mount_height_m: float | None
    mount_tilt_rad: float | None
    mount_forward_m: float | None
    mount_left_m: float | None
    devices: Annotated[Sequence[str], means("Persistent names of live cameras.")]


# Limits of the playback rate, times the recorded speed.
SLOWEST_RATE, FASTEST_RATE = 0.1, 4.0


@dataclass(frozen=True)
class PlaybackStatus:
    paused: bool
    rate: float
    loop: bool
    frame: Annotated[int | None, means("Position within the source.")]
    frame_count: int | None
    ended: bool
    seekable: Annotated[bool, means("Whether it can seek to any frame.")] = False
    achieved_rate: Annotated[float | None, means("Source seconds per second, measured.")] = None


@dataclass(frozen=True)
class LiveCamera:
    side: CameraSide
    device: str
    state: CameraState
    trouble: str | None
    settings: Annotated[Mapping[str, str], means("Settings as the camera applied them.")]
    refused: Annotated[Sequence[str], means("Settings that it did not accept.")]


@dataclass(frozen=True)
class LiveStatus:
    """State of a live source."""

    cameras: Sequence[LiveCamera]
    pairs: int
    dropped: Annotated[int, means("Pairs whose images were too far apart in time.")]
    skew_median_s: float | None
    skew_p95_s: float | None
    reopened: int
    hints: Sequence[str]
    trouble: Annotated[str | None, means("Why it delivers no frames at the moment.")]
    reduced_to: Annotated[
        str | None,
        means("The reduced processing while the computer is too slow for full processing."),
    ]


@dataclass(frozen=True)
class RecordingStatus:
    """Recording of the run in progress."""

    images: Images
    bytes: Annotated[int, means("Size of the file.")]
    seconds: float
    dropped: Annotated[int, means("Messages dropped because the disk could not keep up.")]
    trouble: Annotated[str | None, means("Why recording has stopped.")]


@dataclass(frozen=True)
class MountStatus:
    """Mount of the left camera, as the method uses it."""

    height_m: float
    tilt_rad: float
    forward_m: float | None
    left_m: float | None
    roll_rad: float
    pan_rad: float


@dataclass(frozen=True)
class RowDriftStatus:
    """Distance between the rows of the left and right image."""

    now_px: float | None
    median_px: float | None
    roll_rad: float | None
    since_s: float | None
    trend_px_per_min: float | None
    warning: str | None
    history: Annotated[
        Sequence[tuple[float, float]], means("Seconds since the start of the measurement, pixels.")
    ]


@dataclass(frozen=True)
class VergenceStatus:
    status: VergenceWord
    vergence_rad: Annotated[
        float | None, means("Angle by which the cameras converge more than calibrated.")
    ]
    std_rad: float | None
    sentence: str
    distance_m: Annotated[
        float,
        means("Distance compared with the wheels; 0 if only near and far points are compared."),
    ]


@dataclass(frozen=True)
class ExposureSkewStatus:
    """Sync error that the source does not report."""

    exposure_skew_s: Annotated[float, means("Time by which the right camera exposes later.")]
    sigma_s: Annotated[float, means("Standard deviation.")]
    sentence: str


@dataclass(frozen=True)
class AgeingStatus:
    rows: RowDriftStatus
    vergence: VergenceStatus
    exposure_skew: Annotated[
        ExposureSkewStatus | None, means("null while no unreported sync error is known.")
    ]


@dataclass(frozen=True)
class CameraStatus:
    """The rectified pair."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float


@dataclass(frozen=True)
class RunReference:
    id: str
    name: str
    started_at: str
    duration_s: Annotated[float | None, means("As for the run itself.")]


@dataclass(frozen=True)
class RerunStatus:
    """A re-run in progress, beside the open source."""

    id: Annotated[str, means("Id of the new run.")]
    name: str
    rerun_of: str
    state: Annotated[
        Literal["waiting", "observing", "held", "finishing"],
        means(
            "waiting: for another re-run; held: paused while a robot is armed; finishing: "
            "its speeds are stored and ground truth is added."
        ),
    ]
    share: Annotated[float, means("Share of the frames that have been processed, from 0 to 1.")]


@dataclass(frozen=True)
class CalibrationReference:
    id: str
    name: str


@dataclass(frozen=True)
class Rates:
    unique_frames_per_s: float


@dataclass(frozen=True)
class DenseStereoStatus:
    """The cloud and the disparity view, made beside the loop while somebody watches one."""

    per_s: float
    age_s: Annotated[
        float | None, means("Age of the newest one: time since its pair was received.")
    ]
    median_ms: Annotated[float | None, means("Recent median computing time.")]
    coarseness: Annotated[
        int | None,
        means("Downscaling factor for stereo matching: more than 1 for large images."),
    ]


@dataclass(frozen=True)
class LatencyStatus:
    """Time from a frame's reception to the page's acknowledgement after painting, milliseconds."""

    median: float | None
    p95: float | None
    count: int


@dataclass(frozen=True)
class Decomposition:
    """A planar model's affine part, decomposed as in the paper's table I."""

    translation_px: Annotated[Sequence[float], means("Along u and v.")]
    rotation_rad: float
    shear: float | None
    scale: Annotated[Sequence[float], means("Along u and v; 1 is unchanged.")]


@dataclass(frozen=True)
class CameraMotion:
    """Translation of the camera in its own axes: right, down, forward."""

    rotation_rad: Annotated[Sequence[float], means("Rotation vector.")]
    translation_m: Sequence[float]


@dataclass(frozen=True)
class EgoMotionStatus:
    """Motion of the camera from the frame that the newest one was compared with."""

    model: str
    status: StatusWord
    matches: int
    inliers: int
    dt: Annotated[float | None, means("Time between the two frames, s.")]
    decomposition: Annotated[Decomposition | None, means("For planar models only.")]
    motion: Annotated[CameraMotion | None, means("null if unknown.")]


@dataclass(frozen=True)
class Drops:
    frames_skipped: Annotated[int, means("Frames that the source could not read.")]
    observations_lost: Annotated[int, means("Observations dropped because the server was busy.")]
    live_messages_dropped: Annotated[int, means("Messages dropped because a page was slow.")]
    writes_dropped: Annotated[int, means("Writes dropped while the database was unavailable.")]


@dataclass(frozen=True)
class SkippedFrame:
    index: int
    reason: str


@dataclass(frozen=True)
class Status:
    engine: EngineStatus
    source: SourceStatus | None
    playback: PlaybackStatus | None
    camera: CameraStatus | None
    run: RunReference | None
    reruns: Annotated[Sequence[RerunStatus], means("In the order of processing.")]
    mount: Annotated[MountStatus | None, means("null: unknown.")]
    ageing: Annotated[AgeingStatus | None, means("Health of the calibration in use.")]
    recording: Annotated[RecordingStatus | None, means("null: nothing is recorded.")]
    truth: Annotated[LiveTruthStatus | None, means("null: no live motion capture.")]
    live: Annotated[LiveStatus | None, means("null if the source is not live.")]
    calibrating: Annotated[CalibratingFacts | None, means("null: no calibration is in progress.")]
    calibration: Annotated[CalibrationReference | None, means("null: the source's own.")]
    to_calibrate: Annotated[
        str | None, means("Source requested at start if it has no calibration yet.")
    ]
    parameters_revision: int
    driving_revision: Annotated[
        int,
        means(
            "Incremented by every change of a guard.* or navigation.* parameter since the start."
        ),
    ]
    rates: Rates
    dense_stereo: DenseStereoStatus
    frames_observed: int
    latency_ms: LatencyStatus
    timings_ms: Annotated[Mapping[str, float], means("Median time of each stage.")]
    ego_motion: EgoMotionStatus | None
    drops: Drops
    skipped: Sequence[SkippedFrame]
    viewers: Annotated[int, means("Number of open live pages.")]
    has_truth: bool
    warnings: Sequence[str]
    version: str
