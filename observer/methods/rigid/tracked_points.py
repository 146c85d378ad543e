"""Feature points that are tracked from frame to frame, and the state of each."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.position_velocity_filter import PositionVelocityFilter
from observer.vision.lifecycle import NO_OBSTACLE

# Frames: how long a point that did not fit its body, or was about to be occluded, may not join one.
BANISHED_FRAMES = 5
# Weight of the sightings below which nothing useful is left of them.
_FORGOTTEN = 1e-6


@dataclass(frozen=True, eq=False)
class WorldSightings:
    """Sightings of N points in this frame.

    Attributes:
        position: (N, 3) metres, world; NaN unknown.
        information: (N, 3, 3) 1/m^2, world; zero where the position is unknown.
    """

    position: Float64Array
    information: Float64Array


@dataclass(frozen=True, eq=False)
class TrackedPoints:
    """N tracked points as of the newest frame.

    Attributes:
        number: (N,) each point's own number, never reused within a segment.
        px: (N, 2) float32 pixels in the left image.
        right_px: (N, 2) float32 pixels in the right image, as matched there; NaN unknown.
        flow: (N, 2) px/s in the left image, NaN for points seen once.
        disparity: (N,) pixels at the left image's exposure; NaN unknown.
        sightings: (N,) in how many frames the point was seen.
        age: (N,) seconds since it was first seen.
        sums: position and velocity of each point, world frame.
        cornered: (N,) whether the texture there varies in more than one direction.
        recurs: (N,) whether its texture recurs along the row, so that its depth may be wrong.
        velocity: (N, 3) m/s, world, of the point alone at the last frame; 0 while unknown.
        dynamic: (N,) whether it counted as dynamic at the last frame.
        obstacle: (N,) number of the obstacle it belongs to, or ``NO_OBSTACLE``.
        tenure: (N,) frames for which it has belonged to that obstacle.
        within: (N,) number of the obstacle on whose outline it is seen, or ``NO_OBSTACLE``.
        shape_information: (N, 3, 3) 1/m^2 and shape_vector: (N, 3) 1/m, where the point is on
            that obstacle, in the obstacle's own frame (``information^-1 @ vector``).
    """

    number: NDArray[np.int64]
    px: NDArray[np.float32]
    right_px: NDArray[np.float32]
    flow: Float64Array
    disparity: Float64Array
    sightings: NDArray[np.int64]
    age: Float64Array
    sums: PositionVelocityFilter
    cornered: NDArray[np.bool_]
    recurs: NDArray[np.bool_]
    velocity: Float64Array
    dynamic: NDArray[np.bool_]
    obstacle: NDArray[np.int64]
    tenure: NDArray[np.int64]
    within: NDArray[np.int64]
    shape_information: Float64Array
    shape_vector: Float64Array

    @staticmethod
    def none() -> TrackedPoints:
        """No points at all."""
        px = np.zeros((0, 2), np.float32)
        sums = PositionVelocityFilter.begin(np.zeros((0, 3)), np.zeros((0, 3, 3)))
        return TrackedPoints.begin(0, px, px, np.zeros(0), sums)

    @staticmethod
    def begin(
        first_number: int,
        px: NDArray[np.float32],
        right_px: NDArray[np.float32],
        disparity: Float64Array,
        sums: PositionVelocityFilter,
    ) -> TrackedPoints:
        """Return points that are seen for the first time."""
        count = len(px)
        return TrackedPoints(
            number=np.arange(first_number, first_number + count, dtype=np.int64),
            px=px,
            right_px=right_px,
            flow=np.full((count, 2), np.nan),
            disparity=disparity,
            sightings=np.ones(count, np.int64),
            age=np.zeros(count),
            sums=sums,
            cornered=np.ones(count, np.bool_),
            recurs=np.zeros(count, np.bool_),
            velocity=np.zeros((count, 3)),
            dynamic=np.zeros(count, np.bool_),
            obstacle=np.full(count, NO_OBSTACLE, np.int64),
            tenure=np.zeros(count, np.int64),
            within=np.full(count, NO_OBSTACLE, np.int64),
            shape_information=np.zeros((count, 3, 3)),
            shape_vector=np.zeros((count, 3)),
        )

    def take(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> TrackedPoints:
        """Return some of the points."""
        # A mask would be scanned again for each array, indices are not; and for rows, take() is
        # several times as fast as indexing.
        at = np.flatnonzero(which) if which.dtype == np.bool_ else which.astype(np.intp, copy=False)
        return TrackedPoints(*(_taken(getattr(self, name), at) for name in _NAMES))

    def remembered(self) -> TrackedPoints:
        """Return the points without those whose measurements have all been forgotten.

        A point may be tracked for minutes in both images without giving a position, for lack of
        disparity; its sums then fade to numbers that can no longer be inverted.
        """
        remembered = self.sums.count > _FORGOTTEN
        return self if remembered.all() else self.take(remembered)

    def sighted(self, sightings: WorldSightings, dt: float, memory_s: float) -> TrackedPoints:
        """Return the points with one more sighting each, ``dt`` seconds after the last ones."""
        sums = self.sums.advanced(dt, memory_s)
        return self.but(sums=sums.with_sightings(sightings.position, sightings.information))

    @property
    def telling(self) -> NDArray[np.bool_]:
        """(N,) which points would be evidence of motion if they moved.

        Along a straight edge a match may slide, and among repetitions it may be another one's:
        then a point that stands appears to move. That it appears to stand is evidence still.
        """
        return self.cornered & ~self.recurs

    @property
    def stereo_share(self) -> float:
        """Share of the points whose disparity is known; 0 without points."""
        return float(np.isfinite(self.disparity).mean()) if len(self) else 0.0

    def joined(self, other: TrackedPoints) -> TrackedPoints:
        """Return these points and then the others."""
        return TrackedPoints(
            *(_joined(getattr(self, name), getattr(other, name)) for name in _NAMES)
        )

    def but(self, **changes: object) -> TrackedPoints:
        """Return the points with some attributes replaced."""
        # dataclasses.replace inspects every field each time, which takes several times as long.
        return TrackedPoints(**(vars(self) | changes))

    def __len__(self) -> int:
        return len(self.px)


# Cached, because looking the fields up each time costs more than taking the points.
_NAMES = tuple(f.name for f in fields(TrackedPoints))


def _taken(value: Any, at: NDArray[np.intp]) -> Any:
    return value.take(at) if isinstance(value, PositionVelocityFilter) else value.take(at, axis=0)


def _joined(first: Any, second: Any) -> Any:
    if isinstance(first, PositionVelocityFilter):
        return first.joined(second)
    return np.concatenate([first, second])
