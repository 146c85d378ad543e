"""People who walk side by side are two bodies, however alike they move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.bodies.beginning import start_track
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY, BodyFilter
from observer.methods.rigid.dense.ground import GroundPlane
from observer.methods.rigid.dense.height import stands, top_height
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import Segment, extent_m, is_high, segment_of
from observer.vision.lifecycle import TrackIds

# Metres above the ground: what reaches higher is more than legs, between which there is a gap too.
_LEAST_TOP_M = 1.0
# A gap at least this wide, up to at least this height, metres, is not one between somebody's legs.
_WIDE_GAP_M, _LEAST_TOP_BESIDE_IT_M = 0.35, 0.6
# Metres, least width of a person seen from any side, and of one who leaves the view.
_LEAST_WIDTH_M, _LEAST_PART_M = 0.2, 0.1
# Points of a body on another segment from which the two may be two people.
_LEAST_POINTS = 3
# Least width of the gap between two, metres and cells.
_LEAST_GAP_M, _LEAST_GAP_CELLS = 0.08, 3
# Share of a segment's rows that its cells may fill in a gap, as depth is smeared at the image's
# border; and share of the gap's known cells in which something farther must be seen.
_FILLED_SHARE, _FARTHER_SHARE = 0.15, 0.6
# Metres: a trunk this wide is that of two, whose arms may fill this share of the gap's rows.
_WIDER_THAN_ONE_M, _ARMS_SHARE = 1.0, 0.5


def parted(segment: Segment, scene: DenseScene) -> tuple[Segment, Segment] | None:
    """Return the segments of two people, left and right of a gap; None if there is only one.

    The scene must be seen farther in most of the gap, and both must reach higher than legs do. If
    the view ends below that, the gap must be wider than between legs.
    """
    gap = _gap(segment, scene)
    if gap is None or scene.ground is None:
        return None
    _, _, cut_at_top, _ = segment.cut
    least = _WIDE_GAP_M * scene.grid.per_metre(segment.disparity)
    wide = cut_at_top and gap.stop - gap.start >= least
    halves = []
    for columns in (slice(0, gap.start), slice(gap.stop, None)):
        mask = np.zeros_like(segment.mask)
        mask[:, columns] = segment.mask[:, columns]
        half = segment_of(scene, mask)
        if not _may_be_person(half, scene, scene.ground, beside_wide_gap=wide):
            return None
        halves.append(half)
    return halves[0], halves[1]


def separated(segments: list[Segment], scene: DenseScene) -> list[Segment]:
    """List segments, and instead of one that shows two people each of them."""
    found: list[Segment] = []
    for segment in segments:
        halves = parted(segment, scene)
        apart = halves is not None and all(half.is_separate for half in halves)
        found += halves if halves is not None and apart else [segment]
    return found


def spanning(
    segment: Segment,
    inside: NDArray[np.bool_],
    tracks: list[BodyTrack],
    obstacle: NDArray[np.int64],
    scene: DenseScene,
) -> tuple[BodyTrack, Segment] | None:
    """Return a body that is two people: some of its points lie on a new segment beside its own.

    Returns:
        The body and its own segment; None if there is no such body.

    Args:
        inside: (N,) which points lie on the new segment. obstacle: (N,) as of ``TrackedPoints``.
    """
    for track in tracks:
        outline = track.seen_outline
        if outline is None or not track.rigid:
            continue
        if np.count_nonzero(inside & (obstacle == track.id)) < _LEAST_POINTS:
            continue
        both = segment_of(scene, segment.mask | outline.segment.mask)
        if parted(both, scene) is not None:
            return track, outline.segment
    return None


def nearest_first(
    halves: tuple[Segment, Segment], track: BodyTrack, scene: DenseScene
) -> tuple[Segment, Segment]:
    """Return the segments of two people, first the one that is nearer to a body's own origin.

    A body of one person whose segment has grown over another one keeps its number.
    """
    place = scene.T_camera_world.apply(track.mean[None, POSITION])
    column = float(scene.grid.to_cells(scene.grid.camera.project(place)[0])[0, 0])
    own, other = sorted(halves, key=lambda half: abs(half.columns[1] - column))
    return own, other


def part_off(
    track: BodyTrack, own: Segment, other: Segment, scene: DenseScene, numbers: TrackIds
) -> BodyTrack:
    """Keep one segment for a body, and return the track of another body that moves like it.

    Both keep the state and the velocity, which was that of either; positions are measured again.

    Args:
        own, other: the segments of the two. numbers: gives the other its number.
    """
    twin = start_track(numbers.provisional(), other, scene)
    kept = start_track(track.id, own, scene)
    velocity, cov = track.mean[VELOCITY], track.filter.covariance[VELOCITY, VELOCITY]
    for each in (twin, kept):
        place, place_cov = each.mean[POSITION], each.filter.covariance[POSITION, POSITION]
        each.filter = BodyFilter.begin(place, velocity, place_cov, cov, 0.0).straightened()
    twin.state, twin.motion, twin.age_s = track.state, track.motion, track.age_s
    twin.hits, twin.sightings = track.hits, track.sightings
    track.become(kept)
    if track.confirmed_at is not None:
        track.confirmed_at, twin.confirmed_at = track.centre, twin.centre
    return twin


def _gap(segment: Segment, scene: DenseScene) -> slice | None:
    """Return the columns of the widest gap in a segment, away from its sides; None without one."""
    per_metre = scene.grid.per_metre(segment.disparity)
    side = max(2, round(_LEAST_WIDTH_M * per_metre))
    left, top, right, bottom = segment.box
    if right - left < 2 * side:
        return None
    filled = segment.mask[top:bottom, left + side : right - side].sum(axis=0)
    trunk_m = (segment.columns[2] - segment.columns[0]) / per_metre
    shares = [_FILLED_SHARE] if trunk_m < _WIDER_THAN_ONE_M else [_FILLED_SHARE, _ARMS_SHARE]
    least = max(_LEAST_GAP_CELLS, round(_LEAST_GAP_M * per_metre))
    for share in shares:
        start, end = _longest_run(filled <= share * (bottom - top))
        gap = slice(left + side + start, left + side + end)
        if end - start >= least and _is_farther(scene, segment, slice(top, bottom), gap):
            return gap
    return None


def _is_farther(scene: DenseScene, segment: Segment, rows: slice, columns: slice) -> bool:
    """Return whether something farther than a segment is seen in most of a gap.

    The ground before and between the feet is as near as they are, and tells nothing.
    """
    others = ~segment.mask[rows, columns]
    disparity = scene.disparity[rows, columns][others]
    farther = disparity < segment.disparity - scene.tolerance(segment.disparity)
    told = farther | scene.standing[rows, columns][others]
    seen = np.count_nonzero(told)
    return bool(seen > 0 and np.count_nonzero(farther) >= _FARTHER_SHARE * seen)


def _may_be_person(
    segment: Segment, scene: DenseScene, ground: GroundPlane, *, beside_wide_gap: bool
) -> bool:
    """Return whether a segment is large enough for a person, and reaches higher than legs do.

    A raised arm is too small, and so is a box that a person carries. Beside a wide gap, less is
    enough for what stands on the ground: close by, a low camera sees only the legs of people.
    """
    width_m, _ = extent_m(segment, scene.grid)
    top_m = top_height(segment, scene, ground)
    if beside_wide_gap:
        large = width_m >= _LEAST_PART_M and top_m >= _LEAST_TOP_BESIDE_IT_M
        return large and stands(segment, scene, ground)
    large = width_m >= _LEAST_WIDTH_M and is_high(segment, scene.grid)
    return large and top_m >= _LEAST_TOP_M


def _longest_run(flags: NDArray[np.bool_]) -> tuple[int, int]:
    """Return the first index of the longest run of true flags (N,), and that after its last."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    if len(edges) == 0:
        return 0, 0
    longest = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * longest]), int(edges[2 * longest + 1])
