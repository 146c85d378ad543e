"""The box of one obstacle, learnt from its points over the life of its track."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.methods.rigid.bodies.filter import yaw_matrix
from observer.robust import MAD_TO_SIGMA

# Places further from the middle than so many times the largest spread, plus this many metres, are
# not on the body.
_STRAY = 10.0
_LEAST_SPREAD_M = 0.01
# Share of the places that are left out on each side: some of the outermost are wrong.
_TRIM = 0.03
# A face shows its full length if the cosine between its normal and the view is at least this, for
# this many seconds: by then points have been found all over it. A robot's end, seen during half a
# turn, often has only a dozen, and none at its edges.
_SHOWN = 0.7
_SHOWN_S = 6.0
# Members' places are remembered every so many frames, and at most so many of them: several seconds,
# so that the box neither follows each frame's points nor forgets the faces that are hidden now.
_NOTE_EVERY = 3
_MEMORY = 400
# Seconds, time constant with which a larger box is believed: strangers leave sooner than that.
_GROWS_S = 0.5
# Seconds, time constant with which a face that comes into view is believed to be where its points
# are: the first ones lie on what was seen before, not on the face.
_SETTLES_S = 1.0
# One standard deviation of the centre, as a share of the box's longer side: before its sides were
# shown in full, and after.
_CENTRE_DOUBT = (0.15, 0.06)
# A side of the box that was never seen is assumed to be this share of the other one.
_ASPECT = 0.85
# The heading is learnt from velocities of at least this significance, and tells the faces apart
# once it is known to a few degrees: from this sum of the velocities' squared significances on.
_HEADING_SIGMAS = 4.0
_HEADING_KNOWN = 20.0**2


@dataclass(frozen=True, eq=False)
class Box:
    """A box that stands upright in the world.

    Attributes:
        centre: (3,) metres, in the body's frame (origin and yaw of the filter).
        size: (3,) metres: across the heading, height, along the heading.
        heading: radians, direction of the box's length in the body's frame (about y, 0 is z).
    """

    centre: Float64Array
    size: Float64Array
    heading: float

    def contains(
        self, places: Float64Array, margin: Float64Array | float = 0.0
    ) -> NDArray[np.bool_]:
        """(N,) which places (N, 3) m, body's frame, lie in the box enlarged on all sides.

        Args:
            margin: metres; one for all, or (N,) one for each place.
        """
        local = np.abs((places - self.centre) @ yaw_matrix(self.heading))
        return np.asarray((local <= self.size / 2 + np.reshape(margin, (-1, 1))).all(axis=1))


class BodyShape:
    """Collects where an obstacle's points are in its own frame, and along which axis it drives."""

    def __init__(self) -> None:
        # Weighted sum of unit vectors at twice the heading, since forwards and back are one axis.
        self._axis = np.zeros(2)
        self._places = np.zeros((0, 3))
        self._frames = 0
        # (2,) seconds for which each side of the box was shown in its full length.
        self._shown_s = np.zeros(2)
        # (2,) the part of these seconds since its places were last forgotten.
        self._placed_s = np.zeros(2)
        # (2,) metres: the largest size of the box that was seen for long.
        self._largest = np.zeros(2)
        # (3,) metres, body's frame: the box's centre one frame ago; None before the first.
        self._centre: Float64Array | None = None

    def note_heading(self, velocity: Float64Array, cov: Float64Array, yaw: float) -> None:
        """Learn the heading from a velocity (3,) m/s, world, its covariance and the body's yaw."""
        x, z = float(velocity[0]), float(velocity[2])
        xx, xz, zz = float(cov[0, 0]) + 1e-9, float(cov[0, 2]), float(cov[2, 2]) + 1e-9
        squared = (zz * x * x - 2 * xz * x * z + xx * z * z) / (xx * zz - xz * xz)
        if squared < _HEADING_SIGMAS**2:
            return
        angle = 2 * (math.atan2(x, z) - yaw)
        self._axis = 0.97 * self._axis + min(squared, 400.0) * np.array(
            [math.cos(angle), math.sin(angle)]
        )

    def axis(self, yaw: float) -> Float64Array | None:
        """(3,) unit vector, world, along which the body drives; None while unknown."""
        if not self._axis.any():
            return None
        angle = math.atan2(self._axis[1], self._axis[0]) / 2 + yaw
        return np.array([math.sin(angle), 0.0, math.cos(angle)])

    def note(self, points: Float64Array) -> None:
        """Remember where members (N, 3) m, body frame, are in this frame."""
        self._frames += 1
        if self._frames % _NOTE_EVERY == 0:
            self._places = np.concatenate([self._places, points])[-_MEMORY:]

    def shift(self, offset: Float64Array) -> None:
        """Move the origin to (3,) metres in the old frame."""
        self._places = self._places - offset
        if self._centre is not None:
            self._centre = self._centre - offset

    def forget(self) -> None:
        """Forget where points were (the body was lost for a while), but not its size."""
        self._places = np.zeros((0, 3))
        self._placed_s = np.zeros(2)
        self._centre = None

    @property
    def centre_doubt(self) -> float:
        """One standard deviation of the centre, as a share of the box's longer side."""
        unseen, seen = _CENTRE_DOUBT
        known = min(1.0, float(self._placed_s.min()) / _SHOWN_S)
        return unseen + known * (seen - unseen)

    def box(self, points: Float64Array, view: Float64Array, dt: float) -> Box:
        """Return the box around points (N, 3) and the remembered ones, seen along ``view``.

        A side that was not shown yet gets the size that most robots have there; the longer it is
        shown, the more its points determine it.

        Args:
            points: body frame. view: (3,) from the camera to the body, in the body's frame.
            dt: seconds since the frame before.
        """
        heading = math.atan2(self._axis[1], self._axis[0]) / 2
        R = yaw_matrix(-heading)
        every = np.concatenate([points, self._places]) @ R.T
        every = every[np.isfinite(every).all(axis=1)]
        every = every[_near_most(every)]
        low, high = _without_outermost(every)
        direction = R @ view
        direction = direction / max(float(np.hypot(direction[0], direction[2])), 1e-9)
        extent = (high - low)[[0, 2]]
        # The full length along axis k is seen on the face whose normal is the other axis.
        if np.hypot(*self._axis) >= _HEADING_KNOWN:
            shown = np.abs(direction[[2, 0]]) >= _SHOWN
            self._shown_s[shown] += dt
            self._placed_s[shown] += dt
            self._largest += min(1.0, dt / _GROWS_S) * np.maximum(0.0, extent - self._largest)
        usual = _ASPECT * extent[::-1] * np.maximum(0.0, 1 - self._shown_s / _SHOWN_S)
        size = np.maximum(np.maximum(extent, usual), self._largest)
        centre = (low + high) / 2
        slack = (size - extent) / 2
        before = None if self._centre is None else (R @ self._centre)[[0, 2]]
        centre[[0, 2]] = _completed(centre[[0, 2]], slack, direction[[0, 2]], before, dt)
        self._centre = R.T @ centre
        return Box(
            centre=self._centre,
            size=np.array([size[0], high[1] - low[1], size[1]]),
            heading=heading,
        )


def _completed(
    seen: Float64Array,
    slack: Float64Array,
    direction: Float64Array,
    before: Float64Array | None,
    dt: float,
) -> Float64Array:
    """Return the centre (2,) m of a box of which only a part is seen.

    Along the view the missing part lies behind what is seen, the surer the more the front face
    is turned to the camera. Across the view nothing tells on which side it is missing: there the
    centre stays where it was, as far as the box then covers all that is seen.

    Args:
        seen: (2,) metres, the middle of what is seen. slack: (2,) metres, half of what is missing.
            direction: (2,) of the view, unit length.
        before: (2,) metres, the centre in the frame before; None if unknown.
        dt: seconds since then.
    """
    behind = seen + np.sign(direction) * slack
    if before is None:
        return behind
    kept = np.clip(before, seen - slack, seen + slack)
    share = min(1.0, dt / _SETTLES_S) * np.minimum(1.0, (direction / _SHOWN) ** 4)
    return np.asarray(kept + share * (behind - kept))


def _near_most(places: Float64Array) -> NDArray[np.bool_]:
    """(N,) which places (N, 3) are near enough to most of them to be on the body.

    Judged by the spread along the axis where it is largest: most may lie on one flat face. All are
    if none is near along every axis, as when each of a few strays along another one.
    """
    half = len(places) // 2
    apart = np.abs(places - np.partition(places, half, axis=0)[half])
    spread = MAD_TO_SIGMA * float(np.partition(apart, half, axis=0)[half].max())
    near = (apart <= _STRAY * spread + _LEAST_SPREAD_M).all(axis=1)
    return np.asarray(near if near.any() else ~near)


def _without_outermost(places: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return lower and upper bounds, (3,) each, of all places (N, 3) but the outermost few.

    The same quantiles as by ``numpy.quantile``, in a fifth of its time.
    """
    ordered = np.sort(places, axis=0)
    at = _TRIM * (len(places) - 1)
    below, part = int(at), at % 1
    above = min(below + 1, len(places) - 1)
    low = ordered[below] + part * (ordered[above] - ordered[below])
    high = ordered[-1 - below] + part * (ordered[-1 - above] - ordered[-1 - below])
    return low, high
