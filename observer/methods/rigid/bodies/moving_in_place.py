"""Bodies that move in place: arms that wave beside a trunk that stays where it is."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from observer.geometry import Float64Array
from observer.kernels.patches import describe_patches
from observer.kernels.sight import place_of
from observer.methods.rigid.bodies.beginning import start_track
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.changes import Changes
from observer.methods.rigid.dense.people import is_person, standing_segment
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Mask, Segment, opened, widened
from observer.methods.rigid.tracked_points import TrackedPoints
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds

# m^2 and cells: a smaller change is noise. Beyond so many metres it is lost in noise.
_LEAST_M2, _LEAST_CELLS, _FARTHEST_M = 0.003, 7, 6.0
# Metres: changes up to so far apart are at one place. Weight of their distance along the line of
# sight, as depth is less certain than direction.
_PLACE_M, _ALONG_WEIGHT = 0.45, 0.4
_GAIN = 0.2
# m/s, one standard deviation: travel speed of a body that has moved in place for a while.
_STAYED_MPS = 0.1
# Metres: a change within this reach of a known body is on that body.
_REACH_M = 0.3


@dataclass(eq=False)
class _Place:
    """A place that changed, on no known body: (3,) metres, world, and when."""

    at: Float64Array
    changes: Changes = field(default_factory=Changes)


class MovingInPlace:
    """Remembers where the scene changed for some seconds, on bodies and elsewhere."""

    def __init__(self) -> None:
        self._places: list[_Place] = []

    def note(
        self,
        tracks: list[BodyTrack],
        points: TrackedPoints,
        scene: DenseScene,
        numbers: TrackIds,
    ) -> TrackedPoints:
        """Note what changed, and on which body; returns the points without the removed bodies.

        Args:
            tracks: the bodies; new ones that move in place are added, and tentative ones seen on
                them are removed.
        """
        changes = _changes(scene)
        free = np.ones(scene.grid.shape, np.bool_)
        for track in [t for t in tracks if t.state is not TrackState.TENTATIVE]:
            outline = track.seen_outline
            if outline is None:
                track.changes.forget()
                continue
            mine = _on_and_around(outline.segment, scene)
            # A travelling body changes all over.
            stays = track.motion is not MotionState.MOVING
            changed = stays and any(mine[cell] for cell, _ in changes)
            track.changes.note(scene.time, changed=changed)
            free &= ~mine
        self._note_places([place for cell, place in changes if free[cell]], scene)
        for place in [p for p in self._places if p.changes.recurring]:
            segment = standing_segment(scene, place.at, free)
            if segment is not None and is_person(segment, scene):
                parts = [t for t in tracks if _lies_on(t, segment)]
                of_parts = np.isin(points.obstacle, [t.id for t in parts])
                points = points.but(obstacle=np.where(of_parts, NO_OBSTACLE, points.obstacle))
                for part in parts:
                    tracks.remove(part)
                free &= ~segment.mask
                track = start_track(numbers.provisional(), segment, scene, _STAYED_MPS)
                track.changes, place.changes = place.changes, Changes()
                tracks.append(track)
        return points

    def _note_places(self, found: list[Float64Array], scene: DenseScene) -> None:
        for at in found:
            near = min(self._places, key=lambda p: _apart(p.at, at, scene), default=None)
            if near is None or _apart(near.at, at, scene) > _PLACE_M:
                near = _Place(at)
                self._places.append(near)
            near.at = near.at + _GAIN * (at - near.at)
            near.changes.note(scene.time, changed=True)
        for place in self._places:
            place.changes.note(scene.time, changed=False)
        self._places = [p for p in self._places if p.changes.known]


def _changes(scene: DenseScene) -> list[tuple[tuple[int, int], Float64Array]]:
    """List where something changed: row and column of a cell, and the place (3,) m, world."""
    grid, camera, pose = scene.grid, scene.grid.camera, scene.T_world_camera
    changed = opened(scene.changed).view(np.uint8)
    _, labels, statistics, centroids = cv2.connectedComponentsWithStats(changed, connectivity=8)
    stats, middles = np.asarray(statistics, np.int32), np.asarray(centroids, np.float64)
    disparity, nearest = describe_patches(
        np.asarray(labels, np.int32), stats, middles, scene.disparity
    )
    area = stats[:, cv2.CC_STAT_AREA]
    counts = (area >= _LEAST_CELLS) & (area >= _LEAST_M2 * grid.per_metre(1.0) ** 2 * disparity**2)
    counts &= disparity >= camera.fb / _FARTHEST_M
    # Label 0 is what did not change.
    counts[0] = False
    found = []
    for label in np.flatnonzero(counts).tolist():
        u, v = grid.to_px(middles[label]).tolist()
        place = place_of(
            u, v, float(disparity[label]), pose.rotation, pose.translation, camera.numbers
        )
        row, column = nearest[label].tolist()
        found.append(((row, column), place))
    return found


def _on_and_around(segment: Segment, scene: DenseScene) -> Mask:
    """(h, w) the cells of a body, and those near it."""
    return widened(segment.mask, max(2, round(_REACH_M * scene.grid.per_metre(segment.disparity))))


def _apart(a: Float64Array, b: Float64Array, scene: DenseScene) -> float:
    between = b - a
    along = scene.along_sight(a) @ between
    return float(np.linalg.norm(between - along + _ALONG_WEIGHT * along))


def _lies_on(track: BodyTrack, segment: Segment) -> bool:
    """Return whether a tentative body is seen on a segment."""
    outline = track.seen_outline
    if outline is None or track.state is not TrackState.TENTATIVE:
        return False
    return bool((outline.segment.mask & segment.mask).any())
