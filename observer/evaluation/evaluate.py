"""Figures for comparing methods (definitions: ``observer.evaluation.tally``)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from observer.evaluation.counts import Episode, Sample, Tally
from observer.evaluation.flagged import VELOCITY_95_CHI2


@dataclass(frozen=True)
class Evaluation:
    """Accuracy of one or several runs. A figure without data is None.

    Runs that are scored for detection only have no errors of position, speed and velocity.

    Attributes:
        frames: compared. frames_without_world: left out, because their world cannot be related to
            that of the ground truth. frames_without_truth: left out, because nothing is known at
            their times.
        frames_degraded, frames_lost: of all frames, by the method's status.
        truth_count: obstacles that count, summed over frames. matched: those found.
        recall: matched / truth_count.
        missed: those not found. flagged_misses: missed ones that the lines flag as possibly missed.
            unflagged_misses: unflagged ones; unflagged_misses_share: their share of all missed.
        false: instances with no moving true obstacle nearby. false_per_100_frames.
        surplus_boxes: second instances on one obstacle. surplus_boxes_per_100_frames.
        box_iou_median: intersection over union of the reported and the true box in the image.
        surface_rmse_m: of the position, from the middle of the visible surface.
        centre_rmse_m: of the position, from the centre, once two faces were seen.
        speed_rmse_mps, velocity_rmse_mps: of the magnitude, and of the vector.
        speed_bias_mps: mean of estimate minus truth.
        identity_switches: number of times that a true obstacle got another identity.
        episodes: periods of motion in sight; episodes_missed: those without any report.
        delay_median_s: from the beginning of an episode to the first confirmed report; None also
            if half of the episodes or more were missed.
        coverage: share of velocities inside their joint 3D 95 % region (Mahalanobis distance).
        mota, motp_m: CLEAR-MOT's accuracy (1 at best, no lower limit) and precision (mean
            distance of pairs).
    """

    frames: int
    frames_without_world: int
    frames_without_truth: int
    frames_degraded: int
    frames_lost: int
    truth_count: int
    matched: int
    recall: float | None
    missed: int
    flagged_misses: int
    unflagged_misses: int
    unflagged_misses_share: float | None
    false: int
    false_per_100_frames: float | None
    surplus_boxes: int
    surplus_boxes_per_100_frames: float | None
    box_iou_median: float | None
    surface_rmse_m: float | None
    centre_rmse_m: float | None
    speed_rmse_mps: float | None
    speed_bias_mps: float | None
    velocity_rmse_mps: float | None
    identity_switches: int
    episodes: int
    episodes_missed: int
    delay_median_s: float | None
    coverage: float | None
    mota: float | None
    motp_m: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; unknown ones are None."""
        return asdict(self)

    def markdown(self) -> str:
        """Return a table with two columns, figure and value."""
        return markdown_table(["figure", "value"], [[title, v] for title, v in self.rows()])

    def rows(self) -> list[tuple[str, str]]:
        """Return titles with unit and values as text, for tables."""
        return [(title, shown(getattr(self, name))) for name, title in FIGURE_TITLES.items()]


FIGURE_TITLES: dict[str, str] = {
    "frames": "frames compared",
    "frames_without_world": "frames without a common world frame",
    "frames_without_truth": "frames without ground truth",
    "frames_degraded": "frames degraded",
    "frames_lost": "frames lost",
    "truth_count": "moving obstacles in view, summed over frames",
    "recall": "recall",
    "missed": "misses",
    "unflagged_misses": "unflagged misses",
    "unflagged_misses_share": "unflagged misses, share of misses",
    "false_per_100_frames": "false per 100 frames",
    "surplus_boxes_per_100_frames": "surplus boxes per 100 frames",
    "box_iou_median": "box IoU, median",
    "surface_rmse_m": "position RMSE, visible surface, m",
    "centre_rmse_m": "position RMSE, centre, m",
    "speed_rmse_mps": "speed RMSE, m/s",
    "speed_bias_mps": "speed bias, m/s",
    "velocity_rmse_mps": "velocity RMSE, m/s",
    "identity_switches": "identity switches",
    "episodes": "episodes of motion",
    "episodes_missed": "episodes missed",
    "delay_median_s": "delay to first report, median, s",
    "coverage": "coverage of velocity at 95 %",
    "mota": "MOTA",
    "motp_m": "MOTP, m",
}


def summarise(tallies: Sequence[Tally]) -> Evaluation:
    """Return the figures of several runs together."""
    samples = [s for t in tallies for s in t.samples]
    pairs = [s for s in samples if s.matched]
    measured = [s for t in tallies if t.scored_for == "everything" for s in t.samples]
    episodes = [e for t in tallies for e in t.episodes]
    frames = sum(t.frames for t in tallies)
    false = sum(len(t.false) for t in tallies)
    surplus = sum(t.surplus_boxes for t in tallies)
    missed = [s for s in samples if not s.matched]
    unflagged = unflagged_misses(samples)
    switches = sum(s.switched for s in pairs)
    errors = len(missed) + false + surplus + switches
    return Evaluation(
        frames=frames,
        frames_without_world=sum(t.frames_without_world for t in tallies),
        frames_without_truth=sum(t.frames_without_truth for t in tallies),
        frames_degraded=sum(t.frames_degraded for t in tallies),
        frames_lost=sum(t.frames_lost for t in tallies),
        truth_count=len(samples),
        matched=len(pairs),
        recall=recall(samples),
        missed=len(missed),
        flagged_misses=len(missed) - unflagged,
        unflagged_misses=unflagged,
        unflagged_misses_share=unflagged / len(missed) if missed else None,
        false=false,
        false_per_100_frames=per_100(false, frames),
        surplus_boxes=surplus,
        surplus_boxes_per_100_frames=per_100(surplus, frames),
        box_iou_median=box_iou_median(samples),
        surface_rmse_m=rms(s.surface_error_m for s in measured),
        centre_rmse_m=rms(s.centre_error_m for s in measured),
        speed_rmse_mps=rms(s.speed_error_mps for s in measured),
        speed_bias_mps=_mean(s.speed_error_mps for s in measured),
        velocity_rmse_mps=rms(s.velocity_error_mps for s in measured),
        identity_switches=switches,
        episodes=len(episodes),
        episodes_missed=sum(e.first_seen is None for e in episodes),
        delay_median_s=delay_median(episodes),
        coverage=coverage(samples),
        mota=1 - errors / len(samples) if samples else None,
        motp_m=_mean(s.distance_m for s in measured),
    )


def recall(samples: Sequence[Sample]) -> float | None:
    """Return the share of the samples that were found."""
    return sum(s.matched for s in samples) / len(samples) if samples else None


def unflagged_misses(samples: Iterable[Sample]) -> int:
    """Return the number of missed samples that the line does not flag as possibly missed."""
    return sum(not s.matched and not s.flagged for s in samples)


def box_iou_median(samples: Iterable[Sample]) -> float | None:
    """Return the median intersection over union of the boxes, where both are known."""
    known = _known(s.box_iou for s in samples)
    return float(np.median(known)) if known else None


def per_100(count: int, frames: int) -> float | None:
    """Return a count per 100 frames; None without frames."""
    return 100 * count / frames if frames else None


def coverage(samples: Iterable[Sample]) -> float | None:
    """Return the share of velocities inside their 95 % region, of those with a covariance."""
    known = (s.mahalanobis2 for s in samples)
    return _mean(float(d <= VELOCITY_95_CHI2) for d in known if d is not None)


def delay_median(episodes: Sequence[Episode]) -> float | None:
    """Return the median delay, s; None without episodes, or if half of them were missed."""
    median = float(np.median([e.delay_s for e in episodes])) if episodes else float("inf")
    return median if np.isfinite(median) else None


def rms(values: Iterable[float | None]) -> float | None:
    """Return the root mean square of the known values."""
    known = _known(values)
    return float(np.sqrt(np.mean(np.square(known)))) if known else None


def shown(value: float | int | None) -> str:
    """Return a figure as text: three decimals, and a dash if unknown."""
    if value is None:
        return "-"
    return str(value) if isinstance(value, int) else f"{value:.3f}"


def markdown_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table; the first column is text, the others are right-aligned."""
    lines = [
        "| " + " | ".join(header) + " |",
        "|---|" + "---:|" * (len(header) - 1),
        *("| " + " | ".join(row) + " |" for row in rows),
    ]
    return "\n".join(lines) + "\n"


def _known(values: Iterable[float | None]) -> list[float]:
    return [v for v in values if v is not None]


def _mean(values: Iterable[float | None]) -> float | None:
    known = _known(values)
    return float(np.mean(known)) if known else None
