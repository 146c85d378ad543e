"""Vergence and exposure skew as the method estimates them while driving, without wheels.

A disparity bias ``b`` at the image's centre is the vergence ``v = b / f``, because a pair that
converges by v more than calibrated shows all disparities ``f g v`` too small (``vergence_fit``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from observer.calibration.ageing.vergence import VergenceCheck, drift_words
from observer.camera import StereoCamera
from observer.intervals import half_95
from observer.number_format import format_number
from observer.vision.disparity_bias import DisparityBias
from observer.vision.exposure_skew import ExposureSkew

_CONTRADICTION_SIGMAS = 3.0


@dataclass(frozen=True)
class SkewCheck:
    """A skew of the exposures that the source does not report.

    Attributes:
        exposure_skew_s: seconds by which the right camera exposes later; sigma_s: one standard
            deviation.
        sentence: the same in words.
    """

    exposure_skew_s: float
    sigma_s: float
    sentence: str


class PointsVergence:
    """Vergence by near against far points, from the bias that the method keeps in its trace."""

    def __init__(self, camera: StereoCamera) -> None:
        self._camera = camera
        self._bias: DisparityBias | None = None
        self._found: VergenceCheck | None = None

    def update(self, bias: DisparityBias | None) -> VergenceCheck | None:
        """Return the newest check, None while the bias is not known.

        Args:
            bias: after this frame; None where the method did not estimate it.
        """
        if bias is None or bias is self._bias:
            return self._found
        self._bias = bias
        if bias.known:
            self._found = vergence_by_points(bias, self._camera)
        elif not bias.pairs:
            # The estimate was restarted, and nothing is compensated any more.
            self._found = None
        return self._found


class SkewWatch:
    """Skew from the image's rotations, by the estimate that the method keeps in its trace."""

    def __init__(self) -> None:
        self._found: SkewCheck | None = None

    def update(self, skew: ExposureSkew | None) -> SkewCheck | None:
        """Return the newest check, the same object while its text stays; None until one is sure."""
        if skew is not None and skew.sure:
            found = skew_check(skew)
            if self._found is None or found.sentence != self._found.sentence:
                self._found = found
        return self._found


def vergence_by_points(bias: DisparityBias, camera: StereoCamera) -> VergenceCheck:
    """Return the verdict on a bias that is known well.

    Args:
        camera: the rectified pair.
    """
    vergence, std = bias.px / camera.fx, bias.sigma_px / camera.fx
    lead, effect = drift_words(vergence, std, camera.baseline)
    if bias.sure:
        sentence = (
            f"{lead}, comparing near and far points: uncorrected, {effect}. This is compensated "
            "for the rest of the run; save the refined calibration or recalibrate with a board"
        )
        return VergenceCheck("drifted", vergence, std, sentence)
    sentence = (
        "near and far points confirm the calibrated vergence: "
        f"{format_number(math.degrees(vergence), 2, signed=True)}° ± "
        f"{math.degrees(half_95(std)):.2f}° from it (95 % interval)"
    )
    return VergenceCheck("consistent", vergence, std, sentence)


def joined_vergence(wheels: VergenceCheck, points: VergenceCheck | None) -> VergenceCheck:
    """Return the more precise check of the vergence, with any contradiction by the other one.

    Args:
        wheels: by the wheels' distances. points: by near against far points; None if unknown.
    """
    if points is None or points.vergence_rad is None or points.std_rad is None:
        return wheels
    if wheels.vergence_rad is None or wheels.std_rad is None:
        return points
    worse = wheels.status == "unobserved" or wheels.std_rad > points.std_rad
    better, other = (points, wheels) if worse else (wheels, points)
    gap = abs(wheels.vergence_rad - points.vergence_rad)
    if gap <= _CONTRADICTION_SIGMAS * math.hypot(wheels.std_rad, points.std_rad):
        return better
    assert other.vergence_rad is not None
    assert other.std_rad is not None
    name = "the wheels" if other is wheels else "near and far points"
    contradiction = (
        f"{name} contradict this: "
        f"{format_number(math.degrees(other.vergence_rad), 2, signed=True)}° ± "
        f"{math.degrees(half_95(other.std_rad)):.2f}°; check that the wheels do not slip"
    )
    return VergenceCheck(
        better.status,
        better.vergence_rad,
        better.std_rad,
        f"{better.sentence}; {contradiction}",
        better.distance_m,
    )


def skew_check(skew: ExposureSkew) -> SkewCheck:
    """Return the check for a skew that is sure."""
    course = "after" if skew.skew_s > 0 else "before"
    sentence = (
        f"the right camera exposes {1e3 * abs(skew.skew_s):.1f} ± "
        f"{1e3 * half_95(skew.sigma_s):.1f} ms {course} the left one (95 % interval). The source "
        "does not report this sync error, so each run estimates it and compensates for it; a "
        "common hardware trigger, or a source that timestamps both images, would remove it"
    )
    return SkewCheck(skew.skew_s, skew.sigma_s, sentence)
