"""A person so near that only the legs are in view, which swing past each other.

As the legs stride alike, the hips are midway between them, across the view and in depth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from observer.geometry import Float64Array
from observer.methods.rigid.dense.height import top_height
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, depth_gap_m, segment_of

# Metres above the ground up to which legs reach.
_LEGS_M = 0.85
# Most metres between the outer edges of two striding legs, feet included; and in depth, of
# somebody who walks along the camera's axis and across it.
_STRIDE_M, _AHEAD_M, _BESIDE_M = 1.3, 0.7, 0.3
# Upper share of the rows of legs that tells where the hips are.
_HIPS_SHARE = 0.2
# Quantiles of the cells' disparities that stand for the farther leg and for the nearer one.
_DEPTHS = (0.15, 0.85)
# Metres, one standard deviation: how far a foremost or rearmost leg swings from the hips.
_SWING_M = 0.2
_EYE = np.eye(3)


def shows_only_legs(segment: Segment, scene: DenseScene) -> bool:
    """Return whether only legs are in view, which do not move as the body does."""
    if not segment.cut[2] or scene.ground is None:
        return False
    return top_height(segment, scene, scene.ground) < _LEGS_M


def is_other_leg(
    scene: DenseScene, part: Segment, leg: Segment, heading: Float64Array | None
) -> bool:
    """Return whether a segment is the other leg of a person, one leg of whom is known.

    Args:
        heading: (3,) unit vector, world, in which the person walks, and the legs stride; None if
            unknown.
    """
    along = 1.0 if heading is None else abs(float(scene.T_camera_world.rotation[2] @ heading))
    most_m = _BESIDE_M + along * (_AHEAD_M - _BESIDE_M)
    if not (part.cut[2] and leg.cut[2]) or depth_gap_m(part, leg, scene.grid) > most_m:
        return False
    left, right = min(part.box[0], leg.box[0]), max(part.box[2], leg.box[2])
    return right - left < _STRIDE_M * scene.grid.per_metre(leg.disparity)


def at_hips(segment: Segment, scene: DenseScene) -> Segment:
    """Return a segment of legs, located by the top of the legs.

    There they swing least, and the middle between their outer edges is that of the hips. The
    disparity is midway between both legs': the median would leap from one to the other.
    """
    hips = segment_of(scene, segment.mask, _HIPS_SHARE)
    left, _, right = hips.columns
    disparity = scene.disparity[segment.mask]
    far, near = np.quantile(disparity[np.isfinite(disparity)], _DEPTHS)
    return replace(
        segment,
        disparity=float(far + near) / 2,
        columns=(left, (left + right) / 2, right),
        cut=(*hips.cut[:2], *segment.cut[2:]),
    )


def swing_cov(along: Float64Array) -> Float64Array:
    """(3, 3) m^2: covariance of a leg's swing from the hips, across the line of sight.

    Args:
        along: (3, 3) the projection onto the line of sight.
    """
    return np.asarray((_EYE - along) * _SWING_M**2)
