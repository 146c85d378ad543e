"""Detectable speeds of a rig and their delay, by the method's own statistics.

A thing at rest begins to move. Each frame's measurements of it, without noise but with the
variances of the noise, go into the same filters that the rigid method uses
(``observer.methods.rigid``), and the result is the time at which all of its conditions are met:

1. The evidence of m neighbours is pooled: the variance of one point's velocity, enlarged for the
   bend between rest and motion, times (1 + s (m - 1)) / m with the shared error s, plus that of the
   camera's own motion. v^2 / variance + 3 (what noise adds on average) must exceed the quantile of
   chi-squared at the declared rate of false alarms.
2. All n points together begin a track. Its velocity must stay significant and above the speed that
   counts as stopped, and enough points must see it for some frames
   (``observer.methods.rigid.bodies.lifecycle``).

Across, a point is known to Z sigma / f. Along the line of sight its disparity gives it to
Z^2 sigma_d / (f B); but an approaching thing also grows, and the growth gives it to
Z^2 sigma / (f r) for a point at the distance r from the axis. Both count, averaged over the thing:
the information along the line of sight is (f / Z^2)^2 (B^2 / sigma_d^2 + r^2 / sigma^2).

``Thing`` holds the assumptions on the thing and on the image; the camera stands still.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.camera import StereoCamera
from observer.chi_square import upper_quantile
from observer.geometry import Float64Array, Pose
from observer.kernels.motion_test import RANDOM_WALK
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.expectation import predict
from observer.methods.rigid.bodies.filter import BodyFilter
from observer.methods.rigid.bodies.lifecycle import judge
from observer.methods.rigid.bodies.shape import BodyShape
from observer.methods.rigid.bodies.spawning import YAW_RATE_SIGMA
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.parameters import Parameters
from observer.types import BoxPx, TrackState
from observer.vision.camera_rate import CameraRate

# Seconds of rest before it moves: several times the filters' memory.
_REST_S = 2.0
_LEAST_VELOCITY_VARIANCE = 1e-6
# m/s: the speeds to try.
_SPEEDS = (0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0)


@dataclass(frozen=True)
class Thing:
    """Assumptions on a thing that moves, and on the image.

    Attributes:
        width_m, height_m: of a person, as far as in view.
        followed_share: share of the squares (``klt_tracking.spacing_px``) it covers that have a
            trackable point. most_points: limit on these; near a camera clothes lack texture.
        sigma_px, disparity_px: noise of one tracked point and of its disparity, pixels, as the
            method measures it where there is texture.
    """

    width_m: float = 0.5
    height_m: float = 1.7
    followed_share: float = 0.5
    most_points: int = 20
    sigma_px: float = 0.1
    disparity_px: float = 0.15

    def spread_m(self, camera: StereoCamera, depth: float) -> float:
        """Root mean square distance of its points from the axis, metres, if it is in the middle."""
        across = min(self.width_m, camera.width * depth / camera.fx)
        down = min(self.height_m, camera.height * depth / camera.fy)
        return math.sqrt((across**2 + down**2) / 12)

    def points(self, camera: StereoCamera, depth: float, spacing_px: float) -> int:
        """Return how many points of it are tracked at this depth, metres."""
        across = min(camera.fx * self.width_m / depth, camera.width)
        down = min(camera.fy * self.height_m / depth, camera.height)
        return min(self.most_points, int(self.followed_share * across * down / spacing_px**2))


@dataclass(frozen=True)
class Detectable:
    """A speed, and the delay from its onset until it is reported, seconds."""

    speed_mps: float
    delay_s: float


def slowest_reported(
    camera: StereoCamera,
    depth: float,
    direction: tuple[float, float, float],
    frame_rate: float,
    within_s: float,
    thing: Thing,
    parameters: Parameters,
) -> Detectable | None:
    """Return the slowest of several speeds that is reported within this time; None if none is.

    Args:
        depth: metres. direction: unit vector, camera axes: (1, 0, 0) across, (0, 0, -1) towards.
    """
    count = thing.points(camera, depth, parameters.klt_tracking.spacing_px)
    for speed in _SPEEDS:
        velocity = speed * np.array(direction)
        delay = report_delay(
            camera, depth, velocity, count, frame_rate, within_s, thing, parameters
        )
        if delay is not None:
            return Detectable(speed, delay)
    return None


def report_delay(
    camera: StereoCamera,
    depth: float,
    velocity: Float64Array,
    count: int,
    frame_rate: float,
    within_s: float,
    thing: Thing,
    parameters: Parameters,
) -> float | None:
    """Seconds from its first motion until a thing is reported; None if not ``within_s``.

    Args:
        depth: metres. velocity: (3,) m/s, camera axes. count: points that are tracked on it.
        thing: only its noise and extent count, not its number of points.
    """
    p, dt = parameters, 1 / frame_rate
    if count < max(p.evidence.min_points, p.obstacles.min_points):
        return None
    deviations = _point_deviations(camera, depth, thing)
    # Error that all points share: the camera's own motion, by a background that fills the image.
    step_cov = np.diag(deviations**2) * p.ego_motion.noise_correlation
    information = np.diag(1 / deviations**2)
    start = np.array([0.0, 0.0, depth])
    sums = PositionVelocityFilter.begin(start[None], information[None])
    for _ in range(round(_REST_S * frame_rate)):
        sums = sums.advanced(dt, p.evidence.memory_s).with_sightings(start[None], information[None])
    neighbours = _neighbours(count, p)
    threshold = _threshold(camera, neighbours, p)
    tracker = BodyTracker()
    still = CameraStep(camera, Pose.identity(), step_cov, CameraRate.still(), dt)
    for frame in range(1, int(within_s * frame_rate + 1e-6) + 1):
        place = start + velocity * frame * dt
        sums = sums.advanced(dt, p.evidence.memory_s).with_sightings(place[None], information[None])
        if not tracker.tracks:
            own, own_cov = _own_velocity(sums)
            shared = (1 + p.evidence.noise_correlation * (neighbours - 1)) / neighbours
            window = max(dt, float(sums.window_s()[0]))
            cov = own_cov * shared + step_cov * RANDOM_WALK / (dt * window)
            if own @ np.linalg.solve(cov, own) + 3 < threshold:
                continue
            if np.linalg.norm(own) < 0.5 * p.obstacles.stopped_below_mps:
                continue
            cov = own_cov * (1 + p.obstacles.noise_correlation * count) / count
            tracker.tracks.append(_start_track(place, own, cov, count))
            tracker.tracks[0].box_px = _box_px(camera, depth, thing)
            continue
        predict(tracker.tracks, still, p.obstacles)
        track = tracker.tracks[0]
        noise = _measured_noise(deviations, count, thing, p)
        noise[:3, :3] += step_cov
        track.filter = track.filter.updated(np.append(place, track.yaw), noise)
        judge(track, still.position, dt, p.obstacles)
        if track.state is TrackState.CONFIRMED:
            return frame * dt
    return None


def _point_deviations(camera: StereoCamera, depth: float, thing: Thing) -> Float64Array:
    """(3,) metres, x y z: standard deviations of a point's position from one sighting."""
    across, down = depth * thing.sigma_px / camera.fx, depth * thing.sigma_px / camera.fy
    by_disparity = 1 / camera.depth_sigma(depth, thing.disparity_px)
    by_growth = thing.spread_m(camera, depth) / (depth * across)
    return np.array([across, down, 1 / math.hypot(by_disparity, by_growth)])


def _own_velocity(sums: PositionVelocityFilter) -> tuple[Float64Array, Float64Array]:
    """(3,) m/s and (3, 3): apparent velocity of one point, as part of the memory is rest."""
    information, vector = sums.velocity_information()
    cov = np.linalg.inv(information[0])
    velocity = cov @ vector[0]
    # By how much a straight course misses the bend, beyond the noise
    # (as PositionVelocityFilter.excess, which expects noisy sightings).
    position = sums.moving_position(velocity[None])
    explained = (position - sums.origin)[0] @ sums.b0[0] + velocity @ sums.b1[0]
    freedom = max(3 * float(sums.count[0]) - 6, 1.0)
    return velocity, cov * (1 + max(0.0, float(sums.c0[0] - explained)) / freedom)


def _neighbours(count: int, p: Parameters) -> float:
    """Return how many points of the thing are judged together, the point itself included."""
    around = math.pi * (p.evidence.radius_px / p.klt_tracking.spacing_px) ** 2
    return max(1.0, min(float(count), Thing().followed_share * around, around))


def _threshold(camera: StereoCamera, neighbours: float, p: Parameters) -> float:
    """Squared significance that evidence must exceed."""
    squares = camera.width * camera.height / p.klt_tracking.spacing_px**2
    tests = max(1.0, Thing().followed_share * squares / neighbours)
    return upper_quantile(p.evidence.false_alarms_per_frame / tests, df=3)


def _start_track(
    place: Float64Array, velocity: Float64Array, cov: Float64Array, count: int
) -> BodyTrack:
    """Return a track as the method begins it."""
    motion = BodyFilter.begin(
        place,
        velocity,
        np.eye(3) * 1e-6,
        cov + np.eye(3) * _LEAST_VELOCITY_VARIANCE,
        YAW_RATE_SIGMA,
    )
    track = BodyTrack(id=-1, filter=motion, shape=BodyShape())
    track.points = count
    return track


def _box_px(camera: StereoCamera, depth: float, thing: Thing) -> BoxPx:
    """Return the box of a thing straight ahead, pixels of the left image."""
    across, down = thing.width_m * camera.fx / depth / 2, thing.height_m * camera.fy / depth / 2
    return camera.cx - across, camera.cy - down, camera.cx + across, camera.cy + down


def _measured_noise(
    deviations: Float64Array, count: int, thing: Thing, p: Parameters
) -> Float64Array:
    """(4, 4) covariance of a body's position and yaw by ``count`` points across its width."""
    variance = np.diag(deviations**2)
    turn = deviations[2] ** 2 / (thing.width_m**2 / 12)
    shared = (1 + p.obstacles.noise_correlation * count) / count
    out = np.zeros((4, 4))
    out[:3, :3], out[3, 3] = variance * shared, turn * shared
    return out
