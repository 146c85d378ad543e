"""Heights of a depth segment above the ground, metres."""

from __future__ import annotations

import numpy as np

from observer.kernels.sight import place_of
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment

# Metres above the ground: what begins higher, such as an arm, does not stand on it.
_STANDS_M = 0.35


def top_height(segment: Segment, scene: DenseScene, ground: GroundPlane) -> float:
    """Return the height of the upper end of a segment above the ground."""
    return _height(segment, segment.box[1], scene, ground)


def bottom_height(segment: Segment, scene: DenseScene, ground: GroundPlane) -> float:
    """Return the height of the lower end of a segment above the ground."""
    return _height(segment, segment.box[3] - 1, scene, ground)


def stands(segment: Segment, scene: DenseScene, ground: GroundPlane) -> bool:
    """Return whether a segment reaches down to the ground, at least nearly."""
    return bottom_height(segment, scene, ground) <= _STANDS_M


def _height(segment: Segment, row: int, scene: DenseScene, ground: GroundPlane) -> float:
    pose, camera = scene.T_world_camera, scene.grid.camera.numbers
    u, v = scene.grid.to_px(np.array([segment.columns[1], row])).tolist()
    place = place_of(u, v, segment.disparity, pose.rotation, pose.translation, camera)
    return ground.height(place)
