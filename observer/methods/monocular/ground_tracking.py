"""Tracks obstacles with one camera, by the points on them and by their ground contact."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array, mahalanobis
from observer.methods.monocular.ground import GroundView
from observer.methods.monocular.ground_contact import (
    box_around,
    ground_place,
    lower_edge,
    lowest_row,
)
from observer.methods.monocular.ground_track import GroundTrack
from observer.methods.monocular.rays import RayPoints
from observer.parameters import MonocularParameters, ObstacleParameters
from observer.types import BoxPx, Image, MotionState, TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds, expired, next_state

# Pixels per frame: a member moves with the others to within this.
_TOGETHER_PX = 0.7
# Pixels: a point joins if it fits the body better than a static point by this much.
_BETTER_PX = 0.5
_FEWEST_MEMBERS = 3
# Share by which the box moves to its measured edges each frame, after moving with its points.
_EDGE_GAIN, _SIDE_GAIN = 0.15, 0.15
# Standard deviations: a group this near to an obstacle's predicted place belongs to it.
_GATE = 3.5
_FIRST_SPEED = 0.6
# Significance of the velocity that is enough if the lines of sight also show motion.
_SUPPORT_SIGMAS = 2.0
# Boxes with a gap below this share of their size, and similar image motion, are one obstacle.
_GAP_SHARE, _ALIKE_PX = 0.5, 0.8
# Seconds: a tentative track is dropped if it was not seen for this long, or is not confirmed this
# long after it began.
_TENTATIVE_COAST_S = 0.3
_PATIENCE_S = 3.0
# An obstacle farther away than this share of the farthest distance ends.
_OUT_OF_REACH = 1.3


class GroundTracker:
    """The obstacles of one segment."""

    def __init__(self, numbers: TrackIds | None = None) -> None:
        """``numbers`` supplies the ids of obstacles; new ones if left out."""
        self._numbers = numbers or TrackIds()
        self.tracks: list[GroundTrack] = []

    def boxes_px(self) -> Float64Array:
        """(B, 4) pixels, around all obstacles seen in this frame."""
        seen = [track.box_px for track in self.tracks if track.missed_s == 0]
        return np.array(seen, np.float64).reshape(-1, 4)

    def follow(
        self,
        points: RayPoints,
        significance: Float64Array,
        threshold: float,
        standing_flow: Float64Array,
        image: Image,
        view: GroundView,
        dt: float,
        p: MonocularParameters,
        q: ObstacleParameters,
    ) -> RayPoints:
        """Move every obstacle with its points and foot; return the points with their obstacles.

        Args:
            significance: (N,) of each point's motion; above ``threshold`` it moves.
            standing_flow: (N, 2) px, image motion of each point if it were static.
        """
        owner = points.obstacle.copy()
        for track in self.tracks:
            track.predict(dt, p.acceleration)
            track.age_s += dt
            members = np.flatnonzero(owner == track.id)
            kept, moved = _moved_together(points, members, standing_flow, track.box_px)
            owner[np.setdiff1d(members, kept)] = NO_OBSTACLE
            if len(kept) < _FEWEST_MEMBERS or moved is None:
                owner[kept] = NO_OBSTACLE
                track.points = 0
                track.missed_s += dt
                track.box_px = _projected(track, view)
                continue
            box = _widened(moved, points.px[kept])
            foot = lower_edge(image, box, lowest_row(points.px[kept]))
            if foot is not None:
                box = (box[0], box[1], box[2], box[3] + _EDGE_GAIN * (foot - box[3]))
            # This is a correction of the box, not motion of the obstacle.
            _shift(track, moved, box, view)
            joining = _joining(points, owner, kept, standing_flow, box)
            owner[joining] = track.id
            track.box_px, track.points, track.missed_s = box, len(kept), 0.0
            share = float(np.mean(significance[kept] > threshold))
            self._measure(track, view, p)
            self._judge(track, share, p, q)
            if track.state is not TrackState.TENTATIVE:
                number = self._numbers.confirmed(track.id)
                owner[owner == track.id] = number
                track.id = number
        return points.but(obstacle=owner)

    def found(
        self,
        points: RayPoints,
        groups: NDArray[np.int64],
        significance: Float64Array,
        floating: bool,
        image: Image,
        view: GroundView,
        p: MonocularParameters,
    ) -> RayPoints:
        """Start an obstacle for every group (N,), or assign it to one predicted there."""
        owner = points.obstacle.copy()
        for number in range(int(groups.max(initial=-1)) + 1):
            members = np.flatnonzero(groups == number)
            box = box_around(points.px[members])
            foot = lower_edge(image, box, lowest_row(points.px[members]))
            if foot is not None:
                box = (box[0], box[1], box[2], foot)
            sigma = (p.foot_sigma_px, p.foot_sigma_px * (1.0 if foot is not None else 3.0))
            placed = ground_place(((box[0] + box[2]) / 2, box[3]), sigma, view)
            if placed is None or box[3] >= view.camera.height - 2:
                continue
            place, cov = placed
            if np.linalg.norm(place - view.here) > p.farthest_m:
                continue
            track = self._expected_at(place, cov, box)
            if track is None:
                full = np.zeros((4, 4))
                full[:2, :2], full[2:, 2:] = cov, _FIRST_SPEED**2 * np.eye(2)
                strongest = float(np.median(significance[members]))
                track = GroundTrack(
                    self._numbers.provisional(), np.append(place, [0.0, 0.0]), full, box,
                    np.zeros(2), strongest, floating,
                )  # fmt: skip
                self.tracks.append(track)
            elif track.missed_s > 0:
                track.box_px, track.missed_s = box, 0.0
                track.mean[:2] = place
                track.covariance[:2, :2], track.covariance[2:, :2] = cov, 0.0
                track.covariance[:2, 2:] = 0.0
            track.size = _size(box, place, view)
            owner[members] = track.id
        return points.but(obstacle=owner)

    def merge(self, points: RayPoints, view: GroundView) -> RayPoints:
        """Merge obstacles that touch in the image and move alike there."""
        owner = points.obstacle.copy()
        flow = (points.px - points.before_px).astype(np.float64)
        seen = [track for track in self.tracks if track.missed_s == 0]
        seen.sort(key=lambda track: (-track.hits, -track.age_s))
        gone: set[int] = set()
        for n, one in enumerate(seen):
            for other in seen[n + 1 :]:
                mine, theirs = owner == one.id, owner == other.id
                if {one.id, other.id} & gone or not (mine.any() and theirs.any()):
                    continue
                gap = np.median(flow[mine], axis=0) - np.median(flow[theirs], axis=0)
                if _near(one.box_px, other.box_px) and np.linalg.norm(gap) <= _ALIKE_PX:
                    owner[theirs] = one.id
                    box = _union(one.box_px, other.box_px)
                    _shift(one, one.box_px, box, view)
                    one.box_px = box
                    gone.add(other.id)
        self.tracks = [track for track in self.tracks if track.id not in gone]
        return points.but(obstacle=owner)

    def live(
        self, points: RayPoints, view: GroundView, p: MonocularParameters, q: ObstacleParameters
    ) -> RayPoints:
        """End obstacles unseen for too long, never confirmed, or out of range."""
        ended = []
        for track in self.tracks:
            if track.missed_s > 0:
                track.state = next_state(track.state, seen=False, confirmed=False)
            far = float(np.linalg.norm(track.place - view.here)) > _OUT_OF_REACH * p.farthest_m
            never = track.state is TrackState.TENTATIVE and track.age_s > _PATIENCE_S
            over = expired(
                track.state, track.missed_s, coast=q.coast_s, patience=_TENTATIVE_COAST_S
            )
            if over or far or never:
                ended.append(track.id)
        if not ended:
            return points
        self.tracks = [track for track in self.tracks if track.id not in ended]
        gone = np.isin(points.obstacle, ended)
        return points.but(obstacle=np.where(gone, NO_OBSTACLE, points.obstacle))

    def _expected_at(
        self, place: Float64Array, cov: Float64Array, box: BoxPx
    ) -> GroundTrack | None:
        best, least = None, _GATE
        for track in self.tracks:
            if track.missed_s == 0 and _overlap(box, track.box_px) > 0.3:
                return track
            length = track.length_to(place, cov)
            if track.missed_s > 0 and length < least:
                best, least = track, length
        return best

    def _measure(self, track: GroundTrack, view: GroundView, p: MonocularParameters) -> None:
        camera, (u0, _, u1, v1) = view.camera, track.box_px
        cut = v1 >= camera.height - 2
        side = u0 <= 1 or u1 >= camera.width - 2
        sigma = (p.foot_sigma_px * (20 if side else 1), p.foot_sigma_px * (20 if cut else 1))
        placed = ground_place(((u0 + u1) / 2, v1), sigma, view)
        if placed is None:
            return
        track.update(*placed)
        size = _size(track.box_px, track.place, view)
        track.size = size if not track.size.any() else track.size + 0.1 * (size - track.size)

    def _judge(
        self, track: GroundTrack, share: float, p: MonocularParameters, q: ObstacleParameters
    ) -> None:
        cov = track.covariance[2:, 2:]
        track.significance = mahalanobis(track.velocity, cov)
        speed = float(np.linalg.norm(track.velocity))
        clear = track.significance > p.confirm_sigmas
        supported = share > 0.5 and track.significance > _SUPPORT_SIGMAS
        if speed > q.stopped_below_mps and (clear or supported):
            track.hits += 1
        track.state = next_state(track.state, seen=True, confirmed=track.hits >= q.confirm_hits)
        track.motion = MotionState.MOVING
        if speed < q.stopped_below_mps:
            track.motion = MotionState.STOPPED


def _shift(track: GroundTrack, before: BoxPx, after: BoxPx, view: GroundView) -> None:
    """Shift an obstacle's place, not its velocity, by the correction of its box's foot."""
    feet = [np.array([(box[0] + box[2]) / 2, box[3]]) for box in (before, after)]
    old, new = (view.contact(foot) for foot in feet)
    if old is None or new is None:
        return
    gap = view.ground.axes.T @ (new - old)
    track.mean = track.mean + np.append(gap, [0.0, 0.0])
    track.covariance[:2, :2] += np.outer(gap, gap)


def _moved_together(
    points: RayPoints, members: NDArray[np.intp], standing_flow: Float64Array, box: BoxPx
) -> tuple[NDArray[np.intp], BoxPx | None]:
    """Return the members that move together, scaling included, and the box moved with them."""
    for _ in range(3):
        if len(members) < _FEWEST_MEMBERS:
            return members, None
        a = points.before_px[members].astype(np.float64)
        b = points.px[members].astype(np.float64)
        middle, shift = np.median(a, axis=0), np.median(b - a, axis=0)
        arms = a - middle
        square = float((arms**2).sum())
        grow = float((arms * (b - a - shift)).sum()) / square if square > 50 else 0.0
        grow = float(np.clip(grow, -0.1, 0.1))
        gap = np.linalg.norm(b - a - shift - grow * arms, axis=1)
        still = np.linalg.norm(b - a - standing_flow[members], axis=1)
        good = (gap <= _TOGETHER_PX) & (gap <= np.nan_to_num(still, nan=np.inf) + _BETTER_PX)
        if good.all():
            break
        members = members[good]
    corners = np.array(box, np.float64).reshape(2, 2)
    corners = corners + shift + grow * (corners - middle)
    (u0, v0), (u1, v1) = corners.tolist()
    return members, (u0, v0, u1, v1)


def _joining(
    points: RayPoints,
    owner: NDArray[np.int64],
    kept: NDArray[np.intp],
    standing_flow: Float64Array,
    box: BoxPx,
) -> NDArray[np.intp]:
    """Return the free points in the box that fit the members' motion better than a static one."""
    inside = (points.px[:, 0] >= box[0]) & (points.px[:, 0] <= box[2])
    inside &= (points.px[:, 1] >= box[1]) & (points.px[:, 1] <= box[3])
    inside &= (owner == NO_OBSTACLE) & (points.sightings >= 2)
    flow = np.median(points.px[kept] - points.before_px[kept], axis=0)
    own = points.px - points.before_px
    gap = np.linalg.norm(own - flow, axis=1)
    still = np.nan_to_num(np.linalg.norm(own - standing_flow, axis=1), nan=np.inf)
    return np.flatnonzero(inside & (gap <= _TOGETHER_PX) & (gap + _BETTER_PX < still))


def _widened(box: BoxPx, px: NDArray[np.float32]) -> BoxPx:
    """Return the box, adapted gradually to the extent of its points."""
    u0, v0, u1, _ = box_around(px)

    def to(old: float, new: float, outward: bool) -> float:
        return old + (_SIDE_GAIN if outward else _SIDE_GAIN / 3) * (new - old)

    return (
        to(box[0], u0, u0 < box[0]),
        to(box[1], v0, v0 < box[1]),
        to(box[2], u1, u1 > box[2]),
        box[3],
    )


def _size(box: BoxPx, place: Float64Array, view: GroundView) -> Float64Array:
    """(2,) metres: width and height of a box whose foot is at a place (2,) on the ground."""
    depth, c = max(float(view.seen(place)[2]), 0.1), view.camera
    return np.array([(box[2] - box[0]) * depth / c.fx, (box[3] - box[1]) * depth / c.fy])


def _projected(track: GroundTrack, view: GroundView) -> BoxPx:
    """Return the predicted box of an obstacle that is not seen."""
    foot = view.seen(track.place)
    if foot[2] <= 0.1:
        return track.box_px
    (u, v), _ = view.camera.project(foot)
    width, height = track.size * view.camera.fx / foot[2]
    return float(u - width / 2), float(v - height), float(u + width / 2), float(v)


def _union(a: BoxPx, b: BoxPx) -> BoxPx:
    return min(a[0], b[0]), min(a[1], b[1]), max(a[2], b[2]), max(a[3], b[3])


def _near(a: BoxPx, b: BoxPx) -> bool:
    """Return whether two boxes touch, or their gap is small compared with their size."""
    both = _union(a, b)
    across = (a[2] - a[0]) + (b[2] - b[0]) - (both[2] - both[0])
    down = (a[3] - a[1]) + (b[3] - b[1]) - (both[3] - both[1])
    room = _GAP_SHARE * max(a[2] - a[0], b[2] - b[0], a[3] - a[1], b[3] - b[1])
    return across > -room and down > -room


def _overlap(a: BoxPx, b: BoxPx) -> float:
    """Share of the smaller of two boxes that lies in the other."""
    w = min(a[2], b[2]) - max(a[0], b[0])
    h = min(a[3], b[3]) - max(a[1], b[1])
    if w <= 0 or h <= 0:
        return 0.0
    least = min((a[2] - a[0]) * (a[3] - a[1]), (b[2] - b[0]) * (b[3] - b[1]))
    return w * h / max(least, 1e-9)
