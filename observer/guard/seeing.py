"""Conversion of an observation to the guard's input, in the robot's frame."""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Float64Array, largest_sigma
from observer.guard.sight import FreeScan, SeenObstacle, Sight
from observer.mount import CameraMount
from observer.types import Observation, Obstacle, Status, TrackState

# Standard deviations: significance of its motion at which a tentative track counts.
_SURE = 4.0
# Metres: often only part of a body is seen, or a few points on it. It is then assumed to be a
# person, who extends this far from the centre to the elbows and the leading foot.
LEAST_RADIUS_M = 0.3


def sight_of_observation(
    observation: Observation,
    camera: StereoCamera,
    mount: CameraMount | None,
    world: str | None,
    scan: FreeScan | None,
    published: float,
) -> Sight:
    """Return the sight of a frame for the drive process.

    Regions in which motion could not be noticed do not make the frame unfit for driving: where no
    floor is seen the free scan is unknown, which counts as blocked.

    Args:
        camera: the rectified pair. mount: of the cameras on the robot; None where unknown, so that
            no positions are known.
        scan: the free floor of this very frame; None where it was not computed.
        published: the host's monotonic clock.
    """
    unseen = () if observation.unseen is None else observation.unseen.reasons
    reasons = tuple(reason for reason in observation.reasons if reason not in unseen)
    only_unseen = observation.status is Status.DEGRADED and bool(unseen) and not reasons
    return Sight(
        frame=observation.frame,
        received=observation.received,
        published=published,
        world=world,
        status=Status.OK if only_unseen else observation.status,
        reasons=reasons,
        mount_known=mount is not None,
        obstacles=() if mount is None else seen_obstacles(observation, camera, mount),
        scan=None if mount is None else scan,
    )


def seen_obstacles(
    observation: Observation, camera: StereoCamera, mount: CameraMount
) -> tuple[SeenObstacle, ...]:
    """The tracks that count for driving, over the floor.

    Confirmed and coasting ones; and tentative ones whose motion is significant by ``_SURE``
    standard deviations and whose velocity covariance is known: waiting for their confirmation
    would cost about 0.2 s, in which a robot at 0.4 m/s drives 8 cm. Weaker ones are left out: they
    come and go, and the free scan contains their surfaces anyway.
    """
    return tuple(
        _seen(one, camera, mount)
        for one in observation.obstacles
        if one.state is not TrackState.TENTATIVE
        or (one.significance >= _SURE and one.velocity_cov is not None)
    )


def _seen(one: Obstacle, camera: StereoCamera, mount: CameraMount) -> SeenObstacle:
    place = mount.T_base_camera.apply(one.position_camera)
    velocity = mount.R_base_camera @ one.velocity_camera
    # Sizes are across the heading, upwards and along it.
    corner = float(np.hypot(one.size[0], one.size[2])) / 2
    return SeenObstacle(
        id=one.id,
        x=float(place[0]),
        y=float(place[1]),
        vx=float(velocity[0]),
        vy=float(velocity[1]),
        radius_m=max(corner, _reach(one, camera), LEAST_RADIUS_M),
        position_sigma_m=_sigma(one.position_cov),
        velocity_sigma_mps=_sigma(one.velocity_cov),
        coasting=one.state is TrackState.COASTING,
    )


def _reach(one: Obstacle, camera: StereoCamera) -> float:
    """Metres that the silhouette extends sideways from the centre, at its depth; 0 without one."""
    if one.silhouette is None:
        return 0.0
    x, _, z = one.position_camera
    u = np.concatenate(one.silhouette)[:, 0]
    return float(np.abs((u - camera.cx) / camera.fx * z - x).max())


def _sigma(covariance: Float64Array | None) -> float | None:
    """Return the largest standard deviation over all directions; None where it is unknown."""
    if covariance is None or not np.isfinite(covariance).all():
        return None
    return largest_sigma(covariance)
