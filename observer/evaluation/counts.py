"""Counts of a run against ground truth, as ``observer.evaluation.tally`` defines them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from observer.truth.contract import Kind

# Figures of a run that count: everything, or only status, detection and coverage (if depth is known
# to be biased, errors of position and speed say nothing about the method).
ScoredFor = Literal["everything", "detection"]


@dataclass(frozen=True)
class Sample:
    """A true obstacle that counts, in one frame.

    Attributes:
        range_m: from the camera. speed_mps: true. radial: share of the true velocity along the
            line of sight, 0 (lateral) to 1 (radial).
        matched: whether an instance is matched to it; if not, the following are None.
        distance_m: to the instance. surface_error_m: from the middle of the visible surface.
            centre_error_m: from the centre, None before two faces were seen.
        speed_error_mps, velocity_error_mps: signed difference of the speeds; magnitude of the
            difference of the velocities.
        mahalanobis2: squared Mahalanobis distance of the velocity error; None without a covariance.
        switched: whether the instance's identity differs from the obstacle's previous one.
        box_iou: intersection over union of the reported and the true box; None if one is unknown.
        kind: of the obstacle. flagged: whether it was missed but the line flags that.
        segment, frame: of its line.
    """

    range_m: float
    speed_mps: float
    radial: float
    matched: bool
    distance_m: float | None = None
    surface_error_m: float | None = None
    centre_error_m: float | None = None
    speed_error_mps: float | None = None
    velocity_error_mps: float | None = None
    mahalanobis2: float | None = None
    switched: bool = False
    box_iou: float | None = None
    kind: Kind | None = None
    flagged: bool = False
    segment: int = 0
    frame: int = 0


@dataclass
class Episode:
    """A stretch of time in which a true obstacle moved and was visible.

    Attributes:
        body: its id. began, ended: seconds. first_seen: time of the first instance within the
            gate, None if there was none.
        range_m: from the camera, when it began.
        radial: share of the true velocity along the line of sight, mean of the first 0.6 s:
            by then bodies that start slowly or turn on the spot have settled their direction.
        kind: of the obstacle.
    """

    body: int
    began: float
    ended: float
    first_seen: float | None = None
    range_m: float = 0.0
    radial: float = 0.0
    kind: Kind | None = None

    @property
    def delay_s(self) -> float:
        """Time from its beginning to the first report, infinite without one."""
        return float("inf") if self.first_seen is None else self.first_seen - self.began


@dataclass(frozen=True)
class FalseInstance:
    """An instance with no moving true obstacle nearby, with place and time to find the cause.

    Attributes:
        frame, segment, time: of its line; the time in seconds. id: of the reported obstacle.
        position: (x, y, z) metres, the truth's world. speed_mps: as reported.
        range_m: from the camera.
        nearest_id: the true body whose centre is nearest, moving or not; None without any.
        nearest_m: its distance. nearest_moving: whether it moves.
    """

    frame: int
    segment: int
    time: float
    id: int
    position: tuple[float, float, float]
    speed_mps: float
    range_m: float
    nearest_id: int | None
    nearest_m: float | None
    nearest_moving: bool | None


@dataclass
class Tally:
    """Counts of one run; the figures may sum up several.

    Attributes:
        frames: compared frames. frames_without_world: those left out because the segment's
            world cannot be related to the truth's. frames_without_truth: those left out because
            the truth, which knows the camera's pose at other frames, knows nothing at theirs.
        frames_degraded, frames_lost: of all frames, by the method's status.
        false: instances with no moving true obstacle nearby. surplus_boxes: second instances on one
            body.
        moved: whether any true obstacle moved at any time, visible or not.
        people: whether any true obstacle was a person, moving or not.
        scored_for: the figures that count.
    """

    frames: int = 0
    frames_without_world: int = 0
    frames_without_truth: int = 0
    frames_degraded: int = 0
    frames_lost: int = 0
    false: list[FalseInstance] = field(default_factory=list)
    surplus_boxes: int = 0
    moved: bool = False
    people: bool = False
    scored_for: ScoredFor = "everything"
    samples: list[Sample] = field(default_factory=list)
    episodes: list[Episode] = field(default_factory=list)
