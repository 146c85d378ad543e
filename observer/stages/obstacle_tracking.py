"""Obstacles as bodies: which points belong to each, how it moves, its box, its life."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, cross_matrix, inverse_3x3
from observer.motion_evidence import Motion
from observer.obstacle_filter import (
    POSITION,
    VELOCITY,
    YAW,
    YAW_RATE,
    ObstacleMotion,
    turning_velocity,
    yaw_matrix,
)
from observer.obstacle_shape import Box, ObstacleShape
from observer.parameters import ObstacleParameters
from observer.points import NO_OBSTACLE, Points
from observer.types import MotionState, TrackState

# Share of the acceleration that a steadily driving body may still have.
_STEADY = 0.1
_YAW_RATE_SIGMA = 0.6
_YAW_ACCELERATION = (0.3, 5.0)
# A point that fits its body worse than this leaves it.
_LEAVE_SIGMAS = 4.0
# A point joins if its velocity fits the body's and it is this much likelier than at rest.
_JOIN_CHI2 = float(chi2.ppf(0.99, df=3))
_JOIN_RATIO = 8.0
# Old places of points on the body are forgotten at this rate: the patch that is followed slides.
_SHAPE_MEMORY_S = 2.0
# A member must have been seen this often before its place may stretch the box for good.
_SETTLED = 6
_MEDIAN_CHI2 = float(chi2.ppf(0.5, df=3))
_STEPS = 3
# Below this the velocity is no more than noise.
_MOVING_SIGMAS = 3.0
_CONFIRM_SIGHTINGS = 24
_STRAY = 4.0
# Share of its speed that a body may gain or lose in a second.
_BRAKING_PER_S = 0.5
_LEAST_YAW_INFORMATION = 1e-2
_MEASURED = [0, 1, 2, YAW]
_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float64)
# How much a body may have turned in a frame against expectation, rad.
_YAW_SLACK = 0.05
# A tentative track that has not moved significantly within this time was none.
_PATIENCE_S = 0.5


@dataclass(eq=False)
class BodyTrack:
    """One obstacle over time.

    Attributes:
        id: unique within an observer. state, motion: as reported.
        filter: place, velocity, yaw. The place is that of the body's own origin, not its centre.
        box: in the body's frame; None before the first update.
        points: members seen in this frame. missed_s: seconds since it was last seen.
        hits: frames in which it moved significantly. significance: Mahalanobis length of the
            velocity. box_px: around the members in the image.
    """

    id: int
    filter: ObstacleMotion
    shape: ObstacleShape
    state: TrackState = TrackState.TENTATIVE
    motion: MotionState = MotionState.MOVING
    box: Box | None = None
    points: int = 0
    frames: int = 0
    sightings: int = 0
    missed_s: float = 0.0
    age_s: float = 0.0
    hits: int = 0
    significance: float = 0.0
    peak_significance: float = 0.0
    box_px: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    @property
    def mean(self) -> Float64Array:
        return self.filter.mean

    @property
    def R(self) -> Float64Array:
        return yaw_matrix(float(self.mean[YAW]))

    @property
    def centre(self) -> Float64Array:
        """(3,) metres, world."""
        offset = np.zeros(3) if self.box is None else self.R @ self.box.centre
        return self.mean[POSITION] + offset

    def centre_velocity(self) -> tuple[Float64Array, Float64Array]:
        """(3,) m/s and its covariance (3, 3), world: of the centre."""
        mean, cov = self.mean, self.filter.covariance
        arm = self.centre - mean[POSITION]
        J = np.zeros((3, 8))
        J[:, VELOCITY] = np.eye(3)
        J[:, YAW_RATE] = turning_velocity(1.0, arm)
        return mean[VELOCITY] + turning_velocity(mean[YAW_RATE], arm), J @ cov @ J.T


class BodyTracker:
    """Keeps the obstacles' tracks; points carry the number of the obstacle they belong to."""

    def __init__(self, numbers: Iterator[int] | None = None) -> None:
        self.tracks: list[BodyTrack] = []
        self._numbers = count(1) if numbers is None else numbers

    def clear(self) -> None:
        """End all tracks; their numbers are not used again."""
        self.tracks = []

    def predict(self, dt: float, camera_position: Float64Array, camera: StereoCamera,
                parameters: ObstacleParameters) -> None:  # fmt: skip
        """Move all bodies on by ``dt`` seconds."""
        for track in self.tracks:
            depth = float(np.linalg.norm(track.mean[POSITION] - camera_position))
            agile = parameters.acceleration_px * depth / camera.fx
            axis = track.shape.axis(float(track.mean[YAW]))
            track.filter = track.filter.predicted(
                dt, (_STEADY * agile, agile), _YAW_ACCELERATION, axis
            )
            track.age_s += dt
            track.frames += 1

    def known(self, points: Points) -> NDArray[np.bool_]:
        """(N,) which points belong to obstacles that are known to move."""
        sure = [t.id for t in self.tracks if t.state is not TrackState.TENTATIVE]
        return np.isin(points.obstacle, sure)

    def expected_at(
        self, points: Points, place: Float64Array, dt: float, parameters: ObstacleParameters
    ) -> Float64Array:
        """(N, 3) where points on bodies should be ``dt`` seconds on, world; NaN for others.

        Points that are not members yet, but lie in a body's box, are expected to move with it.

        Args:
            place: (N, 3) metres, world, where points are now if they do not move.
        """
        out = np.full((len(points), 3), np.nan)
        young = (points.obstacle == NO_OBSTACLE) & (points.sightings < 4)
        for track in self.tracks:
            mean = track.mean
            if track.box is not None:
                room = parameters.margin * float(track.box.size.max())
                guests = np.flatnonzero(young)[in_box(track, place[young], room)]
                arm = place[guests] - mean[POSITION]
                speed = mean[VELOCITY] + turning_velocity(mean[YAW_RATE], arm)
                out[guests] = place[guests] + dt * speed
            mine = np.flatnonzero(points.obstacle == track.id)
            R = yaw_matrix(float(mean[YAW] + dt * mean[YAW_RATE]))
            out[mine] = mean[POSITION] + dt * mean[VELOCITY] + shape_position(points, mine) @ R.T
        return out

    def boxes_px(self, T_camera_world: Pose, camera: StereoCamera) -> Float64Array:
        """(B, 4) u0 v0 u1 v1 around the obstacles' boxes in the left image."""
        found = []
        for track in self.tracks:
            if track.box is None:
                continue
            corners = track.centre + (_CORNERS * track.box.size / 2) @ (
                track.R @ yaw_matrix(track.box.heading)
            ).T
            px, _ = camera.project(T_camera_world.apply(corners))
            if np.isfinite(px).all():
                found.append([*px.min(axis=0), *px.max(axis=0)])
        return np.array(found).reshape(-1, 4)

    def update(
        self,
        points: Points,
        sighting: Float64Array,
        information: Float64Array,
        T_camera_world: Pose,
        step_covariance: Float64Array,
        dt: float,
        parameters: ObstacleParameters,
    ) -> Points:
        """Move every body to where its members are seen; members that do not fit leave.

        Args:
            sighting: (N, 3) metres, world, NaN unknown. information: (N, 3, 3) of each.
        """
        obstacle = points.obstacle.copy()
        tenure = np.where(obstacle == NO_OBSTACLE, 0, points.tenure + 1)
        shape_information = points.shape_information * np.exp(-dt / _SHAPE_MEMORY_S)
        shape_vector = points.shape_vector * np.exp(-dt / _SHAPE_MEMORY_S)
        for track in self.tracks:
            mine = np.flatnonzero((obstacle == track.id) & np.isfinite(sighting[:, 0]))
            out = self._move(track, points, mine, sighting, information, T_camera_world,
                             step_covariance, parameters)  # fmt: skip
            obstacle[mine[out]] = NO_OBSTACLE
            mine = mine[~out]
            track.points = len(mine)
            R = track.R
            local = R.T @ information[mine] @ R
            at = (sighting[mine] - track.mean[POSITION]) @ R
            shape_information[mine] += local
            shape_vector[mine] += np.einsum("nij,nj->ni", local, at)
            if len(mine) >= parameters.min_points:
                track.missed_s = 0.0
                low, high = points.px[mine].min(axis=0), points.px[mine].max(axis=0)
                track.box_px = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
            else:
                track.missed_s += dt
        return points.but(
            obstacle=obstacle,
            tenure=tenure,
            shape_information=shape_information,
            shape_vector=shape_vector,
        )

    def _move(
        self,
        track: BodyTrack,
        points: Points,
        mine: NDArray[np.intp],
        sighting: Float64Array,
        information: Float64Array,
        T_camera_world: Pose,
        step_covariance: Float64Array,
        parameters: ObstacleParameters,
    ) -> NDArray[np.bool_]:
        """Measure the body's place and yaw by its members; returns which of them do not fit."""
        known = np.trace(points.shape_information[mine], axis1=1, axis2=2) > 0
        place = shape_position(points, mine)
        place = np.where(known[:, None], place, 0.0)
        out = np.zeros(len(mine), np.bool_)
        if np.count_nonzero(known) < parameters.min_points:
            return out
        mean, prior = track.mean, track.filter.covariance
        expected, spread = mean[_MEASURED], prior[np.ix_(_MEASURED, _MEASURED)]
        noise = inverse_3x3(information[mine])
        shape_cov = inverse_3x3(
            np.where(known[:, None, None], points.shape_information[mine], np.eye(3))
        )
        x = expected.copy()
        for _ in range(_STEPS):
            R = yaw_matrix(float(x[3]))
            W = inverse_3x3(noise + R @ shape_cov @ R.T)
            arm = place @ R.T
            r = sighting[mine] - x[:3] - arm
            squared = np.einsum("ni,nij,nj->n", r, W, r)
            # Far from the answer all of them fit badly; only those that fit worse are strangers.
            scale = _scale(squared[known])
            length = np.sqrt(np.maximum(squared, 0.0)) / scale
            weight = np.minimum(1.0, 2.0 / np.maximum(length, 1e-9)) * known
            weight = weight * (length <= _LEAVE_SIGMAS)
            H = np.concatenate(
                [np.broadcast_to(np.eye(3), (len(mine), 3, 3)),
                 turning_velocity(1.0, arm)[:, :, None]], axis=2)  # fmt: skip
            WH = (W * weight[:, None, None]) @ H
            A = np.einsum("nai,naj->ij", H, WH)
            A[3, 3] += _LEAST_YAW_INFORMATION
            used = max(1.0, float(np.sum(weight > 0)))
            excess = max(1.0, float((weight * squared).sum()) / (3 * used))
            M = np.linalg.inv(A) * excess * (1 + parameters.shared_error * used)
            M[:3, :3] += _ego_noise(x[:3], T_camera_world, step_covariance)
            measured = x + np.linalg.solve(A, np.einsum("nai,na->i", WH, r))
            x = expected + spread @ np.linalg.solve(spread + M, measured - expected)
        track.filter = track.filter.updated(measured, (M + M.T) / 2)
        # Whether a point fits is judged by where the points are, not by where they should be.
        loose = spread.copy()
        loose[:3, :3] += np.eye(3) * 1e6
        loose[3, 3] += _YAW_SLACK**2
        best = expected + loose @ np.linalg.solve(loose + M, measured - expected)
        R = yaw_matrix(float(best[3]))
        r = sighting[mine] - best[:3] - place @ R.T
        W = inverse_3x3(noise + R @ shape_cov @ R.T)
        squared = np.einsum("ni,nij,nj->n", r, W, r)
        return known & (squared > (_LEAVE_SIGMAS * _scale(squared[known])) ** 2)

    def adopt(self, points: Points, motion: Motion,
              parameters: ObstacleParameters) -> Points:  # fmt: skip
        """Let points that move with a body, on it, join it."""
        obstacle = points.obstacle.copy()
        for track in self.tracks:
            free = np.flatnonzero((obstacle == NO_OBSTACLE) & motion.judged)
            if track.box is None or len(free) == 0:
                continue
            joins = self._belongs(track, free, motion, parameters)
            obstacle[free[joins]] = track.id
        return self._placed(points, obstacle)

    def _belongs(
        self,
        track: BodyTrack,
        free: NDArray[np.intp],
        motion: Motion,
        parameters: ObstacleParameters,
    ) -> NDArray[np.bool_]:
        """(K,) which free points lie on the body and move with it rather than rest."""
        assert track.box is not None
        mean = track.mean
        now = motion.position[free]
        sigma = np.sqrt(np.einsum("nii->n", motion.position_cov[free]))
        room = parameters.margin * float(track.box.size.max())
        inside = in_box(track, now, room + np.minimum(2 * sigma, room))
        expected = mean[VELOCITY] + turning_velocity(mean[YAW_RATE], now - mean[POSITION])
        L = motion.own_information[free]
        own = motion.own_velocity[free]
        # A point's velocity is the mean over its window; a body that turns or brakes has moved on.
        speed = float(np.linalg.norm(mean[VELOCITY]))
        lag = speed * (abs(float(mean[YAW_RATE])) + _BRAKING_PER_S) * motion.window_s[free] / 2
        loose = inverse_3x3(L + 1e-6 * np.eye(3)) + lag[:, None, None] ** 2 * np.eye(3)
        apart = own - expected
        as_body = np.einsum("ni,nij,nj->n", apart, inverse_3x3(loose), apart)
        at_rest = np.einsum("ni,nij,nj->n", own, L, own)
        return inside & (as_body <= _JOIN_CHI2) & (at_rest - as_body >= _JOIN_RATIO)

    def found(
        self,
        points: Points,
        groups: NDArray[np.int64],
        motion: Motion,
        camera_position: Float64Array,
        camera: StereoCamera,
        parameters: ObstacleParameters,
    ) -> Points:
        """Make obstacles of groups of dynamic points, or give them back to those lost from sight."""
        obstacle = points.obstacle.copy()
        for group in range(int(groups.max(initial=-1)) + 1):
            mine = np.flatnonzero(groups == group)
            mine = mine[_together(motion.position[mine])]
            if len(mine) < parameters.min_points:
                continue
            L = motion.own_information[mine].sum(axis=0)
            v = np.linalg.solve(L, np.einsum("nij,nj->i", motion.own_information[mine], motion.own_velocity[mine]))
            v_cov = np.linalg.inv(L) * (1 + parameters.shared_error * len(mine))
            v_cov = v_cov + np.eye(3) * 1e-6
            places = motion.position[mine]
            centre = np.median(places, axis=0)
            track = self._known(centre, v, v_cov, places)
            if track is None:
                depth = float(np.linalg.norm(centre - camera_position))
                spread = np.cov(places.T) / len(mine) + np.eye(3) * 1e-6
                track = BodyTrack(
                    id=next(self._numbers),
                    filter=ObstacleMotion.begin(centre, v, spread * 0 + np.eye(3) * 1e-6, v_cov, _YAW_RATE_SIGMA),
                    shape=ObstacleShape(),
                )
                self.tracks.append(track)
            elif track.missed_s > 0:
                self._reappeared(track, centre, v, v_cov)
            elif track.box is not None:
                room = parameters.margin * float(track.box.size.max())
                mine = mine[in_box(track, places, 2 * room)]
            obstacle[mine] = track.id
        return self._placed(points, obstacle)

    def _known(self, centre: Float64Array, v: Float64Array, v_cov: Float64Array,
               places: Float64Array) -> BodyTrack | None:  # fmt: skip
        """The track such a group belongs to, if there is one."""
        best, best_distance = None, np.inf
        for track in self.tracks:
            cov = track.filter.covariance
            size = 0.3 if track.box is None else float(np.linalg.norm(track.box.size[[0, 2]]))
            slack = 0.5 * size + 2.5 * float(np.sqrt(np.linalg.eigvalsh(cov[POSITION, POSITION])[-1]))
            distance = float(np.linalg.norm((centre - track.centre)))
            velocity, own = track.centre_velocity()
            apart = v - velocity
            # A body in a turn, or braking while hidden, differs more than the noise.
            loose = np.eye(3) * (0.3 * max(np.linalg.norm(v), np.linalg.norm(velocity))) ** 2
            squared = float(apart @ np.linalg.solve(own + v_cov + loose, apart))
            if distance <= slack and squared <= 16.3 and distance < best_distance:
                best, best_distance = track, distance
        return best

    def _reappeared(self, track: BodyTrack, centre: Float64Array, v: Float64Array,
                    v_cov: Float64Array) -> None:  # fmt: skip
        """Begin the filter anew where the body is seen again; it keeps its name and its size."""
        track.filter = ObstacleMotion.begin(centre, v, np.eye(3) * 1e-6, v_cov, _YAW_RATE_SIGMA)
        track.shape.forget()

    def _placed(self, points: Points, obstacle: NDArray[np.int64]) -> Points:
        """Give points that have just joined a place on their body."""
        information, vector = points.shape_information.copy(), points.shape_vector.copy()
        for track in self.tracks:
            new = np.flatnonzero((obstacle == track.id) & (points.obstacle != track.id))
            if len(new) == 0:
                continue
            mean, R = track.mean, track.R
            moving = mean[VELOCITY] + np.zeros((len(new), 3))
            at = (points.sums.take(new).moving_position(moving)[0] - mean[POSITION]) @ R
            information[new] = R.T @ points.sums.a0[new] @ R
            vector[new] = np.einsum("nij,nj->ni", information[new], at)
        return points.but(obstacle=obstacle, shape_information=information, shape_vector=vector)

    def live(
        self,
        points: Points,
        lost: Points,
        dt: float,
        camera_position: Float64Array,
        radius_m: Callable[[Float64Array], float],
        parameters: ObstacleParameters,
    ) -> Points:
        """Learn boxes, decide on each track's state, merge and end tracks."""
        for track in self.tracks:
            mine = np.flatnonzero(points.obstacle == track.id)
            gone = np.flatnonzero((lost.obstacle == track.id) & (lost.tenure >= _SETTLED))
            track.shape.keep(shape_position(lost, gone))
            if len(mine) >= parameters.min_points:
                view = track.R.T @ (track.mean[POSITION] - camera_position)
                track.shape.note_heading(track.mean[VELOCITY], track.filter.covariance[VELOCITY, VELOCITY], float(track.mean[YAW]))
                settled = mine[points.tenure[mine] >= min(_SETTLED // 2, track.frames)]
                settled = settled if len(settled) >= parameters.min_points else mine
                track.box = track.shape.box(shape_position(points, settled), view)
            self._judge(track, parameters)
        keep = [t for t in self.tracks if not _over(t, parameters)]
        ended = {t.id for t in self.tracks} - {t.id for t in keep}
        self.tracks = keep
        obstacle = points.obstacle.copy()
        for number in ended:
            obstacle[obstacle == number] = NO_OBSTACLE
        for older, younger in self._same(radius_m, parameters):
            obstacle[obstacle == younger.id] = older.id
            self.tracks = [t for t in self.tracks if t is not younger]
        return self._placed(points, obstacle)

    def _same(self, radius_m: Callable[[Float64Array], float], parameters: ObstacleParameters) -> list[tuple[BodyTrack, BodyTrack]]:
        """Pairs of tracks that are one body."""
        pairs = []
        taken: set[int] = set()
        for i, older in enumerate(self.tracks):
            for younger in self.tracks[i + 1 :]:
                if younger.id in taken or older.id in taken or older.box is None or younger.box is None:
                    continue
                room = parameters.margin * float(older.box.size.max() + younger.box.size.max())
                room = max(room, radius_m(younger.centre))
                near = in_box(older, younger.centre[None], room + younger.box.size / 2)[0]
                v1, c1 = older.centre_velocity()
                v1 = v1 + turning_velocity(older.mean[YAW_RATE], younger.centre - older.centre)
                v2, c2 = younger.centre_velocity()
                apart = v1 - v2
                loose = np.eye(3) * (0.25 * max(np.linalg.norm(v1), np.linalg.norm(v2))) ** 2
                if near and apart @ np.linalg.solve(c1 + c2 + loose, apart) <= 16.3:
                    pairs.append((older, younger))
                    taken |= {younger.id}
        return pairs

    def _judge(self, track: BodyTrack, parameters: ObstacleParameters) -> None:
        velocity, cov = track.centre_velocity()
        track.significance = float(np.sqrt(max(0.0, velocity @ np.linalg.solve(cov, velocity))))
        speed = float(np.linalg.norm(velocity))
        direction = velocity / max(speed, 1e-9)
        sigma = float(np.sqrt(direction @ cov @ direction))
        limit = parameters.stopped_below_mps
        if track.motion is MotionState.MOVING:
            if speed < limit or track.significance < _MOVING_SIGMAS:
                track.motion = MotionState.STOPPED
        elif speed - sigma > limit and track.significance >= _MOVING_SIGMAS:
            track.motion = MotionState.MOVING
        if track.missed_s > 0:
            if track.state is TrackState.CONFIRMED:
                track.state = TrackState.COASTING
            return
        if track.state is TrackState.COASTING:
            track.state = TrackState.CONFIRMED
        moves = track.significance >= parameters.confirm_sigmas
        if moves and track.motion is MotionState.MOVING:
            track.hits += 1
            track.sightings += track.points
        elif track.state is TrackState.TENTATIVE:
            track.hits = max(0, track.hits - 1)
        if track.state is not TrackState.TENTATIVE:
            return
        # The fewer points there are, the longer they must keep moving alike.
        if track.hits >= parameters.confirm_hits and track.sightings >= _CONFIRM_SIGHTINGS:
            track.state = TrackState.CONFIRMED


def _over(track: BodyTrack, parameters: ObstacleParameters) -> bool:
    if track.state is TrackState.TENTATIVE:
        return track.missed_s > 0.15 or (track.age_s > _PATIENCE_S and track.hits == 0)
    return track.missed_s > parameters.coast_s


def in_box(track: BodyTrack, position: Float64Array, margin: Float64Array | float) -> NDArray[np.bool_]:
    """(N,) which places (N, 3) m, world, lie in the track's box, made larger by the margin."""
    assert track.box is not None
    R = track.R @ yaw_matrix(track.box.heading)
    local = np.abs((position - track.centre) @ R)
    return np.asarray((local <= track.box.size / 2 + np.reshape(margin, (-1, 1))).all(axis=1))


def _ego_noise(position: Float64Array, T_camera_world: Pose, step_covariance: Float64Array) -> Float64Array:
    p = T_camera_world.apply(position)
    G = T_camera_world.rotation.T @ np.concatenate([-cross_matrix(p), np.eye(3)], axis=1)
    return np.asarray(G @ step_covariance @ G.T)


def _together(position: Float64Array) -> NDArray[np.bool_]:
    """(N,) which of a group's places (N, 3) are not far from most of the others."""
    apart = np.abs(position - np.median(position, axis=0))
    spread = 1.4826 * np.median(apart, axis=0)
    return np.asarray((apart <= _STRAY * spread + 1e-3).all(axis=1), dtype=np.bool_)


def _scale(squared: Float64Array) -> float:
    """By how much squared Mahalanobis lengths in space exceed their noise, at least 1."""
    return float(np.sqrt(max(1.0, np.median(squared) / _MEDIAN_CHI2)))


def shape_position(points: Points, which: NDArray[np.intp]) -> Float64Array:
    """(K, 3) metres: where points are on their obstacle, in its own frame."""
    cov = inverse_3x3(points.shape_information[which])
    return np.einsum("nij,nj->ni", cov, points.shape_vector[which])
