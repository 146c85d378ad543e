"""Speed and separation: distance that a robot must keep, and speed for the space it has.

The protective separation distance of ISO/TS 15066:2016, 5.5.4 (with ISO 13855's terms for
approaching bodies), as Marvel and Norcross write it out (Implementing speed and separation
monitoring in collaborative robot workcells, Robotics and Computer-Integrated Manufacturing 44,
2017)::

    S_p = S_h + S_r + S_s + C + Z_d + Z_r

    S_h   distance the obstacle covers until the robot has stopped: its speed times (reaction +
          braking time)
    S_r   distance the robot covers during its reaction time: speed times reaction time
    S_s   distance the robot covers while it brakes: speed^2 / (2 deceleration)
    C     distance kept in any case: the margin
    Z_d   uncertainty of the obstacle's position (sigmas times its standard deviation, which grows
          with that of its velocity and the time)
    Z_r   uncertainty of the robot's own distance: a share of S_r + S_s

The standard adds the speeds up as if both drove straight at each other. Here the robot follows the
commanded arc and the obstacle its measured velocity, so an obstacle that passes behind the robot
does not stop it. This is an aid for careful people, not a certified safety function: neither the
cameras nor the computer are safety rated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.guard.outline import Outline, poses_along
from observer.guard.parameters import GuardParameters
from observer.guard.sight import SeenObstacle

# One standard deviation of the distance driven, as a share of it: wheels slip, floors differ.
_DISTANCE_SIGMA = 0.05
# Assumed where the uncertainty is unknown.
_UNKNOWN_POSITION_SIGMA_M = 0.2
_UNKNOWN_VELOCITY_SIGMA_MPS = 0.3
_SHARES = 11
_INSTANTS = 9
# Getting this much nearer than when standing still does not count as an approach.
_NO_APPROACH_M = 0.002


@dataclass(frozen=True)
class Stopping:
    """Braking of a motion along one arc.

    Speed and turn rate are scaled together by a *share* from 0 to 1, so the robot stays on the
    arc; its way is measured in seconds at the wanted velocity.

    Attributes:
        reaction_s: before it brakes. braking_s: from the wanted velocity to standing.
        stretch: factor by which the way may turn out longer than planned (Z_r).
    """

    reaction_s: float
    braking_s: float
    stretch: float

    @staticmethod
    def of(speed_mps: float, turn_rate_radps: float, p: GuardParameters) -> Stopping:
        braking_s = max(
            abs(speed_mps) / p.deceleration_mps2,
            abs(turn_rate_radps) / p.turn_acceleration_radps2,
            1e-6,
        )
        return Stopping(p.reaction_s, braking_s, 1 + p.sigmas * _DISTANCE_SIGMA)

    def way_s(self, share: float = 1.0) -> float:
        """S_r + S_s + Z_r of a share of the wanted velocity."""
        return self.stretch * (share * self.reaction_s + share**2 * self.braking_s / 2)

    def share_within(self, way_s: float) -> float:
        """The largest share, at most 1, that stops within a way: the inverse of ``way_s``."""
        if way_s <= 0:
            return 0.0
        root = self.reaction_s**2 + 2 * self.braking_s * way_s / self.stretch
        return float(min(1.0, (root**0.5 - self.reaction_s) / self.braking_s))

    def progress(self, shares: Float64Array, times: Float64Array) -> Float64Array:
        """Way (M, K) at instants (M, K); each row brakes from its share (M, 1) after reacting."""
        braking = np.clip(times - self.reaction_s, 0.0, shares * self.braking_s)
        rolling = shares * (np.minimum(times, self.reaction_s) + braking)
        return np.asarray(self.stretch * (rolling - braking**2 / (2 * self.braking_s)))


@dataclass(frozen=True)
class Approach:
    """Limits that tracked obstacles set.

    Attributes:
        stop_share: of the wanted velocity, at which the separation is kept until the robot has
            stopped. stopper: the obstacle that sets it, None where none does.
        contact_s: until the separation would be used up at the wanted velocity, None if not
            within ``slow_time_s``. nearest: the obstacle concerned.
    """

    stop_share: float
    stopper: int | None
    contact_s: float | None
    nearest: int | None


def approach(
    obstacles: Sequence[SeenObstacle],
    T_now_then: tuple[float, float, float],
    age_s: float,
    wanted: tuple[float, float],
    outline: Outline,
    p: GuardParameters,
) -> Approach:
    """Return how tracked obstacles limit a motion along an arc, their own motion included.

    An obstacle never limits a motion that gets no nearer to it than standing still would, so that
    a robot can always make way.

    Args:
        obstacles: in the base frame of ``age_s`` ago. T_now_then: pose x, y, yaw of that frame in
            the current base frame.
        wanted: m/s and rad/s.
    """
    stopping = Stopping.of(*wanted, p)
    horizon_s = age_s + max(p.slow_time_s, p.reaction_s + stopping.braking_s)
    obstacles = [one for one in obstacles if _within_reach(one, wanted, horizon_s, outline, p)]
    if not obstacles:
        return Approach(1.0, None, None, None)
    values = np.array([_numbers(one) for one in obstacles])
    x0, y0, yaw = T_now_then
    c, s = np.cos(yaw), np.sin(yaw)
    x, y, vx, vy, radius, sigma_p, sigma_v = values.T
    ox, oy = x0 + c * x - s * y, y0 + s * x + c * y
    wx, wy = c * vx - s * vy, s * vx + c * vy

    def separation(way_s: Float64Array, times: Float64Array) -> Float64Array:
        """(..., O) from outline to obstacle at instants from now, less margin and uncertainty."""
        poses = poses_along(*wanted, way_s)[..., None, :]
        dx = ox + wx * (age_s + times[..., None]) - poses[..., 0]
        dy = oy + wy * (age_s + times[..., None]) - poses[..., 1]
        cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
        gap = outline.distance(cos * dx + sin * dy, cos * dy - sin * dx)
        # Within the outline, keep falling with the distance of the centres.
        gap = gap + np.minimum(0.0, np.hypot(dx, dy) - outline.width_m / 2)
        sigma = np.hypot(sigma_p, sigma_v * (age_s + times[..., None]))
        return np.asarray(gap - radius - p.margin_m - p.sigmas * sigma)

    def too_near(way_s: Float64Array, times: Float64Array) -> NDArray[np.bool_]:
        """(..., O) whether the separation is used up, and more so than when standing still."""
        driving, standing = separation(way_s, times), separation(np.zeros_like(times), times)
        return np.asarray((driving < 0) & (driving < standing - _NO_APPROACH_M), np.bool_)

    shares = np.linspace(0.0, 1.0, _SHARES)[:, None]
    times = np.linspace(0.0, 1.0, _INSTANTS) * (p.reaction_s + shares * stopping.braking_s)
    refused = np.asarray(too_near(stopping.progress(shares, times), times).any(axis=1), np.bool_)
    stop_share, stopper = 1.0, None
    if refused.any():
        first = int(np.argmax(refused.any(axis=1)))
        stop_share = float(shares[max(0, first - 1), 0])
        stopper = obstacles[int(np.argmax(refused[first]))].id
    ahead = np.linspace(0.0, p.slow_time_s, 2 * _INSTANTS)
    near = too_near(ahead, ahead)
    if not near.any():
        return Approach(stop_share, stopper, None, stopper)
    k = int(np.argmax(near.any(axis=1)))
    return Approach(stop_share, stopper, float(ahead[k]), obstacles[int(np.argmax(near[k]))].id)


def _within_reach(
    one: SeenObstacle,
    wanted: tuple[float, float],
    seconds: float,
    outline: Outline,
    p: GuardParameters,
) -> bool:
    """Return whether the two might meet within a time, whatever their directions."""
    body = math.hypot(outline.length_m, outline.width_m) / 2
    _, _, vx, vy, radius, sigma_p, sigma_v = _numbers(one)
    # Z_r stretches the robot's way.
    fast = (1 + p.sigmas * _DISTANCE_SIGMA) * abs(wanted[0]) + math.hypot(vx, vy)
    sigma = sigma_p + sigma_v * seconds
    reach = body + radius + p.margin_m + p.sigmas * sigma + fast * seconds
    return math.hypot(one.x, one.y) <= reach


def _numbers(one: SeenObstacle) -> tuple[float, ...]:
    sigma_p, sigma_v = one.position_sigma_m, one.velocity_sigma_mps
    sigma_p = _UNKNOWN_POSITION_SIGMA_M if sigma_p is None else sigma_p
    sigma_v = _UNKNOWN_VELOCITY_SIGMA_MPS if sigma_v is None else sigma_v
    return one.x, one.y, one.vx, one.vy, one.radius_m, sigma_p, sigma_v
