"""Oracle of ``observer.kernels.motion_test``: the same formulas for all points, by numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from observer.chi_square import quantile
from observer.geometry import Float64Array, cross_matrix
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.parameters import EvidenceParameters
from observer.vision.neighbourhoods import summed

from .inverses import inverse_3x3

# Neighbours must agree in depth and velocity to within this many standard deviations of both.
_DEPTH_SIGMAS = 3.0
_VELOCITY_CHI2 = quantile(0.999, df=3)
# Slope variance of a regression over a random walk of the pose, relative to that of its steps.
_RANDOM_WALK = 1.2
# An information matrix below these is rounding error: product of its three eigenvalues, relative
# to their mean cubed; and their mean, relative to the sums whose difference they are.
_LEAST_RANK = 1e-12
_LEAST_REMAINDER = 1e-9


@dataclass(frozen=True, eq=False)
class OwnMotion:
    """Motion of N points, each by itself.

    Attributes:
        ready: (N,) whether it was seen often enough, from more than one direction.
        velocity: (N, 3) m/s, world, with covariance (N, 3, 3), information (N, 3, 3) and
            ``vector`` (N, 3), information times velocity; 0 where not ready.
        position: (N, 3) metres, world, now, with ``position_cov`` (N, 3, 3).
    """

    ready: NDArray[np.bool_]
    velocity: Float64Array
    covariance: Float64Array
    information: Float64Array
    vector: Float64Array
    position: Float64Array
    position_cov: Float64Array


def moving_position(
    sums: PositionVelocityFilter, velocity: Float64Array, velocity_cov: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return where each point is now if it moves at (N, 3) m/s, and its covariance (N, 3, 3).

    Args:
        velocity_cov: (N, 3, 3), by which the covariance of the position grows.
    """
    cov = sums.position_cov
    lever = cov @ sums.a1
    cov = cov + lever @ velocity_cov @ np.swapaxes(lever, 1, 2)
    return sums.moving_position(velocity), cov


def own_motion(points: TrackedPoints, parameters: EvidenceParameters) -> OwnMotion:
    """Motion of each point by itself, its covariance inflated by scatter beyond the noise."""
    information, vector = points.sums.velocity_information()
    ready = (points.sightings >= parameters.min_sightings) & np.isfinite(vector).all(axis=1)
    ready &= points.telling
    # Seen along one line only, or always at one instant, a point's velocity is unknown.
    scale = np.trace(information, axis1=1, axis2=2) / 3
    ready &= scale > _LEAST_REMAINDER * np.trace(points.sums.a2, axis1=1, axis2=2)
    ready &= np.linalg.det(information) > _LEAST_RANK * scale**3
    information = np.where(ready[:, None, None], information, 0.0)
    vector = np.where(ready[:, None], vector, 0.0)
    cov = inverse_3x3(np.where(ready[:, None, None], information, np.eye(3)))
    velocity = np.einsum("nij,nj->ni", cov, vector)
    velocity[~ready] = 0.0
    position, position_cov = moving_position(points.sums, velocity, cov * ready[:, None, None])
    excess = _excess(points.sums, position, velocity)
    return OwnMotion(
        ready=ready,
        velocity=velocity,
        covariance=cov * excess[:, None, None],
        information=information / excess[:, None, None],
        vector=vector / excess[:, None],
        position=position,
        position_cov=position_cov * excess[:, None, None],
    )


def _excess(
    sums: PositionVelocityFilter, position: Float64Array, velocity: Float64Array
) -> Float64Array:
    """(N,) factor by which sightings scatter more about a straight course than their noise."""
    explained = np.einsum("ni,ni->n", position - sums.origin, sums.b0)
    explained += np.einsum("ni,ni->n", velocity, sums.b1)
    freedom = np.maximum(3 * sums.count - 6, 1.0)
    return np.asarray(np.maximum(1.0, (sums.c0 - explained) / freedom), np.float64)


def neighbours(
    px: NDArray[np.float32], own: OwnMotion, now: CameraStep, parameters: EvidenceParameters
) -> NDArray[np.intp]:
    """(P, 2) pairs that are near in the image and in depth, and may share a velocity."""
    if len(px) < 2:
        return np.zeros((0, 2), np.intp)
    ready = own.ready
    found = cKDTree(px).query_pairs(parameters.radius_px, output_type="ndarray")
    i, j = found[:, 0], found[:, 1]
    depth = now.T_camera_world.apply(own.position)[:, 2]
    forward = now.T_camera_world.rotation[2]
    variance = np.einsum("i,nij,j->n", forward, own.position_cov, forward)
    reach = parameters.radius_px / now.camera.fx * np.minimum(depth[i], depth[j])
    # Points that are not ready have no usable variance and are left out below.
    variance = np.where(ready & (variance > 0), variance, 0.0)
    noise = _DEPTH_SIGMAS * np.sqrt(variance[i] + variance[j])
    # The cap keeps points of very uncertain depth from being everybody's neighbour.
    allowed = reach + np.minimum(noise, reach)
    near = ready[i] & ready[j] & (np.abs(depth[i] - depth[j]) <= allowed)
    i, j = i[near], j[near]
    gap = own.velocity.take(i, axis=0) - own.velocity.take(j, axis=0)
    apart = own.covariance.take(i, axis=0) + own.covariance.take(j, axis=0)
    squared = np.einsum("pi,pij,pj->p", gap, inverse_3x3(apart), gap)
    agree = squared <= _VELOCITY_CHI2
    return np.stack([i[agree], j[agree]], axis=1)


def pooled(
    own: OwnMotion, pairs: NDArray[np.intp], parameters: EvidenceParameters
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Velocities (N, 3) over each point and its neighbours, covariance (N, 3, 3), numbers (N,)."""
    count, ready = len(own.ready), own.ready
    sums = summed(
        pairs,
        [
            own.information.reshape(count, 9),
            own.vector,
            np.einsum("ni,ni->n", own.velocity, own.vector)[:, None],
            ready.astype(np.float64)[:, None],
        ],
    )
    information = sums[:, :9].reshape(count, 3, 3)
    vector, squares, neighbours = sums[:, 9:12], sums[:, 12], sums[:, 13]
    cov = inverse_3x3(np.where(ready[:, None, None], information, np.eye(3)))
    velocity = np.einsum("nij,nj->ni", cov, vector)
    spread = squares - np.einsum("ni,ni->n", velocity, vector)
    scatter = np.maximum(1.0, spread / np.maximum(3 * (neighbours - 1), 1))
    shared = 1 + parameters.noise_correlation * np.maximum(neighbours - 1, 0)
    return velocity, cov * (scatter * shared)[:, None, None], neighbours


def significance(
    velocity: Float64Array, covariance: Float64Array, ready: NDArray[np.bool_]
) -> Float64Array:
    """(N,) Mahalanobis length of velocities (N, 3); 0 where it is unknown."""
    squared = np.einsum("ni,nij,nj->n", velocity, inverse_3x3(covariance), velocity)
    return np.sqrt(np.where(ready & np.isfinite(squared), np.maximum(squared, 0.0), 0.0))


def shared_covariance(
    position: Float64Array, window: Float64Array, now: CameraStep, parameters: EvidenceParameters
) -> Float64Array:
    """(N, 3, 3) (m/s)^2, world: covariance of velocities from errors that all points share."""
    place = now.T_camera_world.apply(position)
    errors = _common_errors(place, np.maximum(window, now.dt), now, parameters)
    common = errors @ now.T_camera_world.rotation
    return np.asarray(np.swapaxes(common, 1, 2) @ common)


def _common_errors(
    place: Float64Array, window: Float64Array, now: CameraStep, parameters: EvidenceParameters
) -> Float64Array:
    """(N, 8, 3) m/s, camera axes: apparent motion of static points from errors they share.

    Each is due to one independent cause of one standard deviation: six of the camera's own
    motion, whose covariance is the sum of their products, and the calibration's two.

    Args:
        place: (N, 3) metres, camera frame. window: (N,) seconds over which it was sighted.
    """
    out = np.zeros((len(place), 8, 3))
    values, axes = np.linalg.eigh(now.covariance)
    causes = (axes * np.sqrt(np.maximum(values, 0.0))).T
    # A turn by w moves the point p by w x p = -[p]x w; here for all six causes at once.
    turning = -cross_matrix(causes[:, :3]).transpose(2, 0, 1).reshape(3, 18)
    moved = (causes[:, 3:].reshape(18) - place @ turning).reshape(-1, 6, 3)
    out[:, :6] = moved * np.sqrt(_RANDOM_WALK / (now.dt * window))[:, None, None]
    bias_px, stretch = parameters.disparity_bias_px, parameters.distortion_sigma
    still = np.zeros_like(place)
    out[:, 6:] = now.rate.lasting_errors(place, still, now.camera, bias_px, stretch)
    return out
