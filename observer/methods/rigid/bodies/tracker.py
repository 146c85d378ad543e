"""Obstacles as bodies: each is predicted, measured by its points, found, judged and ended."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.expectation import note_lasting_errors, predict
from observer.methods.rigid.bodies.filter import (
    POSITION,
    VELOCITY,
    yaw_matrix,
)
from observer.methods.rigid.bodies.identity import are_one
from observer.methods.rigid.bodies.lifecycle import is_over, judge, moves_apart
from observer.methods.rigid.bodies.limbs import judge_scatter
from observer.methods.rigid.bodies.measurement import Members, expected_pose, measure_body
from observer.methods.rigid.bodies.membership import joining, placed, resting, shape_position
from observer.methods.rigid.bodies.moving_in_place import MovingInPlace
from observer.methods.rigid.bodies.occlusion import without_hidden
from observer.methods.rigid.bodies.segment_tracking import (
    learn_box,
    measure_limbs,
    shown_by_points,
    track_segments,
    without_segments,
)
from observer.methods.rigid.bodies.spawning import spawned
from observer.methods.rigid.bodies.static_among import note_static_points
from observer.methods.rigid.bodies.wrong_match import note_wrong_matches
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.grey_change import Light
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.stereo_drift import shift_by_bias
from observer.methods.rigid.tracked_points import BANISHED_FRAMES, TrackedPoints, WorldSightings
from observer.parameters import ObstacleParameters, Parameters
from observer.robust import median
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds, is_provisional

# Seconds, time constant with which old places of points on a body are forgotten: tracked patches
# slide.
_SHAPE_MEMORY_S = 2.0
# A member must have been seen this often before its place may permanently enlarge the box.
_SETTLED = 6
# Seconds after a manoeuvre for which the members' own velocities may still be those before it.
_STEADY_S = 0.3
# Metres around the box of a body within which new points on it may seem to be.
_AROUND_BOX_M = 0.1


class BodyTracker:
    """Keeps the obstacles' tracks; points carry the number of the obstacle they belong to.

    Attributes:
        ground: as of the last frame in which it is known; None before.
    """

    def __init__(self, numbers: TrackIds | None = None) -> None:
        """``numbers`` gives each track its own; new ones if left out."""
        self.tracks: list[BodyTrack] = []
        self._numbers = numbers or TrackIds()
        self._moving_in_place = MovingInPlace()
        self.ground: GroundPlane | None = None
        # As of the last frame in which it is known.
        self._light = Light()

    def step(
        self,
        points: TrackedPoints,
        sightings: WorldSightings,
        motion: PooledMotion,
        scene: DenseScene | None,
        now: CameraStep,
        parameters: Parameters,
    ) -> TrackedPoints:
        """Carry all bodies over one frame; returns the points with the bodies they belong to.

        Args:
            sightings: of the points in this frame. motion: how they move. scene: what is seen
                around them; None if unknown.
        """
        p = parameters.obstacles
        predict(self.tracks, now, p)
        if scene is not None:
            points = without_hidden(self.tracks, points, scene, now)
        points = self.measure(points, sightings, now, p)
        if scene is None:
            points = without_segments(self.tracks, points, now)
        else:
            points = track_segments(self.tracks, points, scene, now, self._numbers, p.min_points)
            points = measure_limbs(self.tracks, points, sightings, motion, scene, now.dt)
            points = self._moving_in_place.note(self.tracks, points, scene, self._numbers)
            self._light, self.ground = scene.light, scene.ground
        points = judge_scatter(self.tracks, points, motion)
        note_lasting_errors(self.tracks, now, parameters.evidence)
        lying = self._lying(points, now)
        points = self.associate(points, motion, lying, p)
        reach = partial(now.metres_of, parameters.evidence.radius_px)
        points = self.spawn(points, motion, lying, reach, p)
        # Bodies that were found just now are no more certain than others.
        found = [track for track in self.tracks if track.frames == 0]
        note_lasting_errors(found, now, parameters.evidence)
        if scene is not None:
            note_wrong_matches(self.tracks, points, scene, now)
        note_static_points(self.tracks, points, motion)
        self._note_growth(points, now)
        points = self.update_lifecycle(points, now.position, reach, now.dt, p)
        for track in self.tracks:
            track.carry_box(now.T_camera_world, now.camera)
        return points

    def correct_disparities(self, bias_px: float, now: CameraStep) -> None:
        """Move all bodies as if all disparities had been larger by a bias, pixels."""
        for mean, track in [(track.mean[None], track) for track in self.tracks]:
            shift, drift, _ = shift_by_bias(mean[:, POSITION], mean[:, VELOCITY], bias_px, now)
            track.filter = track.filter.shifted(shift[0], drift[0])

    def known(self, points: TrackedPoints) -> NDArray[np.bool_]:
        """(N,) which points belong to obstacles that were confirmed, or are seen on them."""
        return self._on(points, [t for t in self.tracks if t.state is not TrackState.TENTATIVE])

    def seen_apart(self, points: TrackedPoints) -> NDArray[np.bool_]:
        """(N,) which points belong to known bodies that move before their surroundings."""
        return self._on(points, [track for track in self.tracks if moves_apart(track)])

    def _on(self, points: TrackedPoints, tracks: list[BodyTrack]) -> NDArray[np.bool_]:
        """(N,) which points belong to some of the tracks, or are seen on them.

        Points in the box of a body that moves before its surroundings are new ones on it. Where
        the background is far away, a few of them make a wrong motion of the camera the likeliest.
        """
        ids = np.array([track.id for track in tracks])
        on = (points.obstacle[:, None] == ids).any(axis=1)
        on |= (points.within[:, None] == ids).any(axis=1)
        place, _ = points.sums.static_position()
        for track in [t for t in tracks if moves_apart(t) and t.motion is MotionState.MOVING]:
            on |= track.contains(place, _AROUND_BOX_M)
        return np.asarray(on)

    def boxes_px(self, T_camera_world: Pose, camera: StereoCamera) -> Float64Array:
        """(B, 4) u0 v0 u1 v1 around the obstacles' boxes in the left image."""
        found = []
        for track in self.tracks:
            if track.box is None:
                continue
            px, _ = camera.project(T_camera_world.apply(track.corners()))
            if np.isfinite(px).all():
                found.append([*px.min(axis=0), *px.max(axis=0)])
        return np.array(found).reshape(-1, 4)

    def measure(
        self,
        points: TrackedPoints,
        sightings: WorldSightings,
        now: CameraStep,
        parameters: ObstacleParameters,
    ) -> TrackedPoints:
        """Move every body to where its members are seen; members that do not fit leave."""
        sighting, information, dt = sightings.position, sightings.information, now.dt
        obstacle = points.obstacle.copy()
        tenure = np.where(
            obstacle == NO_OBSTACLE, np.minimum(points.tenure + 1, 0), points.tenure + 1
        )
        shape_information = points.shape_information * np.exp(-dt / _SHAPE_MEMORY_S)
        shape_vector = points.shape_vector * np.exp(-dt / _SHAPE_MEMORY_S)
        for track in self.tracks:
            mine = np.flatnonzero((obstacle == track.id) & np.isfinite(sighting[:, 0]))
            members = Members.of(points, mine, sighting, information, track.R)
            pose, spread = expected_pose(track.mean, track.filter.covariance)
            if track.rigid and np.count_nonzero(members.known) >= parameters.min_points:
                track.by_points = True
                seen = measure_body(
                    members,
                    pose,
                    spread,
                    now.T_camera_world,
                    now.covariance,
                    parameters.noise_correlation,
                )
                track.filter = track.filter.updated(seen.pose, seen.covariance)
                if track.filter.manoeuvres:
                    track.steady_s = 0.0
                track.recent.note(track.age_s, track.mean[VELOCITY], track.yaw_rate)
                pose, _ = expected_pose(track.mean, track.filter.covariance)
                obstacle[mine[seen.misfits]] = NO_OBSTACLE
                tenure[mine[seen.misfits]] = -BANISHED_FRAMES
                mine = mine[~seen.misfits]
            R = yaw_matrix(float(pose[3]))
            local = R.T @ information[mine] @ R
            shape_information[mine] += local
            at = (sighting[mine] - pose[:3]) @ R
            shape_vector[mine] += np.einsum("nij,nj->ni", local, at)
            _note_seen(track, points.px[mine], dt, parameters)
        return points.but(
            obstacle=obstacle,
            tenure=tenure,
            shape_information=shape_information,
            shape_vector=shape_vector,
        )

    def _lying(self, points: TrackedPoints, now: CameraStep) -> NDArray[np.bool_]:
        """(N,) which points lie on the ground or are mirrored by it; none if it is unknown."""
        if self.ground is None:
            return np.zeros(len(points), np.bool_)
        return self.ground.carries(points.px, points.disparity, now.T_camera_world, now.camera)

    def associate(
        self,
        points: TrackedPoints,
        motion: PooledMotion,
        lying: NDArray[np.bool_],
        parameters: ObstacleParameters,
    ) -> TrackedPoints:
        """Let points on a body that move with it join it, and members that rest leave it.

        Args:
            lying: (N,) which points lie on the ground. They join no body that is mostly there.
        """
        obstacle, tenure = points.obstacle.copy(), points.tenure.copy()
        for track in self.tracks:
            mine = np.flatnonzero(obstacle == track.id)
            if track.steady_s >= _STEADY_S:
                left = mine[resting(track, mine, motion)]
                obstacle[left], tenure[left] = NO_OBSTACLE, -BANISHED_FRAMES
            here = (points.within == NO_OBSTACLE) | (points.within == track.id)
            here &= (obstacle == NO_OBSTACLE) & motion.judged & (tenure >= 0)
            if track.lies:
                here &= ~lying
            free = np.flatnonzero(here)
            if track.box is None or not track.rigid or len(free) == 0:
                continue
            obstacle[free[joining(track, free, motion, parameters)]] = track.id
        return self._placed(points.but(tenure=tenure), obstacle)

    def spawn(
        self,
        points: TrackedPoints,
        motion: PooledMotion,
        lying: NDArray[np.bool_],
        radius_m: Callable[[Float64Array], float],
        parameters: ObstacleParameters,
    ) -> TrackedPoints:
        """Turn groups of dynamic points into obstacles, see ``spawned``."""
        obstacle = spawned(self.tracks, self._numbers, points, motion, lying, radius_m, parameters)
        return self._placed(points, obstacle)

    def _note_growth(self, points: TrackedPoints, now: CameraStep) -> None:
        """Note how the images of tentative tracks grow, by the flow of their points."""
        known = np.isfinite(points.disparity) & np.isfinite(points.flow).all(axis=1)
        for track in [t for t in self.tracks if t.state is TrackState.TENTATIVE]:
            mine = np.flatnonzero(known & (points.obstacle == track.id))
            if len(mine) > 0:
                px, disparity = points.px[mine].astype(np.float64), points.disparity[mine]
                track.growth = track.growth.seen(px, points.flow[mine], median(disparity), now)

    def update_lifecycle(
        self,
        points: TrackedPoints,
        camera_position: Float64Array,
        radius_m: Callable[[Float64Array], float],
        dt: float,
        parameters: ObstacleParameters,
    ) -> TrackedPoints:
        """Learn boxes, decide on each track's state, merge and end tracks.

        Args:
            camera_position: (3,) metres, world.
            radius_m: metres within which points count as neighbours at a place (3,) m, world.
        """
        shape_vector = points.shape_vector.copy()
        for track in self.tracks:
            mine = np.flatnonzero((points.obstacle == track.id) & np.isfinite(points.disparity))
            places = shape_position(points, mine)
            known = np.isfinite(places).all(axis=1)
            if not shown_by_points(track):
                learn_box(track)
            elif np.count_nonzero(known) >= parameters.min_points:
                tenure = points.tenure[mine[known]]
                self._learn(track, places[known], tenure, camera_position, dt, parameters)
                # With the origin at the centre, turning and driving are least coupled.
                offset = track.rebase()
                every = points.obstacle == track.id
                shape_vector[every] -= points.shape_information[every] @ offset
            judge(track, camera_position, dt, parameters, light=self._light)
        points = self._named(points.but(shape_vector=shape_vector))
        obstacle = points.obstacle.copy()
        for track in [t for t in self.tracks if is_over(t, parameters)]:
            obstacle[obstacle == track.id] = NO_OBSTACLE
            self.tracks.remove(track)
        for older, younger in self._same(radius_m, parameters):
            # Where a person is out of sight, what moves are shadows and edges, not the person.
            hidden = not older.rigid and older.outline is not None and older.seen_outline is None
            obstacle[obstacle == younger.id] = NO_OBSTACLE if hidden else older.id
            self.tracks.remove(younger)
            if is_provisional(older.id) and not is_provisional(younger.id):
                # A body that was reported keeps its number.
                obstacle[obstacle == older.id] = younger.id
                older.id, older.state = younger.id, younger.state
        return self._placed(points, obstacle)

    def _named(self, points: TrackedPoints) -> TrackedPoints:
        """Give tracks that have been confirmed, and their points, a lasting number."""
        obstacle, within = points.obstacle.copy(), points.within.copy()
        for track in self.tracks:
            if track.state is not TrackState.TENTATIVE:
                number = self._numbers.confirmed(track.id)
                obstacle[obstacle == track.id] = number
                within[within == track.id] = number
                track.id = number
        return points.but(obstacle=obstacle, within=within)

    def _learn(
        self,
        track: BodyTrack,
        places: Float64Array,
        tenure: NDArray[np.int64],
        camera_position: Float64Array,
        dt: float,
        parameters: ObstacleParameters,
    ) -> None:
        """Learn the heading, and the box from the members' places (K, 3) m, body's frame.

        Args:
            tenure: (K,) frames for which each has been a member.
        """
        cov = track.filter.covariance[VELOCITY, VELOCITY]
        track.shape.note_heading(track.mean[VELOCITY], cov, track.yaw)
        settled = tenure >= _SETTLED
        if track.box is not None:
            # A stranger may not stretch the box by much.
            settled &= track.box.contains(places, track.room(parameters.margin))
        track.shape.note(places[settled])
        older = places[tenure >= min(_SETTLED // 2, track.frames)]
        view = track.R.T @ (track.mean[POSITION] - camera_position)
        seen = older if len(older) >= parameters.min_points else places
        track.box = track.shape.box(seen, view, dt)

    def _placed(self, points: TrackedPoints, obstacle: NDArray[np.int64]) -> TrackedPoints:
        """Give points that have just joined a body their place on it."""
        if np.array_equal(obstacle, points.obstacle):
            return points
        information, vector = points.shape_information.copy(), points.shape_vector.copy()
        for track in self.tracks:
            new = np.flatnonzero((obstacle == track.id) & (points.obstacle != track.id))
            if len(new) == 0:
                continue
            sums = points.sums.take(new)
            place, known = placed(track, sums)
            information[new] = track.R.T @ known @ track.R
            at = track.local(place)
            vector[new] = np.einsum("nij,nj->ni", information[new], at)
        return points.but(obstacle=obstacle, shape_information=information, shape_vector=vector)

    def _same(
        self, radius_m: Callable[[Float64Array], float], parameters: ObstacleParameters
    ) -> list[tuple[BodyTrack, BodyTrack]]:
        """List pairs of tracks that are one body, the older first; none is the younger twice."""
        pairs = []
        taken: set[int] = set()
        for i, older in enumerate(self.tracks):
            for younger in self.tracks[i + 1 :]:
                if {older.id, younger.id} & taken:
                    continue
                if are_one(older, younger, radius_m(younger.centre), parameters):
                    pairs.append((older, younger))
                    taken.add(younger.id)
        return pairs


def _note_seen(
    track: BodyTrack, px: NDArray[np.float32], dt: float, parameters: ObstacleParameters
) -> None:
    """Note how many members, at (K, 2) px, show a body, and where in the image."""
    track.points = len(px)
    if len(px) < parameters.min_points:
        track.missed_s += dt
        return
    track.missed_s = 0.0
    low, high = px.min(axis=0), px.max(axis=0)
    track.box_px = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
