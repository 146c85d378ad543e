"""A robot's outline and the ground it passes over along an arc."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array

# Metres: a robot of unknown size is assumed to be large.
_UNKNOWN_LENGTH_M = 0.55
_UNKNOWN_WIDTH_M = 0.45
# Metres between ground samples: less than half the width of any relevant obstacle.
_STEP_M = 0.05
_MOST_STEPS = 40
_EDGE_M = 0.1
_RING = 24
# Metres per radian: below this a motion is a turn on the spot, as the axle hardly moves.
_SPOT_M = 0.02


@dataclass(frozen=True)
class Outline:
    """Length and width about the middle of the axle, and radius of the turning circle; metres."""

    length_m: float
    width_m: float
    radius_m: float

    @staticmethod
    def of(length_m: float | None, width_m: float | None, radius_m: float | None) -> Outline:
        """Return an outline in which unknown sizes are assumed to be large."""
        length = _UNKNOWN_LENGTH_M if length_m is None else length_m
        width = _UNKNOWN_WIDTH_M if width_m is None else width_m
        diagonal = math.hypot(length, width) / 2
        return Outline(length, width, diagonal if radius_m is None else radius_m)

    def distance(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the distance (...) of points x, y (...) in the base frame, metres; 0 within."""
        dx = np.abs(x) - self.length_m / 2
        dy = np.abs(y) - self.width_m / 2
        return np.asarray(np.hypot(np.maximum(dx, 0.0), np.maximum(dy, 0.0)))


def poses_along(speed_mps: float, turn_rate_radps: float, times: Float64Array) -> Float64Array:
    """Poses (..., 3) x, y, yaw after driving an arc for ``times`` seconds, from the base frame.

    The exact motion of a differential drive at constant speeds (Siegwart et al., Introduction to
    Autonomous Mobile Robots, 3.2).
    """
    yaw = turn_rate_radps * times
    distance = speed_mps * times
    half = yaw / 2
    # The chord of an arc; numpy's sinc multiplies its argument by pi.
    chord = distance * np.sinc(half / math.pi)
    return np.stack([chord * np.cos(half), chord * np.sin(half), yaw], axis=-1)


def is_spot_turn(speed_mps: float, turn_rate_radps: float) -> bool:
    """Return whether a motion turns about the middle of the axle, or nearly so."""
    return abs(speed_mps) <= _SPOT_M * abs(turn_rate_radps)


class Way(NamedTuple):
    """Samples of ground that a robot will pass over and, with its margin, does not cover now.

    Attributes:
        points: (N, 2) in the current base frame.
        times: (N,) seconds at the wanted velocity until each is reached.
        beside: (N,) whether each lies beside the robot's path, within its margin: no known
            obstacle may be there, but the ground may be unknown.
        step_s: between two samples of time; 0 where there is only one.
    """

    points: Float64Array
    times: Float64Array
    beside: NDArray[np.bool_]
    step_s: float


# Most ticks of either robot ask for the same velocity as the one before.
@lru_cache(maxsize=4)
def swept(
    outline: Outline, speed_mps: float, turn_rate_radps: float, seconds: float, margin_m: float
) -> Way:
    """Sample the ground under the outline with its margin, along an arc of ``seconds`` duration.

    For a motion forward or backward: the leading edge with its margin, the middles of the sides
    and the trailing corners, which swing out in a bend. For a turn on the spot: the whole turning
    circle at once and without the margin, as it gets no nearer to what stands beside it.
    """
    if is_spot_turn(speed_mps, turn_rate_radps):
        angle = np.arange(_RING) * (2 * math.pi / _RING)
        radius = max(outline.radius_m, math.hypot(outline.length_m, outline.width_m) / 2)
        ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return Way(ring, np.zeros(_RING), np.zeros(_RING, np.bool_), 0.0)
    body, margin, turns = _edge(outline, margin_m, speed_mps)
    reach = math.hypot(*body[0])
    longest = (abs(speed_mps) + abs(turn_rate_radps) * reach) * seconds
    count = min(_MOST_STEPS, max(2, math.ceil(longest / _STEP_M) + 1))
    times = np.linspace(0.0, seconds, count)
    poses = poses_along(speed_mps, turn_rate_radps, times)
    points = placed(body, poses)
    x, y = points[..., 0], points[..., 1]
    own = (np.abs(x) <= outline.length_m / 2 + margin_m + 1e-6) & (
        np.abs(y) <= outline.width_m / 2 + margin_m + 1e-6
    )
    # The leading edge is left out: nothing may hide from it in a circle larger than the body.
    own |= (np.hypot(x, y) <= outline.radius_m) & turns
    rows, columns = np.nonzero(~own)
    return Way(points[rows, columns], times[rows], margin[columns], float(times[1]))


def placed(body: Float64Array, poses: Float64Array) -> Float64Array:
    """Return points (P, 2) of a body at each of its poses (K, 3): (K, P, 2)."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x = poses[:, :1] + c[:, None] * body[:, 0] - s[:, None] * body[:, 1]
    y = poses[:, 1:2] + s[:, None] * body[:, 0] + c[:, None] * body[:, 1]
    return np.stack([x, y], axis=-1)


def _edge(
    outline: Outline, margin_m: float, speed_mps: float
) -> tuple[Float64Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return points (P, 2) of a body that sweep all its ground.

    Also return whether each lies beside it (P,), and whether it is one of the sides and trailing
    corners (P,), which move within the turning circle.
    """
    front = math.copysign(outline.length_m / 2 + margin_m, speed_mps)
    half = outline.width_m / 2
    count = max(3, math.ceil(2 * half / _EDGE_M) + 1)
    leading = [(front, y) for y in np.linspace(-half, half, count)]
    # The rear swings out beyond the robot's margin only in the tightest bends.
    tail = math.copysign(outline.length_m / 2, -speed_mps)
    rest = [(0.0, half), (0.0, -half), (tail, half), (tail, -half)]
    beside = [(front, half + margin_m), (front, -half - margin_m)]
    points = np.array(leading + rest + beside)
    margin, turns = (np.zeros(len(points), np.bool_) for _ in range(2))
    margin[-len(beside) :] = True
    turns[len(leading) : -len(beside)] = True
    return points, margin, turns
