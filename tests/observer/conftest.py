"""Fixtures for tests of motion in space: simulated sequences, and bodies made of known points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import pytest

from observer.camera import StereoCalibration, StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import BodyFilter, yaw_matrix
from observer.methods.rigid.bodies.shape import BodyShape, Box
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.motion_test import pooled_motion
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.opening import open_source
from observer.parameters import Parameters
from observer.truth.contract import Truth
from observer.types import StereoFrame
from observer.vision.camera_rate import CameraRate

from .builders import projection_jacobian

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
HERE = Pose.identity()
DT = 1 / 15
# Pixels: noise of each coordinate and of the disparity.
SIGMA_PX = 0.15


# --- simulated sequences -------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Clip:
    """The first frames of a source, its cameras and its ground truth."""

    calibration: StereoCalibration
    frames: list[StereoFrame]
    truth: Truth | None


OpenClip = Callable[[str, int], Clip]


@pytest.fixture(scope="session")
def clip() -> OpenClip:
    """Gives the first ``count`` frames of a source; read once for all tests."""
    kept: dict[str, tuple[object, Clip]] = {}

    def read(spec: str, count: int) -> Clip:
        if spec not in kept:
            opened = open_source(spec)
            calibration = opened.source.calibration
            assert calibration is not None
            kept[spec] = (opened.source, Clip(calibration, [], opened.truth))
        source, found = kept[spec]
        while len(found.frames) < count:
            frame = source.read()  # type: ignore[attr-defined]
            assert isinstance(frame, StereoFrame), f"{spec} ends after {len(found.frames)} frames"
            found.frames.append(frame)
        return Clip(found.calibration, found.frames[:count], found.truth)

    return read


@pytest.fixture(scope="session")
def rigid() -> Parameters:
    """The default parameters with the model of motion in space."""
    return Parameters().changed({"ego_motion.model": "rigid"})


# --- bodies of known points ----------------------------------------------------------------


@dataclass(eq=False)
class PlantedBody:
    """A rigid set of points on a prescribed path.

    Attributes:
        local: (K, 3) metres, body frame. normals: (K, 3) outward; a point is visible while its
            normal faces the camera. None: all points are always visible.
        pose: maps a time in seconds to the position (3,) m of the origin, world, and yaw in rad.
        seen: maps a time to whether the camera can see the body at all.
    """

    local: Float64Array
    pose: Callable[[float], tuple[Sequence[float], float]]
    normals: Float64Array | None = None
    seen: Callable[[float], bool] = field(default=lambda _: True)

    def places(self, time: float) -> Float64Array:
        """(K, 3) metres, world."""
        origin, yaw = self.pose(time)
        return np.asarray(origin) + self.local @ yaw_matrix(yaw).T

    def shown(self, time: float) -> np.ndarray:
        """(K,) which points the camera sees."""
        if not self.seen(time):
            return np.zeros(len(self.local), bool)
        if self.normals is None:
            return np.ones(len(self.local), bool)
        _, yaw = self.pose(time)
        facing = np.einsum("ni,ni->n", self.normals @ yaw_matrix(yaw).T, self.places(time))
        return facing < -0.2 * np.linalg.norm(self.places(time), axis=1)


def box_points(
    rng: np.random.Generator, size: Sequence[float], count: int
) -> tuple[Float64Array, Float64Array]:
    """Points (4 * count, 3) on the upright faces of a box about its middle, and their normals."""
    half = np.asarray(size) / 2
    points, normals = [], []
    for axis, sign in ((0, -1), (0, 1), (2, -1), (2, 1)):
        on = rng.uniform(-half, half, (count, 3))
        on[:, axis] = sign * half[axis]
        normal = np.zeros((count, 3))
        normal[:, axis] = sign
        points.append(on)
        normals.append(normal)
    return np.concatenate(points), np.concatenate(normals)


class Watched:
    """Bodies of known points, seen with known noise by a camera that stands at the world's origin.

    Runs the stages behind the ego-motion as ``RigidMethod`` does, on arrays alone.

    Attributes:
        tracker: with its tracks. points: as of the newest frame. owner: (N,) index of each
            point's body, and which: (N,) its index within that body. time: seconds.
    """

    def __init__(self, *bodies: PlantedBody, seed: int = 0, **obstacles: float) -> None:
        self.bodies = bodies
        self.parameters = Parameters().changed(
            {f"obstacles.{name}": value for name, value in obstacles.items()}
        )
        self.tracker = BodyTracker()
        self.points = TrackedPoints.none()
        self.time = 0.0
        self._rng = np.random.default_rng(seed)
        self.owner = np.zeros(0, np.int64)
        self.which = np.zeros(0, np.int64)
        self._next = 0
        self._renew()

    @property
    def tracks(self) -> list[BodyTrack]:
        return self.tracker.tracks

    def step(self, dt: float = DT) -> list[BodyTrack]:
        """Advance by one frame."""
        self.time += dt
        points, p = self._followed(dt), self.parameters
        sightings = WorldSightings(*self._seen(points))
        points = points.sighted(sightings, dt, p.evidence.memory_s)
        step_cov = np.diag([1e-14] * 3 + [1e-12] * 3)
        now = CameraStep(CAMERA, HERE, step_cov, CameraRate.still(), dt)
        motion = pooled_motion(points, now, p.evidence)
        points = points.but(dynamic=motion.dynamic)
        self.points = self.tracker.step(points, sightings, motion, None, now, p)
        self._renew()
        return self.tracks

    def run(self, seconds: float, dt: float = DT) -> list[BodyTrack]:
        """Run frames for the given time."""
        for _ in range(round(seconds / dt)):
            self.step(dt)
        return self.tracks

    def _followed(self, dt: float) -> TrackedPoints:
        shown = [body.shown(self.time) for body in self.bodies]
        keep = np.array(
            [shown[b][k] for b, k in zip(self.owner, self.which, strict=True)],
            bool,
        )
        self.owner, self.which = self.owner[keep], self.which[keep]
        points = self.points.take(keep)
        px, disparity = self._measured()
        return points.but(
            px=px.astype(np.float32),
            disparity=disparity,
            sightings=points.sightings + 1,
            age=points.age + dt,
        )

    def _truth(self) -> Float64Array:
        every = [body.places(self.time) for body in self.bodies]
        at = [every[b][k] for b, k in zip(self.owner, self.which, strict=True)]
        return np.array(at).reshape(-1, 3)

    def _measured(self) -> tuple[Float64Array, Float64Array]:
        px, disparity = CAMERA.project(self._truth())
        noise = self._rng.normal(0, SIGMA_PX, (len(px), 3))
        return px + noise[:, :2], disparity + noise[:, 2]

    def _seen(self, points: TrackedPoints) -> tuple[Float64Array, Float64Array]:
        J = projection_jacobian(CAMERA, self._truth()) / SIGMA_PX
        return CAMERA.triangulate(points.px, points.disparity), np.swapaxes(J, 1, 2) @ J

    def _renew(self) -> None:
        """Start tracking every visible point that is not tracked yet."""
        followed = set(zip(self.owner.tolist(), self.which.tolist(), strict=True))
        fresh = [
            (b, k)
            for b, body in enumerate(self.bodies)
            for k in np.flatnonzero(body.shown(self.time)).tolist()
            if (b, k) not in followed
        ]
        if not fresh:
            return
        owner, which = np.array(fresh).T
        kept = self.owner, self.which
        self.owner, self.which = owner, which
        px, disparity = self._measured()
        new = self.points.none().but(px=px.astype(np.float32), disparity=disparity)
        place, information = self._seen(new)
        sums = PositionVelocityFilter.begin(place, information)
        found = px.astype(np.float32)
        new = TrackedPoints.begin(self._next, found, found, disparity, sums)
        self._next += len(px)
        self.points = self.points.joined(new)
        self.owner = np.concatenate([kept[0], owner])
        self.which = np.concatenate([kept[1], which])


@pytest.fixture(scope="session")
def planted() -> type[PlantedBody]:
    return PlantedBody


@pytest.fixture(scope="session")
def watched() -> type[Watched]:
    return Watched


@pytest.fixture(scope="session")
def points_on_a_box() -> Callable[..., tuple[Float64Array, Float64Array]]:
    """Gives ``box_points(rng, size, count)``."""
    return box_points


@pytest.fixture(scope="session")
def make_track() -> Callable[..., BodyTrack]:
    """Gives a track of a body with a known box, whose motion is known to about 1 cm."""

    def make(
        position: Sequence[float] = (0.0, 0.0, 3.0),
        velocity: Sequence[float] = (0.3, 0.0, 0.0),
        *,
        number: int = 1,
        yaw: float = 0.0,
        yaw_rate: float = 0.0,
        box: Box | None = None,
        sigma: float = 0.01,
    ) -> BodyTrack:
        cov = np.eye(3) * sigma**2
        motion = BodyFilter.begin(
            np.asarray(position, float), np.asarray(velocity, float), cov, cov, sigma
        )
        motion.means[:, 6], motion.means[:, 7] = yaw, yaw_rate
        box = box or Box(np.zeros(3), np.array([0.4, 0.3, 0.6]), 0.0)
        seen_px = (300.0, 150.0, 370.0, 200.0)
        return BodyTrack(id=number, filter=motion, shape=BodyShape(), box=box, box_px=seen_px)

    return make


@pytest.fixture(scope="session")
def sightings_of() -> Callable[..., PositionVelocityFilter]:
    """Gives the sums for points seen at (T, N, 3) m at times (T,), the last one being now."""

    def make(
        places: Float64Array, times: Sequence[float], sigma: float = 0.005
    ) -> PositionVelocityFilter:
        information = np.broadcast_to(np.eye(3) / sigma**2, (places.shape[1], 3, 3)).copy()
        sums = PositionVelocityFilter.begin(places[0], information)
        for before, now, at in zip(times[:-1], times[1:], places[1:], strict=True):
            sums = sums.advanced(now - before, 1e9).with_sightings(at, information)
        return sums

    return make
