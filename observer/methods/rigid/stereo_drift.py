"""Systematic errors of the stereo pair, estimated online: disparity bias and exposure skew."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.intervals import half_95
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.point_tracking import LEAST_DISPARITY_PX
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.number_format import format_number
from observer.parameters import Parameters
from observer.robust import median
from observer.trace import Trace
from observer.vision.disparity_bias import DisparityBias
from observer.vision.exposure_skew import DisparityStep, ExposureSkew
from observer.vision.lifecycle import NO_OBSTACLE
from observer.vision.vergence_fit import SeenTwice
from observer.vision.view import StereoRows, View

# The two views of a pair are at least this far apart, as a share of the median depth, and turned
# by at most this, radians.
_DISTANCE_SHARE, _MOST_TURN = 0.02, 0.1
# Seconds between two fits once the bias is known this well, pixels; each fit takes 1 ms.
_PAUSE_S, _WELL_KNOWN_PX = 0.5, 0.07
# Seconds, one standard deviation: largest skew assumed if the source gives no right exposure time.
# While the camera turns, a skew looks like a bias.
_UNREPORTED_SKEW_S = 0.002
# Pixels: a larger median row offset indicates errors in pitch, roll or the lenses, which distort
# disparities in other ways.
_MOST_ROW_PX = 0.7
# A new estimate replaces the one in use once it differs by this many pixels or standard deviations
# (bias), or seconds (skew).
_NEW_BIAS_PX, _NEW_BIAS_SIGMAS, _NEW_SKEW_S = 0.02, 0.5, 0.001


@dataclass(frozen=True)
class DriftChange:
    """Change of the corrections in use, after a frame.

    Attributes:
        bias_px: added to all disparities from now on, pixels at the image's centre.
        skew: whether a new skew is in use.
        notes: one sentence each.
    """

    bias_px: float
    skew: bool
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class _KeyView:
    rows: StereoRows
    T_world_camera: Pose
    time: float


class StereoDrift:
    """Estimates for one stereo pair, and the values in use; they outlive segments.

    Attributes:
        bias, skew: the estimates. bias_px: in use, pixels at the image's centre; 0 before.
        skew_s: in use, seconds; None before.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self._camera = camera
        self.bias, self.skew = DisparityBias(), ExposureSkew()
        self.bias_px = 0.0
        self.skew_s: float | None = None
        self._skew_is_reported = False
        self._key: _KeyView | None = None
        self._fitted_s = -math.inf

    def begin_segment(self) -> None:
        """Forget the views; points and poses of different segments are unrelated."""
        self._key, self._fitted_s = None, -math.inf
        self.skew = self.skew.interrupted()

    def timed(self, view: View) -> View:
        """Return the view with the right image's time, as given or estimated, if known."""
        if view.right_time is not None or self.skew_s is None:
            return view
        return replace(view, right_time=view.time + self.skew_s)

    def remaining(self, parameters: Parameters) -> Parameters:
        """Return the parameters with the prior sigmas replaced by those of the values in use."""
        p = parameters
        if self.bias_px:
            sigma = min(p.evidence.disparity_bias_px, self.bias.sigma_px)
            p = p.model_copy(
                update={"evidence": p.evidence.model_copy(update={"disparity_bias_px": sigma})}
            )
        if self.skew_s is not None and not self._skew_is_reported:
            sigma = max(p.klt_tracking.skew_sigma_s, self.skew.sigma_s)
            p = p.model_copy(
                update={"klt_tracking": p.klt_tracking.model_copy(update={"skew_sigma_s": sigma})}
            )
        return p

    def learn(
        self,
        view: View,
        before: TrackedPoints,
        found: NDArray[np.bool_],
        points: TrackedPoints,
        rows: StereoRows,
        now: CameraStep,
        parameters: Parameters,
        trace: Trace,
    ) -> DriftChange | None:
        """Learn from one more frame; return the change of the values in use, None if none.

        Args:
            view: as the source gave it. before: (N,) points at the last frame; those ``found``
                (N,) are ``points`` in this one. rows: of this frame, without the bias.
        """
        self._skew_is_reported = view.right_time is not None
        if not self._skew_is_reported:
            # What moves shifts the flow and the disparities as a skew does.
            free = (before.obstacle == NO_OBSTACLE) & (before.within == NO_OBSTACLE)
            stands = free[found] & ~before.dynamic[found]
            self.skew = self.skew.after(
                DisparityStep.of(
                    before.px[found][stands],
                    points.px[stands],
                    _raw(before)[found][stands],
                    _raw(points)[stands],
                    now.dt,
                    self._camera,
                )
            )
        self._look_for_bias(view.time, rows, now, parameters)
        trace.keep("disparity_bias", self.bias)
        trace.keep("exposure_skew", self.skew)
        return self._use()

    def _look_for_bias(
        self, time: float, rows: StereoRows, now: CameraStep, parameters: Parameters
    ) -> None:
        key = self._key
        if key is None:
            self._key = _KeyView(rows, now.T_world_camera, time)
            return
        T_now_key = now.T_camera_world @ key.T_world_camera
        distance_m, turn = (
            float(np.linalg.norm(v)) for v in (T_now_key.translation, T_now_key.rotvec)
        )
        deep = rows.disparity > 0
        if not deep.any() or median(np.abs(rows.offset_px[deep])) > _MOST_ROW_PX:
            return
        disparity = median(rows.disparity[deep])
        depth_m = self._camera.fb / disparity
        if distance_m < _DISTANCE_SHARE * depth_m and turn < _MOST_TURN:
            return
        due = self.bias.sigma_px > _WELL_KNOWN_PX or time - self._fitted_s >= _PAUSE_S
        doubt_px = self._skew_sigma_s(parameters) * self._camera.fx * turn / (time - key.time)
        if due and turn < _MOST_TURN:
            self._fitted_s = time
            seen = SeenTwice.of(key.rows, rows, T_now_key)
            self.bias = self.bias.with_pair(seen, self._camera, doubt_px)
        self._key = _KeyView(rows, now.T_world_camera, time)

    def _skew_sigma_s(self, parameters: Parameters) -> float:
        if self._skew_is_reported:
            return parameters.klt_tracking.skew_sigma_s
        return min(self.skew.sigma_s, _UNREPORTED_SKEW_S)

    def _use(self) -> DriftChange | None:
        change, notes, skew = 0.0, [], False
        bias = self.bias
        gap = bias.px - self.bias_px
        found = self.skew
        new = self.skew_s is None or abs(found.skew_s - self.skew_s) > _NEW_SKEW_S
        if not self._skew_is_reported and found.sure and new:
            skew, self.skew_s = True, found.skew_s
            # The bias estimate and the key view were made without this skew.
            change, self.bias, self.bias_px, self._key = -self.bias_px, DisparityBias(), 0.0, None
            skew_ms = format_number(1e3 * found.skew_s, 1, signed=True)
            notes.append(
                f"the right camera exposes {skew_ms} ± "
                f"{1e3 * half_95(found.sigma_s):.1f} ms after the left one (95 % interval, "
                "estimated while the camera turned); compensated from here on"
            )
        elif bias.sure and abs(gap) > max(_NEW_BIAS_PX, _NEW_BIAS_SIGMAS * bias.sigma_px):
            if not self.bias_px:
                offset_px = format_number(bias.px, 2, signed=True)
                notes.append(
                    f"near and far points show a disparity offset of {offset_px} ± "
                    f"{half_95(bias.sigma_px):.2f} px from the calibration (95 % interval); "
                    "compensated from here on, but recalibrate the cameras"
                )
            change, self.bias_px = gap, bias.px
        return DriftChange(change, skew, tuple(notes)) if change or skew else None


def with_bias(points: TrackedPoints, bias_px: float, now: CameraStep) -> TrackedPoints:
    """Return the points as if all their disparities had been larger by a bias, pixels."""
    place = points.sums.moving_position(points.velocity)
    shift, drift, disparity = shift_by_bias(place, points.velocity, bias_px, now)
    return points.but(
        sums=points.sums.shifted(shift, drift),
        disparity=np.maximum(points.disparity + disparity, LEAST_DISPARITY_PX),
    )


def shift_by_bias(
    place: Float64Array, velocity: Float64Array, bias_px: float, now: CameraStep
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return shift (N, 3) m and velocity change (N, 3) m/s, world, and bias (N,) px per point.

    Args:
        place: (N, 3) m, velocity: (N, 3) m/s, world. bias_px: added at the image's centre.
    """
    camera, T = now.camera, now.T_camera_world
    p = T.apply(place)
    seen = p[:, 2] > 0
    p = np.where(seen[:, None], p, [0.0, 0.0, 1.0])
    bias = bias_px * (1 + ((p[:, 0] - camera.baseline) / p[:, 2]) ** 2) * seen
    d = camera.fb / p[:, 2]
    ratio = d / np.maximum(d + bias, LEAST_DISPARITY_PX)
    drift = now.rate.velocity_by_bias(p, T.rotate(velocity), camera)
    drift *= (bias * ratio**2)[:, None]
    shift = p * (ratio - 1)[:, None] * seen[:, None]
    return shift @ T.rotation, drift @ T.rotation, bias


def _raw(points: TrackedPoints) -> Float64Array:
    return np.asarray(points.px[:, 0] - points.right_px[:, 0], dtype=np.float64)
