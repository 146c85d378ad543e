"""State of the server, as the page and ``GET /api/status`` show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

from app.contract.calibrating import CalibratingFacts
from app.contract.live_truth import LiveTruthStatus
from app.contract.values import means
from observer.recording.payloads import Images

EngineWord = Literal["idle", "preview", "running", "calibrating", "failed"]


@dataclass(frozen=True)
class EngineStatus:
    state: EngineWord
    reason: Annotated[str | None, means("Why it failed, one sentence.")]
    pid: int | None
    generation: Annotated[int, means("Engine processes so far.")]
    restarts: int
    heartbeat_age_s: Annotated[float | None, means("Since its loop's last sign of life.")]


@dataclass(frozen=True)
class SourceStatus:
    spec: str
    name: Annotated[str, means("For people: names the run whose recording it is; else the spec.")]
    before: Annotated[
        str | None, means("What was open before a run's recording: POST /source/back opens it.")
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
    devices: Annotated[Sequence[str], means("Names by which live cameras are found again.")]


@dataclass(frozen=True)
class PlaybackStatus:
    paused: bool
    rate: float
    loop: bool
    frame: Annotated[int | None, means("Position within the source.")]
    frame_count: int | None
    ended: bool
    seekable: Annotated[bool, means("Whether it can go on from any frame.")] = False
    achieved_rate: Annotated[float | None, means("Source seconds per second, measured.")] = None


@dataclass(frozen=True)
class LiveCamera:
    side: Literal["left", "right", "both"]
    device: str
    state: Literal["open", "waiting", "failed"]
    trouble: str | None
    settings: Annotated[Mapping[str, str], means("What the camera really accepted.")]
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
    trouble: Annotated[str | None, means("What keeps it from delivering at this moment.")]
    reduced_to: Annotated[
        str | None, means("What is left of the processing while the computer is too slow for all.")
    ]


@dataclass(frozen=True)
class RecordingStatus:
    """The run's recording, which is on."""

    images: Images
    bytes: Annotated[int, means("Of the file.")]
    seconds: float
    dropped: Annotated[int, means("Messages lost because the disk did not keep up.")]
    trouble: Annotated[str | None, means("Why nothing is recorded any more.")]


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
    history: Annotated[Sequence[tuple[float, float]], means("Seconds watched, pixels.")]


@dataclass(frozen=True)
class VergenceStatus:
    status: Literal["unobserved", "consistent", "drifted"]
    vergence_rad: Annotated[
        float | None, means("By how much the cameras converge more than calibrated.")
    ]
    std_rad: float | None
    sentence: str
    way_m: Annotated[float, means("Of way against the wheels; 0 by near and far points alone.")]


@dataclass(frozen=True)
class ExposureSkewStatus:
    """Time between the exposures of left and right that the source does not tell."""

    exposure_skew_s: Annotated[float, means("By which the right camera exposes later.")]
    sigma_s: Annotated[float, means("One standard deviation.")]
    sentence: str


@dataclass(frozen=True)
class AgeingStatus:
    rows: RowDriftStatus
    vergence: VergenceStatus
    exposure_skew: Annotated[
        ExposureSkewStatus | None, means("None while no skew is known that nobody told.")
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
    duration_s: Annotated[float | None, means("As in the run itself.")]


@dataclass(frozen=True)
class RerunStatus:
    """A run whose recording is being observed again, beside the open source."""

    id: Annotated[str, means("Of the new run.")]
    name: str
    rerun_of: str
    state: Annotated[
        Literal["waiting", "observing", "held", "finishing"],
        means(
            "waiting: for another re-run; held: as long as a robot is armed; finishing: its "
            "speeds are stored and ground truth is added."
        ),
    ]
    share: Annotated[float, means("Of the frames that are observed, from 0 to 1.")]


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
    age_s: Annotated[float | None, means("Since the reception of the newest one's pair.")]
    median_ms: Annotated[float | None, means("To make one, lately.")]
    coarseness: Annotated[
        int | None,
        means("How many pixels lie along one that is matched: more than 1 for large images."),
    ]


@dataclass(frozen=True)
class LatencyStatus:
    """Time from a frame's reception to the page's acknowledgement after painting, milliseconds."""

    median: float | None
    p95: float | None
    count: int


@dataclass(frozen=True)
class Decomposition:
    """A planar model's affine part, as the paper's table I takes it apart."""

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
    status: Literal["ok", "degraded", "lost"]
    matches: int
    inliers: int
    dt: Annotated[float | None, means("Between the two frames, s.")]
    decomposition: Annotated[Decomposition | None, means("Of planar models only.")]
    motion: Annotated[CameraMotion | None, means("None where it is not known.")]


@dataclass(frozen=True)
class Drops:
    frames_skipped: Annotated[int, means("Frames of the source that could not be read.")]
    observations_lost: Annotated[int, means("Not passed on, because the server was busy.")]
    live_messages_dropped: Annotated[int, means("Not sent, because a page was slow.")]
    writes_dropped: Annotated[int, means("Dropped while the database was unavailable.")]


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
    reruns: Annotated[Sequence[RerunStatus], means("In the order in which they are done.")]
    mount: Annotated[MountStatus | None, means("None: it is not known.")]
    ageing: Annotated[AgeingStatus | None, means("How the calibration in use holds.")]
    recording: Annotated[RecordingStatus | None, means("None: nothing is recorded.")]
    truth: Annotated[LiveTruthStatus | None, means("None: no motion capture is listened to.")]
    live: Annotated[LiveStatus | None, means("None for what is not live.")]
    calibrating: Annotated[CalibratingFacts | None, means("None: nothing is calibrated.")]
    calibration: Annotated[CalibrationReference | None, means("None: the source's own.")]
    to_calibrate: Annotated[
        str | None, means("Source that was to be opened first, and is there to be calibrated.")
    ]
    parameters_revision: int
    driving_revision: Annotated[
        int,
        means("Grows with every change of a guard.* or navigation.* parameter since the start."),
    ]
    rates: Rates
    dense_stereo: DenseStereoStatus
    frames_observed: int
    latency_ms: LatencyStatus
    timings_ms: Annotated[Mapping[str, float], means("Median of each stage.")]
    ego_motion: EgoMotionStatus | None
    drops: Drops
    skipped: Sequence[SkippedFrame]
    viewers: Annotated[int, means("Open live pages.")]
    has_truth: bool
    warnings: Sequence[str]
    version: str
