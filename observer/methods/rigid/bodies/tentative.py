"""Tracks that may move but are not sure enough to be reported, and where their bodies may be."""

from __future__ import annotations

import numpy as np

from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.dense.scene import DenseScene
from observer.types import BoxPx, TrackState

# Standard deviations of its velocity, and number of points, from which a track may move.
_LEAST_SIGMAS, _LEAST_POINTS = 2.0, 6
# A segment of which more than this share entered free space must have come from elsewhere.
_CAME_SHARE = 0.5
# Metres: the width and height of a person.
_WIDTH_M, _HEIGHT_M = 0.5, 1.8


def moving_boxes_px(
    tracks: list[BodyTrack], scene: DenseScene | None, now: CameraStep
) -> tuple[list[BoxPx], list[BoxPx]]:
    """Return the boxes, px, of the bodies reported as seen, and of those that may move."""
    ground = None if scene is None else scene.ground
    reported = [t.box_px for t in tracks if t.state is TrackState.CONFIRMED]
    tentative = []
    for track in [t for t in tracks if may_move(t)]:
        # What moves on a reported person is an arm or a shadow, not another person.
        alone = not any(_middle_within(track.box_px, box) for box in reported)
        tentative.append(
            may_fill(track, ground, now.T_camera_world, now.camera) if alone else track.box_px
        )
    return reported, tentative


def may_move(track: BodyTrack) -> bool:
    """Return whether a track that is not reported yet may be of something that moves.

    The velocity of an outline is hardly known at first, and again once its points turned out to
    be on limbs. Then it may move if it entered free space, or because its points did.
    """
    if track.state is not TrackState.TENTATIVE:
        return False
    outline = track.seen_outline
    if track.significance >= _LEAST_SIGMAS:
        return outline is not None or track.crosses or track.points >= _LEAST_POINTS
    if outline is None or not outline.is_high:
        return False
    return track.loosened or outline.segment.arrived > _CAME_SHARE


def may_fill(
    track: BodyTrack, ground: GroundPlane | None, T_camera_world: Pose, camera: StereoCamera
) -> BoxPx:
    """Return u0, v0, u1, v1 around where a body may be, pixels of the left image.

    Points may be on a leg or a head, and an outline may be that of a trunk: a whole person may
    stand around them.

    Args:
        ground: None if unknown.
    """
    if ground is None:
        return track.box_px
    height = ground.height(track.centre)
    ends = track.centre + np.array([[height], [height - _HEIGHT_M]]) * ground.down
    px, disparity = camera.project(T_camera_world.apply(ends))
    if not np.isfinite(px).all():
        return track.box_px
    half = _WIDTH_M / 2 * float(disparity.mean()) / camera.baseline
    (left, top), (right, bottom) = px.min(axis=0).tolist(), px.max(axis=0).tolist()
    u0, v0, u1, v1 = track.box_px
    return min(u0, left - half), min(v0, top), max(u1, right + half), max(v1, bottom)


def _middle_within(box: BoxPx, other: BoxPx) -> bool:
    u, v = (box[0] + box[2]) / 2, (box[1] + box[3]) / 2
    return other[0] <= u <= other[2] and other[1] <= v <= other[3]
