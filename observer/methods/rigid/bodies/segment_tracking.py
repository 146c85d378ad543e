"""Bodies by their segments: they are found, followed, measured, and given their points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from observer.methods.rigid.bodies.beginning import (
    OWN_SHARE,
    bodies_of,
    motion_at,
    stands_alone,
    start_track,
)
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.cells_around import cells_around
from observer.methods.rigid.bodies.filter import POSITION, VELOCITY
from observer.methods.rigid.bodies.groups import mostly_lie
from observer.methods.rigid.bodies.legs import at_hips, shows_only_legs, swing_cov
from observer.methods.rigid.bodies.limbs import judge_rigidity, points_show_whole
from observer.methods.rigid.bodies.outline import (
    MOST_DEPTH_M,
    Outline,
    anchor_of,
    free_cells,
    measured_anchor,
)
from observer.methods.rigid.bodies.segment_gate import has_left, leaps
from observer.methods.rigid.bodies.shape import Box
from observer.methods.rigid.bodies.side_by_side import (
    nearest_first,
    part_off,
    parted,
    separated,
    spanning,
)
from observer.methods.rigid.bodies.trunk_motion import measure_trunk
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.fine_disparity import refined
from observer.methods.rigid.dense.ground import tells_approach
from observer.methods.rigid.dense.people import whole_person, with_head
from observer.methods.rigid.dense.scene import DenseScene
from observer.methods.rigid.dense.segments import (
    Expected,
    Mask,
    Segment,
    followed_segment,
    fresh_segments,
    is_small,
    owners,
    widened,
)
from observer.methods.rigid.point_motion import PooledMotion
from observer.methods.rigid.tracked_points import TrackedPoints, WorldSightings
from observer.robust import median
from observer.types import TrackState
from observer.vision.lifecycle import NO_OBSTACLE, TrackIds, is_provisional

# Members from which a body's segment is looked for where they are.
_LEAST_MEMBERS = 3
# Share of a body's members that must be at or beside cells near enough to be judged.
_NEAR_SHARE = 0.5
# Frames since a body was seen, below which it is followed rather than found again.
_SEEN_BEFORE = 1.5
# Cells at the border of an outline that may show the background, as edges in depth are not sharp.
_BORDER_CELLS = 2
# Frames in a row for which a gap in a body must be seen before it is two bodies.
_GAP_FRAMES = 2
# Gain with which a body's middle follows the newest frame.
_MIDDLE_GAIN = 0.3
# Metres, lasting error of a segment's depth: the points on it tell changes better.
_DEPTH_DRIFT_M = 0.08


def track_segments(
    tracks: list[BodyTrack],
    points: TrackedPoints,
    scene: DenseScene,
    now: CameraStep,
    numbers: TrackIds,
    min_points: int,
) -> TrackedPoints:
    """Measure the bodies by their segments, begin new ones, and tell on which one points are seen.

    Args:
        tracks: already predicted, and measured by their points; new ones are added, and those that
            turn out to be parts of others removed. min_points: with fewer a body is not seen.
    """
    _follow(tracks, points, scene, now, numbers)
    cells = scene.grid.at(points.px)
    obstacle = points.obstacle.copy()
    free = free_cells([t.outline for t in tracks if t.outline is not None], scene.grid)
    for segment in separated(fresh_segments(scene, free), scene):
        small = is_small(scene, segment)
        if small and not stands_alone(segment, tracks, scene):
            continue
        if any(
            track.seen_outline.take(segment, scene, track.heading)
            for track in tracks
            if track.seen_outline is not None
        ):
            continue
        inside = segment.mask[cells]
        # A small segment is no larger body that comes back.
        likely = [t for t in tracks if not small or t.outline is None or t.outline.is_small]
        found = bodies_of(segment, inside, likely, obstacle, scene, min_points)
        if not found:
            pair = spanning(segment, inside, tracks, obstacle, scene)
            if pair is not None:
                track, own = pair
                obstacle[inside & (obstacle == track.id)] = NO_OBSTACLE
                tracks.append(part_off(track, own, segment, scene, numbers))
                continue
            whole = whole_person(scene, segment, free)
            track = start_track(numbers.provisional(), whole, scene)
            track.part_moves = whole is not segment
            tracks.append(track)
            continue
        if found[0].outline is None:
            segment = _first_seen(found[0], segment, scene, free)
        _measure(found[0], segment, scene)
        for part in found[1:]:
            obstacle[obstacle == part.id] = NO_OBSTACLE
            tracks.remove(part)
    for track in tracks:
        if track.seen_outline is None:
            _note_merged(track, points, scene, now.dt)
    return _absorbed(tracks, noted_within(points.but(obstacle=obstacle), tracks))


def without_segments(
    tracks: list[BodyTrack], points: TrackedPoints, now: CameraStep
) -> TrackedPoints:
    """Carry the bodies on in a frame without depth, and tell on which one points are seen.

    For a while the bodies count as seen.
    """
    for track in tracks:
        outline = track.outline
        if outline is None:
            continue
        outline.carry(track.mean[POSITION], track.mean[VELOCITY], now.T_camera_world, now.dt)
        if outline.seen:
            track.missed_s = 0.0
    return noted_within(points, tracks)


def noted_within(points: TrackedPoints, tracks: list[BodyTrack]) -> TrackedPoints:
    """Return the points, each with the number of the body on whose outline it is seen."""
    within = np.full(len(points), NO_OBSTACLE, np.int64)
    for track in tracks:
        outline = track.seen_outline
        if outline is not None:
            within[outline.segment.mask[outline.grid.at(points.px)]] = track.id
    return points.but(within=within)


def measure_limbs(
    tracks: list[BodyTrack],
    points: TrackedPoints,
    sightings: WorldSightings,
    motion: PooledMotion,
    scene: DenseScene,
    dt: float,
) -> TrackedPoints:
    """Tell bodies with limbs from rigid ones, and measure the former by their trunks."""
    obstacle = points.obstacle.copy()
    for track in tracks:
        if track.outline is None:
            continue
        if not track.outline.seen:
            track.outline.lose_trunk()
            continue
        on_body = _surely_on(track.outline, track.id, points, scene)
        track.outline.only_legs = shows_only_legs(track.outline.segment, scene)
        track.outline.legs_seen |= track.outline.only_legs
        judge_rigidity(track, obstacle[on_body[motion.judged[on_body]]] == track.id)
        if not track.rigid:
            obstacle[obstacle == track.id] = NO_OBSTACLE
            track.points = len(on_body)
            measure_trunk(track, on_body, points, sightings, scene, dt)
    return points.but(obstacle=obstacle)


def learn_box(track: BodyTrack) -> None:
    """Learn the box of a body that its outline shows better than its points do."""
    outline = track.outline
    assert outline is not None
    if not outline.seen:
        return
    centre = track.local(outline.middle)
    if track.box is not None:
        centre = track.box.centre + _MIDDLE_GAIN * (centre - track.box.centre)
    depth = min(outline.width, MOST_DEPTH_M)
    track.box = Box(centre, np.array([outline.width, outline.height, depth]), 0.0)
    track.box_px = outline.box_px


def shown_by_points(track: BodyTrack) -> bool:
    """Return whether a body's points, rather than its outline, tell its box."""
    return track.outline is None or (track.outline.seen and points_show_whole(track, track.outline))


# --- following -------------------------------------------------------------------------------


def _follow(
    tracks: list[BodyTrack],
    points: TrackedPoints,
    scene: DenseScene,
    now: CameraStep,
    numbers: TrackIds,
) -> None:
    """Find each body's segment where it is expected; cells go to the likeliest body."""
    expected: list[tuple[BodyTrack, Expected]] = []
    outlined = [t for t in tracks if t.outline is not None]
    outlined.sort(key=lambda t: (t.state is TrackState.TENTATIVE, _depth(t, now)))
    for track in outlined:
        assert track.outline is not None
        track.outline.seen = False
        where = track.outline.expected(track.mean[POSITION], now.T_camera_world, scene.grid)
        if where is not None:
            expected.append((track, where))
    for track in [t for t in tracks if t.outline is None and t.points >= _LEAST_MEMBERS]:
        where = _by_members(track, points, scene)
        if where is not None:
            expected.append((track, where))
    owner = owners(scene, [where for _, where in expected])
    free = np.ones(scene.grid.shape, np.bool_)
    for number, (track, where) in enumerate(expected):
        core = owner == number
        grows = track.outline is None or not track.outline.is_static
        small = track.outline is not None and track.outline.is_small
        mine = free & (core | (owner < 0))
        segment = followed_segment(scene, where, core, mine, grows=grows, small=small)
        if segment is None:
            continue
        if track.outline is None and (segment.is_separate or track.crosses):
            # What crosses the view but does not stand apart may be a head.
            segment = _first_seen(track, segment, scene, free)
        found = track.outline is None or track.missed_s > _SEEN_BEFORE * now.dt
        if found and not segment.is_separate:
            continue
        if track.outline is not None and leaps(track, segment, scene):
            continue
        if grows and not track.rigid:
            segment = with_head(scene, segment, (free & (owner < 0)) | segment.mask)
        free &= ~segment.mask
        if track.outline is not None:
            halves = parted(segment, scene)
            track.outline.gap_frames = track.outline.gap_frames + 1 if halves else 0
            if halves and track.outline.gap_frames > _GAP_FRAMES:
                own, other = nearest_first(halves, track, scene)
                tracks.append(part_off(track, own, other, scene, numbers))
                continue
        _measure(track, segment, scene)


def _depth(track: BodyTrack, now: CameraStep) -> float:
    return float(np.linalg.norm(track.mean[POSITION] - now.position))


def _by_members(track: BodyTrack, points: TrackedPoints, scene: DenseScene) -> Expected | None:
    """Return where its members say that a body should be seen; None if they are few."""
    members = _seen_members(track, points)
    if len(members) < _LEAST_MEMBERS:
        return None
    rows, columns = scene.grid.at(points.px[members])
    mask = np.zeros(scene.grid.shape, np.bool_)
    mask[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
    return Expected(mask, median(points.disparity[members]))


def _note_merged(track: BodyTrack, points: TrackedPoints, scene: DenseScene, dt: float) -> None:
    """Note that a body's members are seen, but no segment: it is merged with its surroundings."""
    members = _seen_members(track, points)
    if len(members) < _LEAST_MEMBERS:
        return
    rows, columns = scene.grid.at(points.px[members])
    judged = widened(scene.near, 1)[rows, columns].mean() > _NEAR_SHARE
    typical = median(points.disparity[members])
    track.far = not tells_approach(typical, scene.grid, flickers=scene.light.flickers)
    stands = scene.standing[rows, columns] | np.isnan(scene.disparity[rows, columns])
    track.off_ground = not mostly_lie(~stands)
    if scene.ground is not None:
        px, disparity = points.px[members], points.disparity[members]
        pose, camera = scene.T_camera_world, scene.grid.camera
        track.lies = mostly_lie(scene.ground.carries(px, disparity, pose, camera))
    if judged or track.lies:
        track.merged_s += dt
    elif not track.far:
        track.merged_s = max(0.0, track.merged_s - dt)


def _seen_members(track: BodyTrack, points: TrackedPoints) -> NDArray[np.intp]:
    return np.flatnonzero((points.obstacle == track.id) & np.isfinite(points.disparity))


def _first_seen(track: BodyTrack, part: Segment, scene: DenseScene, free: Mask) -> Segment:
    """Return the segment of a body that was known only by its members.

    If they are on a head or an arm, the body is the whole person, who may not move as they do.
    """
    whole = whole_person(scene, part, free)
    if whole is not part:
        whole = refined(whole, scene)
        place, cov = measured_anchor(whole, anchor_of(whole), scene)
        track.filter = motion_at(place, np.zeros(3), cov)
        track.hits = track.sightings = 0
        track.part_moves = True
        track.loosen()
    return whole


def _measure(track: BodyTrack, segment: Segment, scene: DenseScene) -> None:
    """Move a body to where its segment is seen, unless its points measure that better."""
    if track.outline is None:
        track.outline = Outline.of(segment, scene)
        if track.outline.upright and not points_show_whole(track, track.outline):
            track.loosen()
    outline = track.outline
    by_segment = not track.rigid or not track.by_points
    if outline.only_legs:
        shown = at_hips(segment, scene)
    else:
        shown = refined(segment, scene) if by_segment else segment
    anchor = anchor_of(shown)
    place, cov = measured_anchor(shown, anchor, scene)
    if outline.only_legs and anchor != "middle":
        cov = cov + swing_cov(scene.along_sight(place))
    if track.forgotten and not track.rigid:
        outline.offsets.clear()
        before = np.zeros(3) if has_left(track, scene) else track.mean[VELOCITY]
        track.filter = motion_at(place, before, cov)
    if outline.depth_by_points and not outline.depths.measured:
        # Points told changes of depth only: meanwhile the body went from where its segment is.
        outline.offsets.clear()
    outline.depth_by_points = outline.depths.measured
    if by_segment:
        # When a new anchor takes over, the body is assumed to be where it was expected.
        offset = outline.offsets.setdefault(anchor, place - track.mean[POSITION])
        if outline.depths.measured:
            cov = cov + scene.along_sight(place) * _DEPTH_DRIFT_M**2
        track.filter = track.filter.with_position(place - offset, cov)
        if track.filter.manoeuvres:
            track.steady_s = 0.0
    else:
        # Its points measure it, and its origin moves: once they are too few it goes on from there.
        outline.offsets.clear()
    segment = replace(segment, disparity=shown.disparity, fine=shown.fine)
    outline.note(segment, track.mean[POSITION], scene, track.age_s)
    track.missed_s = track.merged_s = 0.0
    track.far = False


# --- points ----------------------------------------------------------------------------------


def _absorbed(tracks: list[BodyTrack], points: TrackedPoints) -> TrackedPoints:
    """Drop bodies whose points lie on another body's outline: they were parts of it."""
    obstacle, within = points.obstacle.copy(), points.within.copy()
    for part in [t for t in tracks if t.outline is None]:
        members = obstacle == part.id
        if not members.any():
            continue
        hosts, counts = np.unique(within[members], return_counts=True)
        most = int(np.argmax(counts))
        host = next((t for t in tracks if t.id == hosts[most]), None)
        if host is None or counts[most] <= OWN_SHARE * np.count_nonzero(members):
            continue
        obstacle[members] = NO_OBSTACLE
        tracks.remove(part)
        if is_provisional(host.id) and not is_provisional(part.id):
            # A body that was reported keeps its number.
            within[within == host.id] = part.id
            obstacle[obstacle == host.id] = part.id
            host.id, host.state = part.id, part.state
    return points.but(obstacle=obstacle, within=within)


def _surely_on(
    outline: Outline, number: int, points: TrackedPoints, scene: DenseScene
) -> NDArray[np.intp]:
    """(K,) the points that lie well inside an outline, at its depth."""
    segment = outline.segment
    off = np.abs(points.disparity - segment.disparity)
    near = off < scene.tolerance(segment.disparity)
    on_it = np.flatnonzero((points.within == number) & near)
    around = cells_around(scene.grid, points.px.take(on_it, axis=0), _BORDER_CELLS)
    return on_it[segment.mask[around].all(axis=1)]
