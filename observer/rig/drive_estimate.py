"""Extrinsics of the camera on its robot from a short drive, by wheel odometry and stereo.

Hand-eye calibration, A X = X B, of a robot that drives on a plane. With the robot's motion over
a stretch (turn psi about z, translation p) and the camera's (rotation B, translation t_B):

    R t_B  =  (Rz(psi) - I) t + s p,        R rotvec(B)  =  (0, 0, psi)

R and t are rotation and translation of ``T_base_camera``, s is visual metres per wheel metre.
Turning gives the lever arm t_xy and, by its axis, tilt and roll; driving straight gives pan and s;
neither gives the height (Censi, Franchi, Marchionni, Oriolo: Simultaneous calibration of odometry
and sensor parameters for mobile robots, T-RO 2013).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from observer.geometry import Float64Array, rotation_matrix
from observer.intervals import half_95
from observer.mount import CameraMount
from observer.number_format import format_number
from observer.rig.drive_stretches import DriveSample, Stretch, WheelPaths, drive_stretches
from observer.rig.estimates import Estimated, Refused
from observer.robust import MAD_TO_SIGMA

# Initial noise of a stretch, metres and radians; the residuals then give the real noise, within
# these factors of the initial one.
_DISTANCE_SIGMA_M, _TURN_SIGMA = 0.003, 0.002
_NOISE_FACTOR = (0.3, 30.0)
# Prior, one standard deviation: a camera is mounted roughly upright, somewhere on its robot.
# Pan, tilt, roll (rad), forward, left (m), scale.
_PRIOR_SIGMA = (2.0, 0.8, math.radians(3), 1.0, 1.0, 0.3)
# Systematic error of the camera's own path, which no residual shows: about a tenth of a pixel of
# disparity. As found in simulated drives, same order; and that of the turn scale.
_BIAS = (*(math.radians(0.1),) * 3, 0.003, 0.003, 0.01)
_TURN_BIAS = 0.002
# Factor by which errors in drives with known noise exceed what the curvature predicts: the noise
# is estimated from the same residuals that the fit has minimised.
_EXCESS = 1.25
# Largest standard deviations at which a value is still reported, in the same order.
_USEFUL = (*(math.radians(1.5),) * 3, 0.02, 0.02, 0.03)
_LEAST_TURN, _LEAST_DISTANCE_M = math.radians(40), 0.4
_FEWEST_STRETCHES = 3
# A stretch that turns less than this counts as straight.
_STRAIGHT = math.radians(3)
# Plausible ratios to what the wheels report; outside, the wheels' unit or sign is wrong.
_POSSIBLE_SCALE, _POSSIBLE_TURN = (0.5, 2.0), (0.7, 1.4)

TURN_ON_THE_SPOT = "turn on the spot by 60 degrees, to both sides if there is room"
DRIVE_STRAIGHT = "drive 1 m straight"


@dataclass(frozen=True)
class DriveEstimate:
    """Estimates from a drive so far; None for those that it does not determine yet.

    Attributes:
        forward_m, left_m: of the camera from the middle of the axle. pan_rad, tilt_rad, roll_rad:
            as in ``CameraMount``.
        wheel_scale: metres that the camera saw for each metre that the wheels report.
        turn_scale: radians that the camera saw for each radian that the wheels report.
        distance_m, turned_rad: how far the camera moved, and turned, in total.
        still_needed: what to drive to determine the rest; empty when nothing is missing.
        sentence: the result in words.
    """

    forward_m: Estimated | None
    left_m: Estimated | None
    pan_rad: Estimated | None
    tilt_rad: Estimated | None
    roll_rad: Estimated | None
    wheel_scale: Estimated | None
    turn_scale: Estimated | None
    distance_m: float
    turned_rad: float
    still_needed: tuple[str, ...]
    sentence: str


def estimate_drive(
    samples: Sequence[DriveSample],
    standing: CameraMount | None = None,
    standing_sigma_rad: float = math.radians(1),
) -> DriveEstimate | Refused:
    """Estimate the camera's pose on the robot from how both of them moved.

    Args:
        samples: in order of time, a few a second or more while the robot drives.
        standing: tilt and roll known from elsewhere, usually from the floor
            (``GroundEstimate.mount``); its height and offset do not matter.
        standing_sigma_rad: one standard deviation of its tilt and roll.
    """
    stretches = drive_stretches(samples)
    if isinstance(stretches, Refused):
        return stretches
    distance_m = sum(stretch.seen_m for stretch in stretches)
    turned = sum(stretch.seen_rad for stretch in stretches)
    if len(stretches) < _FEWEST_STRETCHES:
        return Refused(
            f"the robot has hardly moved ({distance_m:.2f} m and "
            f"{math.degrees(turned):.0f} degrees): {TURN_ON_THE_SPOT}, then {DRIVE_STRAIGHT}"
        )
    straight = [stretch for stretch in stretches if stretch.seen_rad < _STRAIGHT]
    if impossible := _impossible_distance(straight):
        return Refused(impossible)
    turned_enough = turned >= _LEAST_TURN
    values, sigmas = _fitted(stretches, standing, standing_sigma_rad)
    turn_scale = _turn_scale(stretches, values) if turned_enough else None
    if turn_scale and not _POSSIBLE_TURN[0] <= turn_scale.value <= _POSSIBLE_TURN[1]:
        return Refused(
            f"the camera turned {turn_scale.value:.2f} degrees for each degree reported by the "
            "wheels, where about 1 is expected; check that the odometry's yaw is in radians and "
            "positive to the left"
        )
    went_straight = sum(stretch.driven_m for stretch in straight) >= _LEAST_DISTANCE_M
    # Only straight driving shows where ahead is, and with it the offset's direction.
    offset_shown = turned_enough and went_straight
    shown = (
        went_straight, turned_enough, turned_enough, offset_shown, offset_shown, went_straight
    )  # fmt: skip
    pan, tilt, roll, forward, left, scale = (
        Estimated(value, sigma) if may and sigma <= useful else None
        for value, sigma, useful, may in zip(
            values.tolist(), sigmas.tolist(), _USEFUL, shown, strict=True
        )
    )
    needed = []
    offset_missing = went_straight and (forward is None or left is None)
    if offset_missing or tilt is None or roll is None:
        needed.append(TURN_ON_THE_SPOT)
    if pan is None or scale is None:
        needed.append(DRIVE_STRAIGHT)
    return DriveEstimate(
        forward_m=forward, left_m=left, pan_rad=pan, tilt_rad=tilt, roll_rad=roll,
        wheel_scale=scale, turn_scale=turn_scale, distance_m=distance_m, turned_rad=turned,
        still_needed=tuple(needed), sentence=_sentence(forward, left, pan, scale, needed),
    )  # fmt: skip


class _Model:
    """Residuals of the stretches for given extrinsics of the camera."""

    def __init__(self, stretches: Sequence[Stretch]) -> None:
        self._wheels = WheelPaths(stretches)
        self._turn = np.array([stretch.turn for stretch in stretches])
        self._translation = np.array([stretch.translation for stretch in stretches])

    def turned(self, values: Float64Array) -> Float64Array:
        """(N, 3) rotation vectors in the base's axes; about z alone if there were no errors."""
        return np.asarray(self._turn @ _rotation(values[:3]).T)

    def tipped(self, values: Float64Array) -> Float64Array:
        """(N, 2) radians about the axes x and y, about which the robot cannot turn."""
        return self.turned(values)[:, :2]

    def strayed(self, values: Float64Array) -> Float64Array:
        """(N, 3) metres by which the camera's motion differs from the predicted one."""
        turn = self.turned(values)[:, 2]
        c, s = np.cos(turn) - 1, np.sin(turn)
        forward, left, scale = values[3:]
        swing = np.stack([c * forward - s * left, s * forward + c * left, np.zeros_like(c)], axis=1)
        seen = self._translation @ _rotation(values[:3]).T
        return np.asarray(seen - swing - scale * self._wheels.driven(turn))


def _fitted(
    stretches: Sequence[Stretch], standing: CameraMount | None, standing_sigma: float
) -> tuple[Float64Array, Float64Array]:
    """(6,) pan, tilt, roll (rad), forward, left (m), scale, and their standard deviations (6,)."""
    model = _Model(stretches)
    middle = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    prior_sigma = np.array(_PRIOR_SIGMA)
    if standing is not None:
        middle[1:3] = standing.tilt_rad, standing.roll_rad
        prior_sigma[1:3] = standing_sigma
    noise = np.array([_DISTANCE_SIGMA_M, _TURN_SIGMA])

    def residuals(values: Float64Array) -> Float64Array:
        off = (values - middle) / prior_sigma
        # Periodic in the pan, so that a camera that looks back costs hardly more than one ahead.
        off[0] = math.sin(values[0] / 2) / prior_sigma[0]
        strayed, tipped = model.strayed(values) / noise[0], model.tipped(values) / noise[1]
        return np.concatenate([strayed.ravel(), tipped.ravel(), off])

    start = middle.copy()
    start[0] = _first_pan(stretches)
    # Robust loss: stretches in which the robot slips or the camera loses track count less.
    best = least_squares(residuals, start, loss="soft_l1", f_scale=2.0, max_nfev=30)
    for _ in range(2):
        noise[0] = _DISTANCE_SIGMA_M * _factor(model.strayed(best.x) / _DISTANCE_SIGMA_M)
        noise[1] = _TURN_SIGMA * _factor(model.tipped(best.x) / _TURN_SIGMA)
        best = least_squares(residuals, best.x, loss="soft_l1", f_scale=2.0, max_nfev=30)
    values = np.asarray(best.x, np.float64)
    values[0] = math.remainder(values[0], 2 * math.pi)
    J = np.asarray(best.jac, np.float64)
    variance = _EXCESS**2 * np.diagonal(np.linalg.inv(J.T @ J)) + np.array(_BIAS) ** 2
    return values, np.sqrt(variance)


def _first_pan(stretches: Sequence[Stretch]) -> float:
    """Radians, roughly: a camera that looks to the left sees the robot drive to its right."""
    right = ahead = 0.0
    for one in stretches:
        if one.seen_rad < _STRAIGHT:
            driven = float(one.steps[:, 0].sum())
            right += driven * float(one.translation[0])
            ahead += driven * float(one.translation[2])
    return math.atan2(right, ahead)


def _factor(residual: Float64Array) -> float:
    return float(np.clip(MAD_TO_SIGMA * np.median(np.abs(residual)), *_NOISE_FACTOR))


def _rotation(angles: Float64Array) -> Float64Array:
    """(3, 3) ``R_base_camera`` by pan, tilt and roll, as ``CameraMount`` composes it."""
    pan, tilt, roll = np.eye(3)[[2, 1, 0]] * angles[:, None]
    level = CameraMount(1.0, 0.0).R_base_camera
    turns = rotation_matrix(pan) @ rotation_matrix(tilt) @ rotation_matrix(roll)
    return np.asarray(turns @ level, np.float64)


def _turn_scale(stretches: Sequence[Stretch], values: Float64Array) -> Estimated | None:
    """Return the ratio of the camera's turns to the wheels' turns, by least squares."""
    seen = _Model(stretches).turned(values)[:, 2]
    wheel_turns = np.array([stretch.wheel_turn for stretch in stretches])
    size = float(wheel_turns @ wheel_turns)
    if not size > 0:
        return None
    scale = float(seen @ wheel_turns) / size
    error = (seen - scale * wheel_turns) * wheel_turns
    freedom = max(1, len(wheel_turns) - 1)
    spread = math.sqrt(float(error @ error) * len(wheel_turns) / freedom) / size
    return Estimated(scale, math.hypot(spread, _TURN_BIAS))


def _impossible_distance(straight: Sequence[Stretch]) -> str | None:
    driven_m = sum(stretch.driven_m for stretch in straight)
    seen = sum(stretch.seen_m for stretch in straight)
    low, high = _POSSIBLE_SCALE
    if driven_m < _LEAST_DISTANCE_M or low <= seen / driven_m <= high:
        return None
    return (
        f"the camera measured {seen:.2f} m of straight driving where the wheels report "
        f"{driven_m:.2f} m; check that the odometry is in metres and that the calibration's "
        "baseline is right"
    )


def _sentence(
    forward: Estimated | None,
    left: Estimated | None,
    pan: Estimated | None,
    scale: Estimated | None,
    needed: Sequence[str],
) -> str:
    parts = []
    if forward is not None and left is not None:
        parts.append(
            f"the left camera is {format_number(100 * forward.value, 1)} ± "
            f"{100 * half_95(forward.sigma):.1f} cm "
            f"ahead of the axle's centre and {format_number(100 * left.value, 1)} ± "
            f"{100 * half_95(left.sigma):.1f} cm to its left"
        )
    if pan is not None:
        parts.append(
            f"it is panned {format_number(pan.degrees.value, 1)} ± "
            f"{half_95(pan.degrees.sigma):.1f} degrees to "
            "the left of the direction of travel"
        )
    if scale is not None:
        parts.append(
            f"it measures {scale.value:.3f} ± {half_95(scale.sigma):.3f} m for each metre "
            "reported by the wheels"
        )
    if needed:
        parts.append(f"still needed: {', then '.join(needed)}")
    return "; ".join(parts)
