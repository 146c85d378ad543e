"""The rules: which share of a wanted velocity is permitted, and why not all of it.

All ground that the robot passes over until it could have stopped must be known to be free:

- seen free in the newest frame, carried to the robot's current pose;
- or clear by fresh sonar that covers it;
- or seen free a moment ago, as far as nothing unseen can have entered since.

A surface that is seen, or was seen until it came too near to be measured (``seen_surfaces``), is in
the way whatever sonar says, and an echo within ``sonar_stop_m`` ahead whatever is seen. Tracked
obstacles are predicted along their own motion (``separation``), and so are objects that sonar hears
approaching by themselves (``intruders``). A turn on the spot requires the same of the robot's
turning circle. The obstacle robot has no eyes: only echoes limit it. A robot whose sonar has fallen
silent drives neither forward nor backward.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.dead_reckoning import inverse, moved
from observer.guard.outline import Outline, is_spot_turn, swept
from observer.guard.parameters import GuardParameters
from observer.guard.separation import Approach, Stopping, approach
from observer.guard.side import WHOLE, Limit, Side
from observer.guard.sight import Sight, obstacle_named
from observer.guard.sonar_clear import SonarView, clear_by_sonar, echo_at, fresh_sonar, is_silent
from observer.robots.contract import SonarReading

# Added about an obstruction that only ``seen_surfaces`` still knows.
_UNSEEN = ", too near to be seen now; if it is gone, back off a little"


def limit_of(
    side: Side,
    wanted: tuple[float, float],
    sight: Sight | None,
    sonars: tuple[SonarReading, ...],
    outline: Outline,
    p: GuardParameters,
    now: float,
) -> Limit:
    """Return the least of what tracked obstacles, the ground and sonar permit.

    Args:
        wanted: m/s and rad/s, not zero. sight: usable; None for the robot without cameras.
    """
    if not is_spot_turn(*wanted) and is_silent(sonars, wanted[0], now, p):
        # What its last echoes said no longer holds, least of all that nothing is in the way.
        return Limit(0.0, f"its sonar has been silent for more than {p.sonar_fresh_s:g} s")
    view = fresh_sonar(sonars, now, side.past, p)
    if sight is None:
        return _limit_by_echo(wanted, view, outline, p)
    age = now - sight.received
    then = side.past.then_from_now(np.array([sight.received]))[0]
    near = approach(sight.obstacles, inverse(then), age, wanted, outline, p)
    by_obstacles = _limit_by_obstacles(near, p)
    by_ground = _limit_by_ground(side, then, wanted, view, outline, p, now)
    by_coming = _limit_by_coming(side, wanted, outline, p, now)
    return min(by_obstacles, by_ground, by_coming, key=lambda one: one.share)


def _limit_by_coming(
    side: Side, wanted: tuple[float, float], outline: Outline, p: GuardParameters, now: float
) -> Limit:
    """Limit by objects that sonar hears approaching by themselves, also where no camera looks."""
    places = [one for _, several in side.watch.coming(now, side.past, p) for one in several]
    if not places:
        return Limit(1.0)
    near = approach(places, (0.0, 0.0, 0.0), 0.0, wanted, outline, p)
    limit = _limit_by_obstacles(near, p)
    sonar = near.stopper if limit.share == near.stop_share else near.nearest
    return Limit(limit.share, f"sonar {sonar} detects something approaching", comes=True)


def _limit_by_obstacles(near: Approach, p: GuardParameters) -> Limit:
    slow = 1.0 if near.contact_s is None else near.contact_s / p.slow_time_s
    if near.stop_share <= min(slow, WHOLE):
        return Limit(
            near.stop_share, f"{obstacle_named(near.stopper)} is within the stopping distance"
        )
    if slow < 1.0:
        return Limit(slow, f"the time to contact with {obstacle_named(near.nearest)} is short")
    return Limit(1.0)


def _limit_by_ground(
    side: Side,
    then: Float64Array,
    wanted: tuple[float, float],
    view: SonarView | None,
    outline: Outline,
    p: GuardParameters,
    now: float,
) -> Limit:
    stopping = Stopping.of(*wanted, p)
    stop_s = stopping.way_s()
    seconds = max(stop_s, p.slow_time_s)
    points, times, beside, step = swept(outline, *wanted, seconds, p.margin_m)
    # Ground beyond the stopping point may be unknown.
    needed = (times <= stop_s) & ~beside
    free = blocked = np.zeros(len(points), np.bool_)
    if side.scan is not None:
        free, blocked = side.scan.classify(moved(points, then))
    seen_blocked, blocked = blocked, blocked | side.surfaces.at(points)
    free = free & ~blocked
    echo = None
    if view is not None:
        free = free | clear_by_sonar(points, view, p)
        echo = _near_echo(points, wanted, view, outline, p)
    if echo is not None:
        return Limit(0.0, f"sonar {echo} has an echo within {p.sonar_stop_m:.2f} m")
    unknown = needed & ~free & ~blocked
    if unknown.any():
        unknown[unknown] = ~side.ground.free(points[unknown], now, side.past, p)
    # Up to the last samples that are known to be free.
    seen_s = _first(times, blocked) - step
    known_s = min(_first(times, unknown) - step, seen_s)
    share, slow = stopping.share_within(known_s), max(0.0, seen_s / p.slow_time_s)
    unseen = _UNSEEN if _first(times, blocked) < _first(times, seen_blocked) else ""
    if slow < min(share, WHOLE):
        return Limit(slow, f"the time to contact with an obstruction ahead is short{unseen}")
    if known_s < seen_s:
        return Limit(
            share, "the ground ahead is not known to be free: neither visible nor covered by sonar"
        )
    return Limit(share, f"an obstruction ahead is within the stopping distance{unseen}")


def _limit_by_echo(
    wanted: tuple[float, float], view: SonarView | None, outline: Outline, p: GuardParameters
) -> Limit:
    """Limit a robot without cameras: it may drive where nothing echoes, even if it has no sonar."""
    if view is None or is_spot_turn(*wanted):
        return Limit(1.0)
    stopping = Stopping.of(*wanted, p)
    points, times, _, step = swept(outline, *wanted, stopping.way_s(), p.margin_m)
    near = _near_echo(points, wanted, view, outline, p)
    if near is not None:
        return Limit(0.0, f"sonar {near} has an echo within {p.sonar_stop_m:.2f} m")
    echoed = np.asarray(echo_at(points, view, p).any(axis=0), np.bool_)
    share = stopping.share_within(_first(times, echoed) - step)
    return Limit(share, "sonar reports an echo ahead")


def _near_echo(
    points: Float64Array,
    wanted: tuple[float, float],
    view: SonarView,
    outline: Outline,
    p: GuardParameters,
) -> int | None:
    """The number of a sonar with an echo on the robot's path within the stop distance.

    An object beside the robot does not keep it from turning away.
    """
    if is_spot_turn(*wanted):
        return None
    near = points[outline.distance(points[:, 0], points[:, 1]) <= p.sonar_stop_m]
    echoing = echo_at(near, view, p).any(axis=1)
    return view.index[int(np.argmax(echoing))] if echoing.any() else None


def _first(times: Float64Array, which: NDArray[np.bool_]) -> float:
    return float(times[which].min()) if which.any() else math.inf
