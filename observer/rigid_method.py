"""Motion in space: points are followed in both cameras and judged by where they are in the world.

Between two frames the camera's own motion is the rigid one that keeps the static points where
they are; what does not stay there although its neighbours move as it does is a dynamic obstacle.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.motion_sums import MotionSums
from observer.parameters import Parameters
from observer.points import NO_OBSTACLE, Points
from observer.stages.evidence import Motion, group_dynamic, pooled_motion
from observer.stages.following import Sightings, as_bright_as, follow, match_right
from observer.stages.obstacle_tracking import BodyTrack, BodyTracker
from observer.stages.rigid_ego_motion import RigidEgoMotion, StaticScene, estimate_rigid_motion
from observer.stages.selection import attention, crowding, new_points, squares, thinned
from observer.stages.sparse_stereo import coarse_disparity
from observer.types import Image

Timer = Callable[[str], AbstractContextManager[None]]

_LEAST_DISPARITY_PX = 0.25
_NOISE_GAIN = 0.3
_FIRST_LEVELS, _LEVELS = 4, 2


@dataclass(frozen=True, eq=False)
class View:
    time: float
    left: Image
    right: Image
    right_time: float | None


class RigidMethod:
    """Holds the followed points, the obstacles' tracks and the camera's pose of one segment."""

    def __init__(self, camera: StereoCamera) -> None:
        self.camera = camera
        self.tracker = BodyTracker()
        self.clear()

    def clear(self) -> None:
        self.points = Points.none()
        self.view: View | None = None
        self.T_camera_world = Pose.identity()
        self._turn = np.zeros(3)
        self._speed = np.zeros(3)
        self._moving = False
        self._noise = 1.0
        self._next = 0
        self.tracker.clear()

    def begin(self, view: View, p: Parameters) -> None:
        self.view = view
        self.T_camera_world = Pose.identity()
        self._add_points(view, p)

    def step(self, view: View, p: Parameters, seed: int, timer: Timer) -> tuple[RigidEgoMotion, Motion | None]:
        previous = self.view
        assert previous is not None
        dt = view.time - previous.time
        camera = self.camera
        T_expected = self._expected_pose(dt)
        with timer("following"):
            expected_px, expected_disparity = self._expectation(T_expected, dt, p)
            before = (as_bright_as(view.left, previous.left), as_bright_as(view.right, previous.right))
            levels = _LEVELS if self._moving else _FIRST_LEVELS
            seen = follow(before, (view.left, view.right), self.points.px, self.points.right_px,
                          expected_px, expected_disparity, levels, p.following)
        lost = self.points.take(~seen.found)
        points, disparity, sigma = self._sighted(seen, expected_disparity, view, dt, p)
        with timer("ego_motion"):
            place, place_cov = points.sums.static_position()
            index = np.flatnonzero(~self.tracker.known(points))
            if len(index) < len(points) / 2:
                index = np.arange(len(points))
            scene = StaticScene(place[index], place_cov[index], points.px[index].astype(np.float64),
                                disparity[index], sigma[index], crowding(points.px[index], p.following))
            ego = estimate_rigid_motion(scene, self.T_camera_world, T_expected, camera, p.ego_motion, seed)
        if ego.T_camera_world is None:
            return ego, None
        T_world = ego.T_camera_world.inverse()
        step_cov = ego.pose_covariance
        self._turn = ego.T_current_previous.rotvec / dt
        self._speed = ego.T_current_previous.translation / dt
        self._moving = True
        self.T_camera_world = ego.T_camera_world
        with timer("motion"):
            self._noise += _NOISE_GAIN * (max(ego.noise_scale, p.evidence.least_noise) - self._noise)
            sighting, information = self._measured(points, disparity, sigma * self._noise, T_world)
            sums = points.sums.advanced(dt, p.evidence.memory_s).with_sightings(sighting, information)
            points = points.but(sums=sums, disparity=disparity)
            motion = pooled_motion(points, ego.T_camera_world, step_cov, dt, camera, p.evidence)
            points = points.but(dynamic=motion.dynamic)
        with timer("tracking"):
            self.tracker.predict(dt, T_world.translation, camera, p.obstacles)
            points = self.tracker.update(points, sighting, information, ego.T_camera_world, step_cov, dt, p.obstacles)
            points = self.tracker.adopt(points, motion, p.obstacles)
            groups = group_dynamic(motion, points.obstacle == NO_OBSTACLE, p.obstacles.min_points)
            points = self.tracker.found(points, groups, motion, T_world.translation, camera, p.obstacles)
            radius_m = lambda place: p.evidence.radius_px / camera.fx * float(np.linalg.norm(place - T_world.translation))  # noqa: E731
            points = self.tracker.live(points, lost, dt, T_world.translation, radius_m, p.obstacles)
        self.points = points
        self.view = view
        with timer("features"):
            self._add_points(view, p)
        return ego, motion

    def _expected_pose(self, dt: float) -> Pose:
        return Pose.from_rotvec(self._turn * dt, self._speed * dt) @ self.T_camera_world

    def _expectation(self, T_expected: Pose, dt: float, p: Parameters) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        points = self.points
        place, _ = points.sums.static_position()
        body = self.tracker.expected_at(points, place, dt, p.obstacles)
        place = np.where(np.isfinite(body), body, place)
        px, disparity = self.camera.project(T_expected.apply(place))
        unknown = ~np.isfinite(px).all(axis=1)
        px[unknown] = points.px[unknown]
        disparity = np.where(np.isfinite(points.disparity), disparity, np.nan)
        return px.astype(np.float32), disparity.astype(np.float32)

    def _sighted(self, seen: Sightings, expected_disparity: NDArray[np.float32], view: View, dt: float, p: Parameters):
        found = seen.found
        points = self.points.take(found)
        px, right_px = seen.px[found], seen.right_px[found]
        flow = (px - points.px).astype(np.float64) / dt
        disparity = (px[:, 0] - right_px[:, 0]).astype(np.float64)
        sigma = np.empty((len(px), 3))
        growth = np.abs(expected_disparity[found] / self.points.disparity[found] - 1)
        warp = p.following.growth_noise * p.following.window_px / 2 * np.nan_to_num(growth)
        sigma[:, :2] = np.hypot(seen.sigma[found, :1], warp[:, None])
        variance = seen.sigma[found, 1].astype(np.float64) ** 2
        if view.right_time is not None:
            skew = view.right_time - view.time
            disparity = disparity + flow[:, 0] * skew
            variance += (flow[:, 0] * p.following.skew_sigma_s) ** 2
        sigma[:, 2] = np.sqrt(variance)
        disparity = np.where(disparity > -2.0, np.maximum(disparity, _LEAST_DISPARITY_PX), np.nan)
        points = points.but(px=px, right_px=right_px, flow=flow, disparity=disparity,
                            sightings=points.sightings + 1, age=points.age + dt)
        return points, disparity, sigma

    def _measured(self, points: Points, disparity: Float64Array, sigma: Float64Array, T_world: Pose):
        """Where points are in the world now, with the information of each sighting."""
        place = self.camera.triangulate(points.px, disparity)
        # The information depends on the depth; the noise of this very sighting must not decide it.
        steady = T_world.inverse().apply(self._place_now(points))
        use = np.isfinite(steady).all(axis=1) & (steady[:, 2] > 0)
        at = np.where(use[:, None], steady, place)
        J = self.camera.projection_jacobian(at) / sigma[..., None]
        information = np.swapaxes(J, 1, 2) @ J
        R = T_world.rotation
        information = R @ information @ R.T
        known = np.isfinite(place).all(axis=1) & np.isfinite(information).all(axis=(1, 2))
        information = np.where(known[:, None, None], information, 0.0)
        return np.where(known[:, None], T_world.apply(place), np.nan), information

    def _place_now(self, points: Points) -> Float64Array:
        information, vector = points.sums.velocity_information()
        known = (points.sightings >= 4) & (np.linalg.det(information) > 0)
        cov = np.linalg.inv(np.where(known[:, None, None], information, np.eye(3)))
        v = np.einsum("nij,nj->ni", cov, vector) * known[:, None]
        return points.sums.moving_position(v)[0]

    def _add_points(self, view: View, p: Parameters) -> None:
        size = (self.camera.width, self.camera.height)
        moving = self.points.dynamic | (self.points.obstacle != NO_OBSTACLE)
        boxes = self.tracker.boxes_px(self.T_camera_world, self.camera)
        marked = attention(size, boxes, self.points.px[moving], p.following)
        square = squares(self.points.px, marked, p.following)
        kept = thinned(square, self.points.sightings)
        self.points, square = self.points.take(kept), square[kept]
        px = new_points(view.left, square, marked, p.following)
        if len(px) == 0:
            return
        coarse = coarse_disparity(view.left, view.right, px, p.stereo)
        right, _ = match_right((view.left, view.right), px, coarse, p.following)
        disparity = (px[:, 0] - right[:, 0]).astype(np.float64)
        known = np.isfinite(disparity) & (disparity > -2.0)
        px, right = px[known], right[known]
        disparity = np.maximum(disparity[known], _LEAST_DISPARITY_PX)
        if view.right_time is not None and self._moving:
            place = self.camera.triangulate(px, disparity)
            back = Pose.from_rotvec(-self._turn * 0.01, -self._speed * 0.01)
            earlier, _ = self.camera.project(back.apply(place))
            rate = (px[:, 0] - earlier[:, 0]) / 0.01
            disparity = np.maximum(disparity + np.nan_to_num(rate) * (view.right_time - view.time), _LEAST_DISPARITY_PX)
        T_world = self.T_camera_world.inverse()
        place = T_world.apply(self.camera.triangulate(px, disparity))
        sigma = np.full(3, 0.15)
        J = self.camera.projection_jacobian(self.camera.triangulate(px, disparity)) / sigma[:, None]
        information = T_world.rotation @ (np.swapaxes(J, 1, 2) @ J) @ T_world.rotation.T
        new = Points.begin(self._next, px, right, disparity, MotionSums.begin(place, information))
        self._next += len(px)
        self.points = self.points.joined(new)
