"""Heights of a depth segment above the ground, metres."""

from __future__ import annotations

import numpy as np

from observer.kernels.sight import place_of
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment


def top_height(segment: Segment, scene: DenseScene, ground: GroundPlane) -> float:
    """Return the height of the upper end of a segment above the ground."""
    return _height(segment, segment.box[1], scene, ground)


def bottom_height(segment: Segment, scene: DenseScene, ground: GroundPlane) -> float:
    """Return the height of the lower end of a segment above the ground."""
    return _height(segment, segment.box[3] - 1, scene, ground)


def _height(segment: Segment, row: int, scene: DenseScene, ground: GroundPlane) -> float:
    pose, camera = scene.T_world_camera, scene.grid.camera.numbers
    u, v = scene.grid.to_px(np.array([segment.columns[1], row])).tolist()
    place = place_of(u, v, segment.disparity, pose.rotation, pose.translation, camera)
    return ground.height(place)
