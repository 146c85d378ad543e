"""One camera: depth from motion, scale from odometry or from the height above the ground.

Only the left image is used. Points are tracked and tested for being static; an obstacle's distance
is that of its ground contact. All results are less certain than with two cameras, and their
covariances say so.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.contract import StageTimer, Step
from observer.methods.monocular.ground import GroundPlane
from observer.methods.monocular.ground_obstacles import GroundObstacles
from observer.methods.monocular.ground_odometry import GroundFollower, GroundOdometer
from observer.methods.monocular.initialization import (
    Initialization,
    initialize_from_two_views,
    initialize_over_ground,
)
from observer.methods.monocular.inverse_depth import (
    anchored_anew,
    expected_sightings,
    lines_of_sight,
    updated,
)
from observer.methods.monocular.map_scale import MapScale
from observer.methods.monocular.motion_test import ray_evidence
from observer.methods.monocular.pose import PoseEstimate, estimate_pose
from observer.methods.monocular.rays import RayPoints
from observer.methods.monocular.two_views import turned_between
from observer.mount import CameraMount
from observer.parameters import Parameters
from observer.trace import Trace
from observer.types import Matches, Status
from observer.vision.keypoints import (
    attention,
    density_weights,
    grid_cells,
    new_keypoints,
    one_per_cell,
)
from observer.vision.klt_tracking import (
    FIRST_LEVELS,
    LEVELS,
    as_bright_as,
    track_stereo_points,
)
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds
from observer.vision.rigid_ego_motion import RigidEgoMotion
from observer.vision.view import View
from observer.vision.wheel_odometry import driven_distance, driven_step

# Prior of a new point's inverse depth, 1 / camera heights: its mean above the minimum that the
# ground allows, and its standard deviation.
_FIRST_INVERSE, _FIRST_SIGMA = 0.10, 0.25
# Camera height assumed for this prior where it is unknown.
_SOME_HEIGHT_M = 1.0
# Weight of the newest frame in the noise learnt from the background.
_NOISE_GAIN = 0.2
# Standard deviations of the motion since the last frame from the predicted one: with odometry,
# radians and metres plus shares of the measured motion; without, from a robot's acceleration.
_STEP_TURN, _STEP_DISTANCE_M = 0.006, 0.0008
_TURN_SHARE, _DISTANCE_SHARE = 0.05, 0.04
_TURN_ACCELERATION, _ACCELERATION = 3.0, 3.0
_FIRST_TURN_RATE, _FIRST_SPEED = 1.0, 1.0
# Below this share of points with known depth the camera has not translated enough.
_LEAST_KNOWN = 0.25
_ANCHOR_TURNS = 4
# The camera counts as turned beyond this angle since the first view, and as turning beyond this
# rate: above the drift and the noise of a straight drive.
_TURNED_RAD, _TURNING_RADPS = 0.01, 0.05
_LEAST_LEFT = 0.5

NO_SCALE = (
    "the monocular method needs the camera's height above the ground or odometry for scale; set "
    "monocular.height_m and monocular.tilt_deg, or use a source whose robot reports odometry"
)
ONLY_TURNED = "the camera has only turned: monocular depth needs translation"
NOT_TRAVELLED = "the camera has not moved far enough yet: monocular depth needs translation"


class MonocularMethod:
    """Holds the tracked points, the obstacles, the pose and the scale of one segment.

    See ``observer.methods.contract.Method``.
    """

    def __init__(
        self,
        camera: StereoCamera,
        view: View,
        parameters: Parameters,
        numbers: TrackIds | None = None,
        mount: CameraMount | None = None,
    ) -> None:
        """Start a new world at ``view``; ``numbers`` supplies the ids of tracks.

        Args:
            mount: how the camera is mounted on its robot; None if only the parameters may say.
        """
        self._camera = camera
        self._mount = _mount_in_force(mount, parameters)
        self._ground = None if self._mount is None else GroundPlane.below(self._mount)
        self._obstacles = GroundObstacles(camera, self._ground, numbers)
        self._points = RayPoints.none()
        self._T_camera_world = Pose.identity()
        self._rate: tuple[Float64Array, Float64Array] | None = None
        self._noise = 1.0
        self._scale = MapScale(
            parameters.monocular.odometry_sigma, self._ground, Pose.identity(), view.odometry
        )
        # With odometry and mount the motion is known at once; otherwise two views are needed.
        self._started = self._mount is not None and view.odometry is not None
        self._odometer: GroundOdometer | None = None
        self._view = view
        self._begin_anew(view, parameters)

    def step(self, view: View, parameters: Parameters, timer: StageTimer, trace: Trace) -> Step:
        """Compare this view with the last one whose pose is known."""
        previous, before, p = self._view, self._points, parameters
        dt = view.time - previous.time
        with timer("klt_tracking"):
            T_expected, prior = self._expectation(previous, view, dt)
            points, found = self._followed(previous, view, T_expected, dt, p)
        _keep_background(trace, previous, before, points, found)
        if not self._started:
            with timer("ego_motion"):
                return self._start(points, view, p, trace)
        with timer("ego_motion"):
            estimate = self._pose(points, T_expected, prior, p)
            if self._odometer is not None:
                measured = self._odometer.measured(
                    view.left, estimate.T_camera_world, estimate.covariance
                )
                estimate = estimate if measured is None else self._pose(points, *measured, p)
            ego = self._ego_motion(points, estimate, p)
        trace.keep("ego_motion", ego)
        if ego.T_camera_world is None or ego.T_current_previous is None:
            unseen = self._obstacles.unseen(
                self._T_camera_world.inverse(), previous.time, view.time, p
            )
            return Step(ego, None, unseen, 1.0, None)
        with timer("motion"):
            self._noise += _NOISE_GAIN * (max(estimate.noise_scale, 0.5) - self._noise)
            points = updated(
                points, ego.T_camera_world, estimate.covariance, self._noise, self._camera
            )
            evidence = ray_evidence(
                points, ego.T_camera_world, estimate.covariance, dt, self._ground,
                float(np.radians(p.monocular.tilt_sigma_deg)), self._camera, p.evidence,
            )  # fmt: skip
            points = points.but(moving=evidence.moving)
            trace.keep("rays", points)
            trace.keep("ray_evidence", evidence)
            points = self._scale.corrected(
                points, ego.T_camera_world, self._T_camera_world, view.odometry, self._odometer,
                view.left, p.monocular,
            )  # fmt: skip
        T_world_camera = ego.T_camera_world.inverse()
        with timer("tracking"):
            points = self._obstacles.step(
                points, evidence, view.left, T_world_camera, self._T_camera_world, dt, p
            )
        moved = ego.T_current_previous
        self._rate = (moved.rotvec / dt, moved.translation / dt)
        self._T_camera_world, self._points, self._view = ego.T_camera_world, points, view
        with timer("features"):
            self._anchor(view, p)
            self._renew_points(view, p)
        obstacles = self._obstacles.described(
            T_world_camera, -moved.translation / dt, self._scale.sigma(p.monocular), view.time, p
        )
        return Step(ego, T_world_camera, obstacles, 1.0, None)

    # ------------------------------------------------------------------ following

    def _expectation(
        self, previous: View, view: View, dt: float
    ) -> tuple[Pose, NDArray[np.float64]]:
        """Predict the camera's pose and its information (6, 6)."""
        T = self._T_camera_world
        if self._mount is not None and previous.odometry and view.odometry:
            step, driven_m, turn = driven_step(previous.odometry, view.odometry, self._mount)
            turn_sigma = _STEP_TURN + _TURN_SHARE * turn
            distance_sigma = (
                _STEP_DISTANCE_M + _DISTANCE_SHARE * driven_m + self._mount.lever_sigma_m * turn
            )
            return step @ T, _information(turn_sigma, distance_sigma)
        if self._rate is None:
            return T, _information(_FIRST_TURN_RATE * dt, _FIRST_SPEED * dt)
        step = Pose.from_rotvec(self._rate[0] * dt, self._rate[1] * dt)
        square = dt * dt
        return step @ T, _information(_TURN_ACCELERATION * square, _ACCELERATION * square)

    def _followed(
        self, previous: View, view: View, T_expected: Pose, dt: float, p: Parameters
    ) -> tuple[RayPoints, NDArray[np.bool_]]:
        """Return the points that were found again, and (N,) which those are."""
        points = self._points
        # Start from where each point was last seen, not from where it should be: it may move.
        expected = expected_sightings(points, T_expected, self._camera).px + points.residual
        steady = 2 * points.px - points.before_px
        own = points.moving | (points.obstacle != NO_OBSTACLE) | ~np.isfinite(expected).all(axis=1)
        start = np.where(own[:, None] | (not self._started), steady, expected).astype(np.float32)
        before = as_bright_as(view.left, previous.left)
        nothing = np.full((len(points), 2), np.nan, np.float32)
        levels = FIRST_LEVELS if self._rate is None else LEVELS
        seen = track_stereo_points(
            (before, before), (view.left, view.left), points.px, nothing, start, nothing[:, 0],
            levels, p.klt_tracking,
        )  # fmt: skip
        kept = points.take(seen.found)
        return kept.but(
            px=seen.px[seen.found],
            before_px=kept.px,
            sigma_px=seen.sigma[seen.found, 0].astype(np.float64),
            anchor_s=kept.anchor_s + dt,
            age_s=kept.age_s + dt,
            sightings=kept.sightings + 1,
        ), seen.found

    # ------------------------------------------------------------------ the start

    def _start(self, points: RayPoints, view: View, p: Parameters, trace: Trace) -> Step:
        """Wait for two views far enough apart; then the pose and all depths are known at once."""
        reason = self._try_to_start(points, view, p)
        status = Status.LOST if reason == NO_SCALE else Status.DEGRADED
        if reason is None:
            reason = "this is the first frame with known pose and depth"
        inliers = np.ones(len(points), np.bool_)
        T = self._T_camera_world if self._started else None
        cov = np.eye(6) * _STEP_TURN**2 if self._started else None
        ego = RigidEgoMotion(self._camera, status, (reason,), inliers, T, pose_covariance=cov)
        trace.keep("ego_motion", ego)
        pose = None if T is None else T.inverse()
        return Step(ego, pose, (), 1.0, None, waiting=not self._started)

    def _try_to_start(self, points: RayPoints, view: View, p: Parameters) -> str | None:
        """Try to initialize; return None once done, else the reason why it is not possible yet."""
        driven = driven_distance(self._scale.odometry, view.odometry)
        if self._mount is None and driven is None:
            self._view, self._points = view, points
            return NO_SCALE
        if len(points) < p.ego_motion.min_inliers:
            # Too few points of the first view are left; restart the world here.
            self._begin_anew(view, p)
            return f"only {len(points)} points could be tracked: too few features"
        first = points.ray @ self._T_camera_world.rotation.T
        now = lines_of_sight(points.px, Pose.identity(), self._camera)
        R, parallax = turned_between(first, now)
        self._view, self._points = view, points
        shift = float(np.median(parallax))
        motion = None if self._follower is None else self._follower.followed(view.left, R, shift)
        beginning: Initialization | str | None = None
        if motion is not None:
            beginning = initialize_over_ground(points, first, now, motion, self._camera)
        if beginning is None and np.degrees(shift) >= p.monocular.parallax_deg:
            beginning = initialize_from_two_views(
                points, first, now, driven, self._mount, p.monocular, self._camera
            )
        if isinstance(beginning, Initialization):
            self._begin_at(beginning, view, p)
            return None
        if beginning is not None:
            return beginning
        turned = float(np.linalg.norm(Pose(R, np.zeros(3)).rotvec))
        if len(points) < _LEAST_LEFT * self._started_with:
            # Too many points have left the view: make this view the new first one.
            self._T_camera_world = Pose(R, np.zeros(3)) @ self._T_camera_world
            self._begin_anew(view, p)
        if turned > _TURNED_RAD or self._T_camera_world.rotvec.any():
            return ONLY_TURNED
        return NOT_TRAVELLED

    def _begin_anew(self, view: View, p: Parameters) -> None:
        """Make this view the first one."""
        self._view, self._points = view, RayPoints.none()
        self._follower = None
        if not self._started and self._mount is not None:
            below = GroundPlane.below(self._mount)
            self._follower = GroundFollower(view.left, below, self._camera)
        self._renew_points(view, p)

    def _begin_at(self, beginning: Initialization, view: View, p: Parameters) -> None:
        T = self._T_camera_world = beginning.T_now_first @ self._T_camera_world
        self._scale = MapScale(beginning.scale_sigma, self._ground, T, view.odometry)
        if self._mount is not None:
            below = GroundPlane.below(self._mount)
            self._odometer = GroundOdometer(view.left, T, below, self._camera)
        self._follower = None
        self._points = beginning.points
        self._started = True
        self._renew_points(view, p)

    # ------------------------------------------------------------------ one frame

    def _pose(
        self, points: RayPoints, T_expected: Pose, prior: NDArray[np.float64], p: Parameters
    ) -> PoseEstimate:
        standing = ~points.moving & (points.obstacle == NO_OBSTACLE)
        if standing.sum() < len(points) / 2:
            # Too few are left: use all points, lest one obstacle be mistaken for the background.
            standing = np.ones(len(points), np.bool_)
        return estimate_pose(
            points,
            standing,
            density_weights(points.px, p.klt_tracking),
            T_expected,
            prior,
            self._ground,
            p.ego_motion.noise_correlation,
            self._camera,
        )

    def _ego_motion(
        self, points: RayPoints, estimate: PoseEstimate, p: Parameters
    ) -> RigidEgoMotion:
        support = int(estimate.inliers.sum())
        reasons: tuple[str, ...] = ()
        lost = support < p.ego_motion.min_inliers
        if lost:
            reasons = (
                f"only {support} of {len(points)} points agree on one motion, "
                f"{p.ego_motion.min_inliers} are needed",
            )
        elif points.known.sum() < _LEAST_KNOWN * len(points):
            reasons = (ONLY_TURNED if self._turns() else NOT_TRAVELLED,)
        T = None if lost else estimate.T_camera_world
        return RigidEgoMotion(
            camera=self._camera,
            status=Status.LOST if lost else Status.DEGRADED if reasons else Status.OK,
            reasons=reasons,
            inliers=estimate.inliers,
            T_camera_world=T,
            T_current_previous=None if T is None else T @ self._T_camera_world.inverse(),
            pose_covariance=None if lost else estimate.covariance,
            noise_scale=estimate.noise_scale,
        )

    def _turns(self) -> bool:
        return self._rate is not None and bool(np.linalg.norm(self._rate[0]) > _TURNING_RADPS)

    # ------------------------------------------------------------------ points

    def _anchor(self, view: View, p: Parameters) -> None:
        points = self._points
        turn = (np.arange(len(points)) + view.index) % _ANCHOR_TURNS == 0
        old = (points.anchor_s > p.monocular.memory_s) & turn
        self._points = anchored_anew(points, old, self._T_camera_world.inverse(), self._camera)

    def _renew_points(self, view: View, p: Parameters) -> None:
        """Keep one point per square of the image, and add one where there is none."""
        points = self._points
        moving = points.px[points.moving | (points.obstacle != NO_OBSTACLE)]
        size = (self._camera.width, self._camera.height)
        marked = attention(size, self._obstacles.boxes_px(), moving, p.klt_tracking)
        square = grid_cells(points.px, marked, p.klt_tracking)
        kept = one_per_cell(square, points.sightings)
        px = new_keypoints(view.left, square[kept], marked, p)
        T_world_camera = self._T_camera_world.inverse()
        ray = lines_of_sight(px, T_world_camera, self._camera)
        height, least = _SOME_HEIGHT_M, np.zeros(len(px))
        if self._ground is not None:
            height = self._ground.depth
            bound = self._ground.inverse_distance(T_world_camera.translation, ray)
            least = np.maximum(bound, 0.0)
        self._points = points.take(kept).joined(
            RayPoints.begin(
                px,
                T_world_camera.translation,
                ray,
                least + _FIRST_INVERSE / height,
                np.full(len(px), (_FIRST_SIGMA / height) ** 2),
            )
        )
        self._started_with = len(self._points)


def _mount_in_force(rig: CameraMount | None, p: Parameters) -> CameraMount | None:
    if p.monocular.height_m > 0:
        return CameraMount(p.monocular.height_m, float(np.radians(p.monocular.tilt_deg)))
    return rig


def _information(turn_sigma: float, distance_sigma: float) -> NDArray[np.float64]:
    return np.diag([turn_sigma**-2] * 3 + [distance_sigma**-2] * 3)


def _keep_background(
    trace: Trace, previous: View, before: RayPoints, points: RayPoints, found: NDArray[np.bool_]
) -> None:
    trace.keep("previous_time", previous.time)
    trace.keep("previous_left", previous.left)
    trace.keep("features_px", before.px)
    trace.keep("matches", Matches(before.px[found], points.px))
