"""Bodies that are found by their segments: new ones, and those that were out of sight."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, BodyFilter
from observer.methods.rigid.bodies.outline import Outline, anchor_of, measured_anchor
from observer.methods.rigid.bodies.segment_gate import leaps, misfit
from observer.methods.rigid.bodies.shape import BodyShape
from observer.methods.rigid.dense.fine_disparity import refined
from observer.methods.rigid.dense.height import bottom_height
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import SEGMENT_M2, Segment, is_small, least_cells
from observer.types import TrackState

# m/s, one standard deviation: horizontal and vertical speed of a body that was just found.
_FIRST_MPS, _FIRST_UP_MPS = 1.0, 0.1
# A segment is a body's if this share of its members lies on it.
OWN_SHARE = 0.5
# Metres: highest lower end, above the ground, of a small body, and least distance from larger ones,
# whose parts move on their own.
_STANDS_M, _PART_M = 0.15, 1.2
# Metres around and above a small body, and tolerances of its disparity, within which nothing larger
# may stand, whether it moves or not.
_BESIDE_M, _ABOVE_M, _BESIDE_TOLERANCES = 0.6, 1.5, 1.5


def start_track(
    number: int, segment: Segment, scene: DenseScene, sigma_mps: float = _FIRST_MPS
) -> BodyTrack:
    """Return the track of a body with limbs that was found as a segment.

    Args:
        sigma_mps: one standard deviation of its speed.
    """
    segment = refined(segment, scene)
    anchor = anchor_of(segment)
    place, cov = measured_anchor(segment, anchor, scene)
    track = BodyTrack(
        id=number,
        filter=motion_at(place, np.zeros(3), cov, sigma_mps),
        shape=BodyShape(),
        outline=Outline.of(segment, scene),
        rigid=False,
        rigidity=0.0,
    )
    assert track.outline is not None
    track.outline.found_small = is_small(scene, segment)
    track.outline.offsets[anchor] = np.zeros(3)
    track.outline.note(segment, place, scene, track.age_s)
    return track


def motion_at(
    place: Float64Array, velocity: Float64Array, cov: Float64Array, sigma_mps: float = _FIRST_MPS
) -> BodyFilter:
    """Return the motion of a body at a place (3,) m, world, with covariance (3, 3).

    Args:
        velocity: (3,) m/s, the likeliest. sigma_mps: one standard deviation of it, horizontally.
    """
    spread = np.diag([sigma_mps, _FIRST_UP_MPS, sigma_mps]) ** 2
    return BodyFilter.begin(place, velocity, cov, spread, 0.0).straightened()


def stands_alone(segment: Segment, tracks: list[BodyTrack], scene: DenseScene) -> bool:
    """Return whether a small segment stands on the ground and is no part of something larger.

    Limbs, wheels and reflections are small and move, too, even those of a person who stands; where
    the ground is unknown it may be any of these.
    """
    if scene.ground is None or bottom_height(segment, scene, scene.ground) > _STANDS_M:
        return False
    if _stands_beside_larger(segment, scene):
        return False
    place, _ = measured_anchor(segment, "middle", scene)
    larger = [t for t in tracks if t.outline is None or not t.outline.is_small]
    away = [t.mean[POSITION] - place for t in larger]
    return all(np.hypot(x, z) >= _PART_M for x, _, z in away)


def _stands_beside_larger(segment: Segment, scene: DenseScene) -> bool:
    """Return whether a small segment may be a part of something larger at its distance."""
    left, top, right, bottom = segment.box
    per_metre = scene.grid.per_metre(segment.disparity)
    reach, above = round(_BESIDE_M * per_metre), round(_ABOVE_M * per_metre)
    window = slice(max(0, top - above), bottom + 1), slice(max(0, left - reach), right + reach)
    off = np.abs(scene.disparity[window] - np.float32(segment.disparity))
    same = off <= _BESIDE_TOLERANCES * scene.tolerance(segment.disparity)
    other = scene.standing[window] & ~segment.mask[window]
    return bool(np.count_nonzero(same & other) >= least_cells(scene, SEGMENT_M2, segment.disparity))


def bodies_of(
    segment: Segment,
    inside: NDArray[np.bool_],
    tracks: list[BodyTrack],
    obstacle: NDArray[np.int64],
    scene: DenseScene,
    min_points: int,
) -> list[BodyTrack]:
    """List the bodies that a new segment shows, the surest first: they are all one body.

    But of several that were reported, and may have come back, it shows only the likeliest.

    Args:
        inside: (N,) which points lie on it. obstacle: (N,) as of ``TrackedPoints``.
    """
    found = []
    for track in [t for t in tracks if t.seen_outline is None]:
        members = obstacle == track.id
        count = np.count_nonzero(members)
        on_it = count >= min_points and inside[members].mean() >= OWN_SHARE
        on_it = on_it and not (track.outline is not None and leaps(track, segment, scene))
        # A body with limbs is out of sight without its outline, whatever points are seen.
        hidden = track.missed_s > 0 or not track.rigid
        apart = misfit(track, segment, scene) if hidden else None
        if on_it or apart is not None:
            tentative = track.state is TrackState.TENTATIVE
            rank = (tentative, -track.points if on_it else 0, apart or 0.0)
            found.append((rank, on_it or tentative, track))
    found.sort(key=lambda each: each[0])
    return [track for k, (_, part, track) in enumerate(found) if k == 0 or part]
