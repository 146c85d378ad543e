"""Scale of the map, from the ground plane below the camera and from odometry."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array, Pose
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.rays import RayPoints
from observer.vision.lifecycle import NO_OBSTACLE

# Sine of the angle below the horizon: points above this say little about the height.
_LEAST_SLOPE = 0.06
_LEAST_POINTS = 8
_ROUNDS = 8
_WIDTH = 2.5
# Errors that points on the ground share: it is not quite flat, and the map bends.
_SHARED_SIGMA = 0.01
# The map's scale drifts by this share per root metre travelled.
_DRIFT = 0.03
# Metres: unknown lever arm between the camera and the axis about which the robot turns, and
# the encoders' resolution.
_LEVER_M, _STEP_M = 0.10, 0.003
# Metres: the shortest distance that is compared with wheel odometry.
_LEAST_DISTANCE_M = 0.12


def sigma_after_distance(sigma: float, distance_m: float) -> float:
    """Return the scale's standard deviation, as a share, after travelling ``distance_m``."""
    return float(np.sqrt(sigma**2 + _DRIFT**2 * distance_m))


def correction(sigma: float, log_ratio: float, measured_sigma: float) -> tuple[float, float]:
    """Return the factor by which to enlarge the map after a measurement, and the new sigma.

    Args:
        sigma: one standard deviation of the scale, as a share.
        log_ratio: logarithm of true length over the map's; measured_sigma: its standard deviation.
    """
    gain = sigma**2 / (sigma**2 + measured_sigma**2)
    return float(np.exp(gain * log_ratio)), float(np.sqrt(1 - gain) * sigma)


def scale_by_ground(
    inverse_height: Float64Array, sigma: Float64Array, height: float, spread: float
) -> tuple[float, float] | None:
    """Return the log of the scale factor that fits the ground's height, and its sigma.

    Objects on the ground are nearer than it, so the ground is the farthest depth that many points
    agree on.

    Args:
        inverse_height: (N,) of each point below the camera, one over the map's units. sigma:
            (N,) its standard deviation, as a share.
        height: metres, of the camera above the ground.
        spread: by how much the factor may differ from 1, as a logarithm; infinite at the start.
    """
    good = (inverse_height > 0) & (sigma < 0.25)
    value, noise = np.log(height * inverse_height[good]), np.hypot(sigma[good], _SHARED_SIGMA)
    if len(value) < _LEAST_POINTS:
        return None
    if np.isinf(spread):
        place = _densest(value, noise)
    else:
        place = 0.0
        noise = np.hypot(noise, spread)
    for _ in range(_ROUNDS):
        length = np.abs(value - place) / noise
        trust = np.where(length < _WIDTH, (1 - (length / _WIDTH) ** 2) ** 2, 0.0) / noise**2
        if np.count_nonzero(trust) < _LEAST_POINTS:
            return None
        place = float((trust * value).sum() / trust.sum())
        # Once the centre is found, the window no longer includes the map's scale uncertainty.
        noise = np.hypot(sigma[good], 2 * _SHARED_SIGMA)
    deviation = float(np.sqrt(1 / trust.sum()))
    return place, float(np.hypot(deviation, _SHARED_SIGMA))


def ground_scale(
    points: RayPoints, T_world_camera: Pose, ground: GroundPlane, scale_sigma: float
) -> tuple[float, float] | None:
    """Return the same as ``scale_by_ground`` for the map's points of known depth."""
    slope = points.ray @ ground.down
    standing = ~points.moving & (points.obstacle == NO_OBSTACLE)
    known = points.known & (slope > _LEAST_SLOPE) & standing
    below = (points.centre[known] - T_world_camera.translation) @ ground.down
    drop = slope[known] / points.inverse[known] + below
    sigma = np.sqrt(points.variance[known]) / points.inverse[known]
    inverse = np.where(drop > 0.2 * ground.depth, 1 / np.maximum(drop, 1e-6), 0.0)
    return scale_by_ground(inverse, sigma, ground.depth, 3 * scale_sigma)


def odometry_scale(
    mapped_m: float, driven_m: float, turned_rad: float, odometry_sigma: float
) -> tuple[float, float] | None:
    """Return the same from the distance driven while the camera moved ``mapped_m`` in the map.

    None if the distance is too short, or too uncertain because of turning.
    """
    if driven_m < _LEAST_DISTANCE_M or mapped_m < _LEAST_DISTANCE_M / 4:
        return None
    noise = (_LEVER_M * abs(turned_rad) + _STEP_M) / driven_m
    if noise > 0.2:
        return None
    return float(np.log(driven_m / mapped_m)), float(np.hypot(odometry_sigma, noise))


def _densest(value: Float64Array, noise: Float64Array) -> float:
    """Mode of the values, each as wide as its noise."""
    grid = np.linspace(value.min(), value.max(), 400)
    width = np.hypot(noise, 0.03)
    density = np.exp(-0.5 * ((grid[:, None] - value) / width) ** 2).sum(axis=1)
    return float(grid[np.argmax(density)])
