"""The life of one obstacle: whether it moves, when it is confirmed, when it ends."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array, largest_sigma, mahalanobis
from observer.methods.rigid.bodies.body import BodyTrack
from observer.methods.rigid.bodies.filter import VELOCITY
from observer.methods.rigid.dense.grey_change import Light
from observer.parameters import ObstacleParameters
from observer.types import MotionState, TrackState
from observer.vision.lifecycle import expired, next_state

# A velocity below the first is no more than noise. A body known to move that does more than creep
# must fall below the second to be at rest: that its speed became uncertain tells nothing.
_MOVING_SIGMAS, _STILL_SIGMAS = 3.0, 2.0
# m/s, a walking speed: while even that would not be significant, a body is not taken to have
# stopped, for so many seconds.
_WALKS_MPS, _UNSURE_S = 1.0, 0.5
# Members that moved, beyond the first two in each frame, summed over frames, that confirm an
# obstacle: the errors of two or three on one edge are alike.
_CONFIRM_SIGHTINGS = 16
_ALIKE = 2
# Seconds: a tentative track that was not seen for so long, or has not moved significantly so long
# after it began, ends.
_TENTATIVE_COAST_S = 0.15
_PATIENCE_S = 0.5
# The latter for one that was seen as a segment.
_OUTLINE_PATIENCE_S = 1.5
# Seconds after which a body that is reported is no mistake.
_LONG_S = 1.0
# Seconds for which a body may be merged with its surroundings.
_MERGED_S = 1.0
# So many points that stand out of the ground and move alike are a body, even if it is merged with
# its surroundings.
_MANY_POINTS = 12
# Share of a body's points that may match as well elsewhere.
_WRONG_SHARE = 0.5
# Points that do not all lie on one edge.
_SEVERAL_POINTS = 6
# Frames in a row for which a segment may idle, see ``Outline.count_idle``.
_IDLE_FRAMES = 3
# A segment that stood for so many seconds and never left its place only seemed to move.
_STOOD_S = 0.7
# A body creeps below so many times the speed at which it counts as stopped; it is unmoved if so
# much of it is static.
_CREEPING, _UNMOVED_SHARE = 3.0, 0.95
# Pixels: the windows in which points are matched also show what is behind anything narrower, and
# the mixture seems to approach or recede.
_WINDOW_PX = 15.0
# A body crosses the view if at least this share of its velocity is across the line of sight.
_ACROSS_SHARE = 0.5
# Where light flickers, a body that is slower than so many times the stopped speed may stand, unless
# it crosses the view.
_SLOW_IN_FLICKER = 8.0
# A body that shows this share of itself where nothing was a moment ago still goes on.
_ENTERS_SHARE = 0.6
# Frames in which a segment must have entered free space, or been uncovered, and standard deviations
# of its velocity. A body that goes away is uncovered by itself. What others uncover seems to move
# across the view as they do, so this share of the velocity must lead away.
_ARRIVED_FRAMES, _ARRIVED_SIGMAS = 3, 3.0
_UNCOVERED_FRAMES, _UNCOVERED_SIGMAS, _AWAY_SHARE = 4, 5.0, 0.7
# m/s: nobody runs away faster, but the depth beside something nearer may change as fast.
_MOST_AWAY_MPS = 3.0
_STEADY = Light()


def judge(
    track: BodyTrack,
    camera_position: Float64Array,
    dt: float,
    parameters: ObstacleParameters,
    *,
    light: Light = _STEADY,
) -> None:
    """Judge whether a track moves, and whether it is confirmed, coasts or is seen again.

    Args:
        camera_position: (3,) metres, world. dt: seconds since the last frame. light: how it
            changes.
    """
    velocity, cov = track.centre_velocity()
    track.significance = mahalanobis(velocity, cov)
    speed = float(np.linalg.norm(velocity))
    sigma = _sigma_along(velocity, cov)
    track.unsure_s = 0.0 if track.significance >= _STILL_SIGMAS else track.unsure_s + dt
    track.motion = _motion(track, speed, sigma, parameters.stopped_below_mps)
    track.stood_s = track.stood_s + dt if track.motion is MotionState.STOPPED else 0.0
    if track.significance >= parameters.confirm_sigmas:
        track.part_moves = False
    seen = track.missed_s == 0
    tentative = track.state is TrackState.TENTATIVE
    confirmed = seen and tentative and _confirmed(track, camera_position, parameters, light)
    if confirmed and track.motion is MotionState.MOVING:
        track.confirmed_at = track.centre
    elif seen and track.confirmed_at is not None and _is_away(track, track.confirmed_at):
        # A body that went away and came back did move.
        track.confirmed_at = None
    track.state = next_state(track.state, seen=seen, confirmed=confirmed)


def _motion(track: BodyTrack, speed: float, sigma: float, limit: float) -> MotionState:
    """Return how a track moves now: as before, unless the velocity says otherwise.

    Args:
        speed, sigma: m/s, and one standard deviation along the velocity. limit: m/s, below which
            it has stopped.
    """
    reported = track.state is not TrackState.TENTATIVE
    moved = reported and track.motion is MotionState.MOVING
    least = _STILL_SIGMAS if moved and speed > _CREEPING * limit else _MOVING_SIGMAS
    if speed >= limit and track.significance >= least:
        return MotionState.MOVING if speed - sigma > limit else track.motion
    if moved and speed > _CREEPING * limit and _enters(track):
        return track.motion
    # Out of sight only the certainty fades, and likewise for a moment after limbs were taken for
    # the body. But a body that fills the same cells as before stands, however uncertain its
    # velocity.
    unsure = sigma > _WALKS_MPS / _MOVING_SIGMAS and track.unsure_s < _UNSURE_S
    if reported and (track.missed_s > 0 or unsure) and not _is_unmoved(track):
        return track.motion
    return MotionState.IN_PLACE if track.changes.recurring else MotionState.STOPPED


def _sigma_along(velocity: Float64Array, cov: Float64Array) -> float:
    """Return one standard deviation, m/s, along a velocity (3,); the largest one if that is 0."""
    speed = float(np.linalg.norm(velocity))
    if speed == 0.0:
        return largest_sigma(cov)
    direction = velocity / speed
    return float(np.sqrt(direction @ cov @ direction))


def _is_unmoved(track: BodyTrack) -> bool:
    """Return whether all of a body is seen where something was before."""
    outline = track.seen_outline
    return outline is not None and outline.segment.static >= _UNMOVED_SHARE


def _enters(track: BodyTrack) -> bool:
    """Return whether most of a body is seen where nothing was a moment ago."""
    outline = track.seen_outline
    return outline is not None and outline.segment.arrived >= _ENTERS_SHARE


def is_over(track: BodyTrack, parameters: ObstacleParameters) -> bool:
    """Return whether a track is to end."""
    tentative = track.state is TrackState.TENTATIVE
    unmoved = tentative and track.hits == 0
    patience = _PATIENCE_S if track.outline is None else _OUTLINE_PATIENCE_S
    hopeless = unmoved and track.age_s > patience
    outline = track.outline
    if outline is not None:
        moves = outline.depths.measured and track.significance >= _MOVING_SIGMAS
        may_stand = track.part_moves or moves
        if outline.count_idle(tentative=unmoved, may_stand=may_stand) > _IDLE_FRAMES:
            return True
    # A body that stood apart once may drive along a wall.
    known = outline is not None or _shown_by_many(track)
    drives = track.motion is MotionState.MOVING and known
    hopeless |= track.merged_s > _MERGED_S and not drives
    hopeless |= track.stood_s > _STOOD_S and _never_left(track)
    coast, patience = parameters.coast_s, _TENTATIVE_COAST_S
    return hopeless or expired(track.state, track.missed_s, coast=coast, patience=patience)


def moves_apart(track: BodyTrack) -> bool:
    """Return whether a body that has been known for a while moves, seen before its surroundings.

    One that has just stopped counts as moving: it may seem so because a few frames gave a wrong
    motion of the camera, which would be confirmed if the body counted as background.
    """
    moves = track.state is TrackState.CONFIRMED and track.stood_s < _LONG_S
    apart = track.seen_outline is not None and track.merged_s == 0 and track.off_ground
    return moves and apart and track.age_s >= _LONG_S


def _confirmed(
    track: BodyTrack,
    camera_position: Float64Array,
    parameters: ObstacleParameters,
    light: Light,
) -> bool:
    """Count this frame's evidence, and return whether it is enough to confirm a track.

    It must move significantly in enough frames and points: the fewer points, the longer.
    """
    # Less is enough for a person of whom only a part, or only points on a limb, was seen to move.
    person = track.part_moves or track.loosened
    least_sigmas = _MOVING_SIGMAS if person else parameters.confirm_sigmas
    moves = track.significance >= least_sigmas
    if moves and track.motion is MotionState.MOVING:
        track.hits += 1
        track.sightings += max(0, track.points - _ALIKE)
    else:
        track.hits = max(0, track.hits - 1)
    by_points = track.hits >= parameters.confirm_hits and track.sightings >= _CONFIRM_SIGHTINGS
    surely = by_points and not _creeps(track, parameters)
    track.crosses = surely and _crosses(track, camera_position)
    far = track.far and not track.lies
    shown = far or track.merged_s == 0 or _shown_by_many(track)
    wrong = track.wrong_match is not None and track.wrong_match > _WRONG_SHARE
    shown &= not wrong and not track.among_static
    if wrong and track.points >= _SEVERAL_POINTS:
        # Dense depth is matched as wrongly as so many points are.
        return False
    if by_points and shown and not _may_stand(track, camera_position, parameters, light):
        return True
    if track.motion is MotionState.IN_PLACE:
        return track.outline is not None and track.outline.segment.is_separate
    return _confirmed_by_outline(track, camera_position, parameters, light)


def _never_left(track: BodyTrack) -> bool:
    """Return whether a body known by its segment alone is still where it was confirmed.

    Segments of static things change from frame to frame, and so do their middles.
    """
    if track.confirmed_at is None or track.outline is None or track.box is None:
        return False
    return not _shown_by_many(track) and not _is_away(track, track.confirmed_at)


def _is_away(track: BodyTrack, place: Float64Array) -> bool:
    """Return whether a body is farther from a place (3,) m, world, than it is wide."""
    if track.box is None:
        return False
    moved_m = float(np.linalg.norm(track.centre - place))
    return moved_m >= float(track.box.size[[0, 2]].max())


def _shown_by_many(track: BodyTrack) -> bool:
    """Return whether a body is seen by so many members that it needs no segment of its own."""
    return track.off_ground and track.points >= _MANY_POINTS


def _may_stand(
    track: BodyTrack,
    camera_position: Float64Array,
    parameters: ObstacleParameters,
    light: Light,
) -> bool:
    """Return whether a body may stand although its points move.

    A body that crosses the view covers free space and uncovers what it hid. If a person does not,
    the points slide over something static. Along the line of sight points seem to approach or
    recede where disparity is uncertain: far away, on what is narrow, and in flickering light.
    """
    if _creeps(track, parameters):
        return True
    if _crosses(track, camera_position):
        return not track.rigid and _is_unmoved(track)
    if track.growth.shows(_approach(track, camera_position)):
        return False
    return track.far or _is_narrow(track) or (light.flickers and _is_slow(track, parameters))


def _is_narrow(track: BodyTrack) -> bool:
    """Return whether a body is narrower than the windows in which its points are matched."""
    left, _, right, _ = track.box_px
    return right - left < _WINDOW_PX


def _creeps(track: BodyTrack, parameters: ObstacleParameters) -> bool:
    """Return whether a body hardly moves and has not been seen to leave its place.

    Changing light and reflections move points a little; a body that goes on will leave its place.
    """
    if _has_moved(track):
        return False
    speed = float(np.linalg.norm(track.mean[VELOCITY]))
    return speed < _CREEPING * parameters.stopped_below_mps


def _is_slow(track: BodyTrack, parameters: ObstacleParameters) -> bool:
    """Return whether a body is slow and has not been seen to leave its place."""
    speed = float(np.linalg.norm(track.mean[VELOCITY]))
    return not _has_moved(track) and speed <= _SLOW_IN_FLICKER * parameters.stopped_below_mps


def _crosses(track: BodyTrack, camera_position: Float64Array) -> bool:
    """Return whether a good part of a body's velocity is across the line of sight."""
    speed = float(np.linalg.norm(track.mean[VELOCITY]))
    along = _approach(track, camera_position)
    return bool(np.sqrt(max(0.0, speed**2 - along**2)) >= _ACROSS_SHARE * speed)


def _approach(track: BodyTrack, camera_position: Float64Array) -> float:
    """Return how fast a body comes nearer, m/s; negative if it recedes."""
    ahead = track.centre - camera_position
    return -float(track.mean[VELOCITY] @ ahead) / float(np.linalg.norm(ahead))


def _has_moved(track: BodyTrack) -> bool:
    """Return whether a body stands apart, and not all of it is seen where something was before.

    Without an outline it takes several points to show that: a few may slide along one edge.
    """
    if track.outline is None:
        return track.merged_s == 0 and track.points >= _SEVERAL_POINTS
    return track.seen_outline is not None and not _is_unmoved(track)


def _confirmed_by_outline(
    track: BodyTrack,
    camera_position: Float64Array,
    parameters: ObstacleParameters,
    light: Light,
) -> bool:
    """Return whether a body's segment confirms that it moves: it enters free space or goes away.

    Where the image saturates changes with the exposure: while that swings, depths of static things
    appear and disappear, and more evidence is needed.
    """
    outline = track.seen_outline
    if outline is None or track.motion is not MotionState.MOVING:
        return False
    # A patch of noise on a wall, or where only one camera sees, beside somebody who passes; or
    # where a pattern repeats itself, so that nothing can be tracked on it.
    noise = outline.merged or outline.is_static or outline.beside_nearer
    noise |= outline.hangs and track.points == 0
    if noise and not outline.is_high:
        return False
    frames, sigmas = _ARRIVED_FRAMES, _ARRIVED_SIGMAS
    if light.swings:
        frames, sigmas = 2 * frames, max(sigmas, parameters.confirm_sigmas)
    arrived = outline.arrived_frames >= frames
    away_mps = -_approach(track, camera_position)
    uncovered = outline.uncovered_frames >= _UNCOVERED_FRAMES
    uncovered &= away_mps > _AWAY_SHARE * float(np.linalg.norm(track.mean[VELOCITY]))
    uncovered &= away_mps < _MOST_AWAY_MPS
    return (arrived and track.significance >= sigmas) or (
        uncovered and track.significance >= _UNCOVERED_SIGMAS
    )
