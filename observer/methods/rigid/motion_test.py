"""Motion test: evidence pooled over neighbours in space, against all known errors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainccinv

from observer.chi_square import quantile
from observer.geometry import Float64Array
from observer.kernels.motion_test import agreeing_pairs, own_motion, pooled
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import EvidenceParameters
from observer.vision.neighbourhoods import false_alarms_per_test, grouped

_VELOCITY_CHI2 = quantile(0.999, df=3)


def pooled_motion(
    points: TrackedPoints, now: CameraStep, parameters: EvidenceParameters
) -> PooledMotion:
    """Test every point for motion, together with the neighbours that move as it does.

    The velocity's covariance is the inverse of the summed information, inflated for errors that
    neighbours share and for scatter beyond the noise, plus that of the camera's own motion. The
    latter is the same for all points, so pooling does not reduce it, and it accumulates over the
    frames as a random walk. Nor do pooling or time reduce the effect of a systematic disparity
    error. The threshold is the chi-squared quantile at the declared rate of false alarms per
    frame, divided by the number of independent tests.
    """
    camera, pose, rate = now.camera, now.T_camera_world, now.rate
    sums = points.sums
    ready, own_velocity, own_cov, information, vector, position, position_cov, window, _ = (
        own_motion(
            points.sightings, points.telling, sums.origin, sums.a0, sums.position_cov, sums.a1,
            sums.a2, sums.b0, sums.b1, sums.c0, sums.count, parameters.min_sightings,
        )
    )  # fmt: skip
    pairs = agreeing_pairs(
        points.px, np.argsort(points.px[:, 0], kind="stable"), ready, own_velocity, own_cov,
        position, position_cov, pose.rotation, pose.translation, camera.fx,
        parameters.radius_px, _VELOCITY_CHI2,
    )  # fmt: skip
    velocity, cov, shared_cov, significance, neighbours = pooled(
        ready, own_velocity, information, vector, position, window, pairs,
        parameters.noise_correlation, _causes(now.covariance), pose.rotation, pose.translation,
        rate.turn, rate.shift, now.dt, camera.numbers, camera.corner_px**2,
        parameters.disparity_bias_px, parameters.distortion_sigma,
    )  # fmt: skip
    threshold = _threshold(ready, neighbours, parameters)
    return PooledMotion(
        own_velocity=own_velocity,
        own_information=information,
        judged=ready,
        window_s=window,
        position=position,
        position_cov=position_cov,
        shared_cov=shared_cov,
        velocity=velocity,
        covariance=cov,
        significance=significance,
        neighbours=neighbours,
        threshold=threshold,
        dynamic=(significance > threshold) & (neighbours >= parameters.min_points),
        pairs=pairs,
    )


def group_dynamic(
    motion: PooledMotion, free: NDArray[np.bool_], min_points: int
) -> NDArray[np.int64]:
    """Number the groups of dynamic points that agree in position and velocity.

    Args:
        free: (N,) which points may be grouped.

    Returns:
        (N,) group number from 0, largest group first; -1 for all other points.
    """
    return grouped(motion.pairs, motion.dynamic & free, min_points)


def _causes(covariance: Float64Array) -> Float64Array:
    """(6, 6) independent one-sigma errors of a motion whose outer products sum to this."""
    values, axes = np.linalg.eigh(covariance)
    return np.ascontiguousarray((axes * np.sqrt(np.maximum(values, 0.0))).T)


def _threshold(
    ready: NDArray[np.bool_], neighbours: NDArray[np.int64], parameters: EvidenceParameters
) -> float:
    """Return the Mahalanobis length in 3D for the declared rate of false alarms."""
    rate = false_alarms_per_test(parameters.false_alarms_per_frame, ready, neighbours)
    # The quantile of chi-squared with three degrees of freedom.
    return float(np.sqrt(2 * gammainccinv(1.5, rate)))
