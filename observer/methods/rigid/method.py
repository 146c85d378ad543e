"""Motion in space: points are followed in both cameras and judged by where they are in the world.

Between two frames the camera's own motion is the rigid one that keeps the static points where
they are; what does not stay there, although its neighbours move as it does, is a dynamic obstacle.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.contract import StageTimer, Step, StereoRows, View
from observer.methods.rigid.bodies.reporting import describe_body
from observer.methods.rigid.bodies.tracker import BodyTracker
from observer.methods.rigid.ego_motion import RigidEgoMotion, StaticScene, estimate_rigid_motion
from observer.methods.rigid.motion_test import group_dynamic, pooled_motion
from observer.methods.rigid.position_velocity_filter import MotionSums
from observer.methods.rigid.trace import keep_background, keep_motion
from observer.methods.rigid.tracked_points import NO_OBSTACLE, Points
from observer.parameters import Parameters
from observer.types import Obstacle, Trace
from observer.vision.camera_rate import CameraRate
from observer.vision.keypoint_choice import chosen_points
from observer.vision.keypoint_grid import attention, crowding, squares, thinned
from observer.vision.klt_tracking import Sightings, as_bright_as, follow, match_right
from observer.vision.lost_pose import while_lost
from observer.vision.motion_gate import ImageReach
from observer.vision.plausibility import PlausibleMotions
from observer.vision.sparse_stereo import coarse_disparity

# Disparities below this are as good as none; their points are taken to be this far away.
_LEAST_DISPARITY_PX = 0.25
# Noise and miscalibration may make the disparity of a far point negative by so much.
_MOST_NEGATIVE_PX = -2.0
# Pyramid levels while nothing is known of the camera's motion, and once it is.
_FIRST_LEVELS, _LEVELS = 4, 2
# Pixels: disparities further apart are of different things; the coarse one is good to about one.
_ANOTHER_DISPARITY_PX = 2.5
# The noise learnt from the background follows the newest frame by this share.
_NOISE_GAIN = 0.3
# The noise of points that are seen for the first time, before it can be told.
_FIRST_SIGMA_PX = 0.15
# Time step of the derivative by which a new point's flow is predicted, seconds.
_FLOW_STEP_S = 0.01


class RigidMethod:
    """Holds the followed points, the obstacles and the camera's pose of one segment.

    See ``observer.methods.contract.Method``.
    """

    def __init__(self, camera: StereoCamera, numbers: Iterator[int] | None = None) -> None:
        self._camera = camera
        self._tracker = BodyTracker(numbers)
        self._plausible = PlausibleMotions()
        self._points = Points.none()
        self._view: View | None = None
        self._T_camera_world = Pose.identity()
        self._rate: CameraRate | None = None
        self._noise = 1.0
        self._next_point = 0

    def begin(self, view: View, parameters: Parameters) -> None:
        """Forget everything; this view is the first of a new world."""
        self._tracker.clear()
        self._plausible.clear()
        self._points = Points.none()
        self._T_camera_world = Pose.identity()
        self._rate = None
        self._noise = 1.0
        self._view = view
        self._renew_points(view, parameters)

    def step(self, view: View, parameters: Parameters, timer: StageTimer, trace: Trace) -> Step:
        """Compare this view with the last one whose pose is known."""
        previous, before, p = self._view, self._points, parameters
        assert previous is not None
        dt = view.time - previous.time
        with timer("following"):
            T_expected = self._expected_pose(dt)
            expected_px, expected_disparity = self._expectation(T_expected, dt, p)
            seen = self._follow(previous, view, expected_px, expected_disparity, p)
            points, sigma = self._sighted(seen, expected_disparity, view, dt, p)
        with timer("ego_motion"):
            ego = self._ego_motion(points, sigma, T_expected, view, dt, p)
        rows = _rows(points)
        share = float(np.isfinite(points.disparity).mean()) if len(points) else 0.0
        keep_background(trace, previous, before, points, seen, ego)
        trace.keep("rows", rows)
        if ego.T_camera_world is None or ego.T_current_previous is None:
            return Step(ego, None, self._unseen(view.time, p), share, rows)
        T_camera_world, step_cov = ego.T_camera_world, ego.pose_covariance
        assert step_cov is not None
        with timer("motion"):
            T_world_camera = T_camera_world.inverse()
            sighting, information = self._measured(points, sigma, ego, T_world_camera, p)
            sums = points.sums.advanced(dt, p.evidence.memory_s)
            points = points.but(sums=sums.with_sightings(sighting, information))
            rate = CameraRate.of(ego.T_current_previous, dt)
            motion = pooled_motion(
                points, T_camera_world, step_cov, dt, self._camera, p.evidence, rate
            )
            points = points.but(dynamic=motion.dynamic, velocity=motion.own_velocity)
        with timer("tracking"):
            tracker, camera_position = self._tracker, T_world_camera.translation
            tracker.predict(dt, camera_position, self._camera, p.obstacles)
            points = tracker.update(
                points, sighting, information, T_camera_world, step_cov, dt, p.obstacles
            )
            bias_px, stretch = p.evidence.disparity_bias_px, p.evidence.stretch
            tracker.look_from(T_camera_world, rate, self._camera, bias_px, stretch)
            points = tracker.adopt(points, motion, p.obstacles)
            free = (points.obstacle == NO_OBSTACLE) & (points.tenure >= 0)
            groups = group_dynamic(motion, free, p.obstacles.min_points)
            near = self._neighbourhood(camera_position, p)
            points = tracker.found(points, groups, motion, near, p.obstacles)
            points = tracker.live(points, camera_position, near, dt, p.obstacles)
        keep_motion(trace, before, points, seen, ego, motion)
        self._T_camera_world, self._points, self._view = T_camera_world, points, view
        self._rate = rate
        with timer("features"):
            self._renew_points(view, p)
        obstacles = tuple(
            describe_body(track, T_world_camera, -rate.shift, view.time) for track in tracker.tracks
        )
        return Step(ego, T_world_camera, obstacles, share, rows)

    def _unseen(self, time: float, p: Parameters) -> tuple[Obstacle, ...]:
        """The obstacles at a frame without a pose, seconds on the source's clock."""
        assert self._view is not None
        before, T_world_camera = self._view.time, self._T_camera_world.inverse()
        last = [
            (describe_body(track, T_world_camera, np.zeros(3), before), track.missed_s)
            for track in self._tracker.tracks
        ]
        return while_lost(last, time - before, p.obstacles.coast_s)

    def _expected_pose(self, dt: float) -> Pose:
        if self._rate is None:
            return self._T_camera_world
        return self._rate.over(dt) @ self._T_camera_world

    def _expectation(
        self, T_expected: Pose, dt: float, p: Parameters
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Where each point should be seen (N, 2), and its disparity (N,)."""
        points = self._points
        place, _ = points.sums.static_position()
        body = self._tracker.expected_at(points, place, dt, p.obstacles)
        place = np.where(np.isfinite(body), body, place)
        px, disparity = self._camera.project(T_expected.apply(place))
        unknown = ~np.isfinite(px).all(axis=1)
        px[unknown] = points.px[unknown]
        disparity = np.where(np.isfinite(points.disparity), disparity, np.nan)
        return px.astype(np.float32), disparity.astype(np.float32)

    def _follow(
        self,
        previous: View,
        view: View,
        expected_px: NDArray[np.float32],
        expected_disparity: NDArray[np.float32],
        p: Parameters,
    ) -> Sightings:
        before = (
            as_bright_as(view.left, previous.left),
            as_bright_as(view.right, previous.right),
        )
        levels = _FIRST_LEVELS if self._rate is None else _LEVELS
        return follow(
            before, (view.left, view.right), self._points.px, self._points.right_px,
            expected_px, expected_disparity, levels, p.following,
        )  # fmt: skip

    def _sighted(
        self,
        seen: Sightings,
        expected_disparity: NDArray[np.float32],
        view: View,
        dt: float,
        p: Parameters,
    ) -> tuple[Points, Float64Array]:
        """The points that were found, with their noise (N, 3) in u, v and disparity, pixels."""
        found = seen.found
        points = self._points.take(found)
        px, right_px = seen.px[found], seen.right_px[found]
        flow = (px - points.px).astype(np.float64) / dt
        disparity = (px[:, 0] - right_px[:, 0]).astype(np.float64)
        growth = np.abs(expected_disparity[found] / points.disparity - 1)
        warp = p.following.growth_noise * p.following.window_px / 2 * np.nan_to_num(growth)
        sigma = np.empty((len(px), 3))
        sigma[:, :2] = np.hypot(seen.sigma[found, :1], warp[:, None])
        variance = seen.sigma[found, 1].astype(np.float64) ** 2
        if view.right_time is not None:
            # What moves in the image has moved on when the right camera exposes.
            disparity = disparity + flow[:, 0] * (view.right_time - view.time)
            variance = variance + (flow[:, 0] * p.following.skew_sigma_s) ** 2
        sigma[:, 2] = np.sqrt(variance)
        far = np.maximum(disparity, _LEAST_DISPARITY_PX)
        points = points.but(
            px=px,
            right_px=right_px,
            flow=flow,
            disparity=np.where(disparity > _MOST_NEGATIVE_PX, far, np.nan),
            sightings=points.sightings + 1,
            age=points.age + dt,
        )
        return points, sigma

    def _ego_motion(
        self,
        points: Points,
        sigma: Float64Array,
        T_expected: Pose,
        view: View,
        dt: float,
        p: Parameters,
    ) -> RigidEgoMotion:
        """The camera's motion by all points that are not known to move, unless impossible."""
        place, place_cov = points.sums.static_position()
        chosen = np.flatnonzero(~self._tracker.known(points))
        if len(chosen) < len(points) / 2:
            # Rather too many obstacles among the background than an obstacle taken for it.
            chosen = np.arange(len(points))
        px = points.px[chosen]
        scene = StaticScene(
            place.take(chosen, axis=0), place_cov.take(chosen, axis=0), px.astype(np.float64),
            points.disparity[chosen], sigma.take(chosen, axis=0), crowding(px, p.following),
        )  # fmt: skip
        ego = estimate_rigid_motion(
            scene, self._T_camera_world, T_expected, self._camera, p.ego_motion, view.index
        )
        inliers = np.zeros(len(points), np.bool_)
        inliers[chosen] = ego.inliers
        ego = replace(ego, inliers=inliers)
        if ego.T_current_previous is None:
            return ego
        reach = None
        if self._rate is not None:
            follows = p.following.window_px / 2 * 2**_LEVELS
            reach = ImageReach.of(self._camera, points.disparity, follows)
        reason = self._plausible.refusal(
            view.time, dt, ego.T_current_previous, ego.pose_covariance, reach
        )
        return ego if reason is None else ego.refused(reason)

    def _measured(
        self,
        points: Points,
        sigma: Float64Array,
        ego: RigidEgoMotion,
        T_world_camera: Pose,
        p: Parameters,
    ) -> tuple[Float64Array, Float64Array]:
        """Where points are now (N, 3), world, and the information (N, 3, 3) of each sighting."""
        self._noise += _NOISE_GAIN * (max(ego.noise_scale, p.evidence.least_noise) - self._noise)
        place = self._camera.triangulate(points.px, points.disparity)
        # The information depends on the depth; the noise of this very sighting must not decide it.
        steady = T_world_camera.inverse().apply(points.sums.moving_position(points.velocity)[0])
        use = np.isfinite(steady).all(axis=1) & (steady[:, 2] > 0)
        at = np.where(use[:, None], steady, place)
        information = _information(at, sigma * self._noise, T_world_camera, self._camera)
        known = np.asarray(np.isfinite(place).all(axis=1))
        known &= np.isfinite(information).reshape(-1, 9).all(axis=1)
        information = np.where(known[:, None, None], information, 0.0)
        return np.where(known[:, None], T_world_camera.apply(place), np.nan), information

    def _renew_points(self, view: View, p: Parameters) -> None:
        """Leave one point in each square of the image, and find one where there is none."""
        points = self._points.remembered()
        moving = points.dynamic | (points.obstacle != NO_OBSTACLE)
        boxes = self._tracker.boxes_px(self._T_camera_world, self._camera)
        size = (self._camera.width, self._camera.height)
        marked = attention(size, boxes, points.px[moving], p.following)
        square = squares(points.px, marked, p.following)
        kept = thinned(square, points.sightings)
        self._points = points.take(kept)
        turn = None if self._rate is None else view.index
        px = chosen_points(view.left, square[kept], marked, p, turn)
        if len(px) == 0:
            return
        coarse = self._searched(view, px, p)
        right, _ = match_right((view.left, view.right), px, coarse, p.following)
        disparity = (px[:, 0] - right[:, 0]).astype(np.float64)
        known = np.asarray(disparity > _MOST_NEGATIVE_PX)
        px, right = px[known], right[known]
        disparity = np.maximum(disparity[known], _LEAST_DISPARITY_PX)
        if view.right_time is not None:
            shift = self._static_flow(px, disparity) * (view.right_time - view.time)
            disparity = np.maximum(disparity + shift, _LEAST_DISPARITY_PX)
        T_world_camera = self._T_camera_world.inverse()
        place = self._camera.triangulate(px, disparity)
        sigma = np.full((len(px), 3), _FIRST_SIGMA_PX)
        information = _information(place, sigma, T_world_camera, self._camera)
        sums = MotionSums.begin(T_world_camera.apply(place), information)
        self._points = self._points.joined(
            Points.begin(self._next_point, px, right, disparity, sums)
        )
        self._next_point += len(px)

    def _searched(self, view: View, px: NDArray[np.float32], p: Parameters) -> NDArray[np.float32]:
        """Coarse disparity (N,) of new points (N, 2); in passing, followed ones are checked.

        Beside an edge in depth a point may be given the disparity of what is beyond the edge, and
        keep it, for left and right look alike there. Once it is about to be judged, its
        surroundings have moved on, and the whole row is searched again.
        """
        points = self._points
        due = np.flatnonzero(points.sightings == p.evidence.min_sightings)
        coarse = coarse_disparity(
            view.left, view.right, np.concatenate([points.px[due], px]), p.stereo
        )
        own = points.px[due, 0] - points.right_px[due, 0]
        wrong = np.abs(coarse[: len(due)] - own) > _ANOTHER_DISPARITY_PX
        if wrong.any():
            self._points = points.take(np.delete(np.arange(len(points)), due[wrong]))
        return coarse[len(due) :]

    def _static_flow(self, px: NDArray[np.float32], disparity: Float64Array) -> Float64Array:
        """(N,) px/s along the rows of new points, if they are static."""
        if self._rate is None:
            return np.zeros(len(px))
        back = self._rate.over(-_FLOW_STEP_S)
        earlier, _ = self._camera.project(back.apply(self._camera.triangulate(px, disparity)))
        return np.nan_to_num((px[:, 0] - earlier[:, 0]) / _FLOW_STEP_S)

    def _neighbourhood(
        self, camera_position: Float64Array, p: Parameters
    ) -> Callable[[Float64Array], float]:
        """Metres that ``evidence.radius_px`` means at a place (3,), world."""
        scale = p.evidence.radius_px / self._camera.fx

        def radius_m(place: Float64Array) -> float:
            return scale * float(np.linalg.norm(place - camera_position))

        return radius_m


def _information(
    place: Float64Array, sigma: Float64Array, T_world_camera: Pose, camera: StereoCamera
) -> Float64Array:
    """(N, 3, 3) 1/m^2, world axes, of points (N, 3), camera frame, seen with sigma (N, 3) px."""
    J = camera.projection_jacobian(place) / sigma[..., None]
    R = T_world_camera.rotation
    return np.asarray(R @ (np.swapaxes(J, 1, 2) @ J) @ R.T, dtype=np.float64)


def _rows(points: Points) -> StereoRows:
    offset = np.asarray(points.px[:, 1] - points.right_px[:, 1], dtype=np.float64)
    return StereoRows(points.px.astype(np.float64), offset, points.disparity, points.number)
