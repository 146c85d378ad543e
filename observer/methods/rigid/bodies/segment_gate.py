"""Gates the segments of a body by where it can have gone; heights are left out."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array
from observer.kernels.body_filter import squared_gap
from observer.kernels.sight import view_of
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY
from observer.methods.rigid.bodies.outline import anchor_of, measured_anchor
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, extent_m

# Within this squared Mahalanobis distance of its place a segment may be a body out of sight;
# metres, one standard deviation of the body's unexpected motion.
_FOUND_CHI2, _CHANGED_M = 9.0, 0.25
# Beyond this squared distance a segment is not the body's; m/s, one standard deviation of how the
# velocity changes out of sight.
_LEAP_CHI2, _CHANGED_MPS = 25.0, 0.5
# Metres by which a body that left the image may be farther from there than it has travelled.
_TURNED_M = 0.5
# Seconds within which a body that comes back is noticed, and by what factor it may be wider.
_NOTICED_S, _WIDER = 0.5, 1.5
_LEVEL, _EYE = np.array([1.0, 0.0, 1.0]), np.eye(3)


def misfit(track: BodyTrack, segment: Segment, scene: DenseScene) -> float | None:
    """Return how far a segment is from where a body out of sight should be; None if too far.

    Returns:
        A squared Mahalanobis distance, heights left out. Beyond the image's border a body may have
        turned in any way: there the distance is scaled to the same limit.
    """
    place, cov = measured_anchor(segment, "middle", scene)
    if has_left(track, scene):
        if not _may_return(track, segment, scene):
            return None
        coasted = track.missed_s * track.mean[VELOCITY]
        gap = float(np.linalg.norm((place - (track.centre - coasted)) * _LEVEL))
        room = float(np.linalg.norm(coasted)) + _TURNED_M
        return _FOUND_CHI2 * (gap / room) ** 2 if gap < room else None
    squared = _chi2(track, place - track.centre, cov, _CHANGED_M)
    return squared if squared < _FOUND_CHI2 else None


def _may_return(track: BodyTrack, segment: Segment, scene: DenseScene) -> bool:
    """Return whether a segment may be a body that has just come back over the image's border.

    It must not be much wider, nor farther from that border than the body goes in a moment.
    """
    width_m, _ = extent_m(segment, scene.grid)
    if track.outline is not None and width_m > _WIDER * track.outline.width:
        return False
    left, _, right, _ = segment.box
    inwards = left if _column(track, scene) < 0 else scene.grid.width - right
    room_m = float(np.linalg.norm(track.mean[VELOCITY])) * _NOTICED_S + _TURNED_M
    return inwards < room_m * scene.grid.per_metre(segment.disparity)


def leaps(track: BodyTrack, segment: Segment, scene: DenseScene) -> bool:
    """Return whether a segment is much farther away than its body can have gone.

    Beside and behind a body are cells that it covered a moment ago, which seem to have arrived.
    """
    anchor = anchor_of(segment)
    assert track.outline is not None
    place, cov = measured_anchor(segment, anchor, scene)
    offset = track.outline.offsets.get(anchor)
    at = track.mean[POSITION] + offset if offset is not None else track.centre
    changed = _CHANGED_M + track.missed_s * _CHANGED_MPS
    return _chi2(track, place - at, cov, changed) > _LEAP_CHI2


def _chi2(track: BodyTrack, gap: Float64Array, cov: Float64Array, changed_m: float) -> float:
    """Return the squared Mahalanobis length of a gap to a body's place, heights left out.

    Args:
        gap: (3,) metres, world. cov: (3, 3) of the measurement. changed_m: one standard deviation
            of the body's unexpected motion.
    """
    noise = cov + _EYE * changed_m**2
    return squared_gap(gap * _LEVEL, track.filter.covariance, POSITION.start, noise)


def has_left(track: BodyTrack, scene: DenseScene) -> bool:
    """Return whether a body should be beyond the left or right border of the image by now."""
    return not 0 <= _column(track, scene) <= scene.grid.camera.width - 1


def _column(track: BodyTrack, scene: DenseScene) -> float:
    """Return the column, px, where the centre of a body should be."""
    pose = scene.T_camera_world
    u, _, _ = view_of(track.centre, pose.rotation, pose.translation, scene.grid.camera.numbers)
    return u
