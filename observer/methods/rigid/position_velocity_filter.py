"""Position and velocity of many points at once, by weighted sums over their sightings.

For each point the model is ``z_i = p + v s_i``, where ``s_i <= 0`` is how long ago the sighting
was. With the information ``L_i`` (inverse covariance) of each sighting five sums hold all that is
needed; this is the Kalman filter with state (position, velocity) of 6D-Vision (Franke, Rabe,
Badino, Gehrig: 6D-Vision, DAGM 2005) in information form, without a prior:

    A0 = sum L,  A1 = sum L s,  A2 = sum L s^2,  b0 = sum L z,  b1 = sum L z s

In this form no prior on a point is needed, the information of neighbours is simply added, and the
hypothesis "the point is static" (v = 0) is evaluated from the same sums. Old sightings are
forgotten at a constant rate, which replaces process noise and is scale-free.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.kernels.inverses import inverse_3x3

# Information below this counts as none.
_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class PositionVelocityFilter:
    """The sums of N points; coordinates are relative to each point's own origin.

    Attributes:
        origin: (N, 3) metres, a fixed place near the point, to keep precision far from the
            world's origin.
        a0, a1, a2: (N, 3, 3) 1/m^2, s/m^2, s^2/m^2. b0, b1: (N, 3) 1/m, s/m.
        c0: (N,) sum z^T L z, and count: (N,) of the sightings, both decaying like the rest.
    """

    origin: Float64Array
    a0: Float64Array
    a1: Float64Array
    a2: Float64Array
    b0: Float64Array
    b1: Float64Array
    c0: Float64Array
    count: Float64Array

    @cached_property
    def position_cov(self) -> Float64Array:
        """(N, 3, 3) m^2, of each static position: the inverse of a0, read-only.

        It is needed several times per frame, so methods that update or select the sums pass the
        cached value on.
        """
        cov = inverse_3x3(self.a0)
        cov.setflags(write=False)
        return cov

    @property
    def _has_cov(self) -> bool:
        """Return whether ``position_cov`` is cached already."""
        return "position_cov" in self.__dict__

    def _with_cov(self, cov: Float64Array) -> PositionVelocityFilter:
        """Return these sums with the already known inverse (N, 3, 3) of a0 cached."""
        cov.setflags(write=False)
        self.__dict__["position_cov"] = cov
        return self

    @staticmethod
    def begin(position: Float64Array, information: Float64Array) -> PositionVelocityFilter:
        """Begin with N points first seen at (N, 3), with information (N, 3, 3)."""
        nothing = np.zeros_like(information)
        return PositionVelocityFilter(
            origin=position.copy(),
            a0=information.copy(),
            a1=nothing,
            a2=nothing.copy(),
            b0=np.zeros_like(position),
            b1=np.zeros_like(position),
            c0=np.zeros(len(position)),
            count=np.ones(len(position)),
        )

    def advanced(self, dt: float, memory_s: float) -> PositionVelocityFilter:
        """Return the sums ``dt`` seconds later, with the weight of all sightings decayed."""
        keep = float(np.exp(-dt / memory_s))
        moved = PositionVelocityFilter(
            origin=self.origin,
            a0=keep * self.a0,
            a1=keep * (self.a1 - dt * self.a0),
            a2=keep * (self.a2 - 2 * dt * self.a1 + dt * dt * self.a0),
            b0=keep * self.b0,
            b1=keep * (self.b1 - dt * self.b0),
            c0=keep * self.c0,
            count=keep * self.count,
        )
        return moved._with_cov(self.position_cov / keep) if self._has_cov else moved

    def with_sightings(
        self, position: Float64Array, information: Float64Array
    ) -> PositionVelocityFilter:
        """Return the sums with a sighting of each point now; zero information adds nothing."""
        gap = np.where(np.isfinite(position), position - self.origin, 0.0)
        vector = np.einsum("nij,nj->ni", information, gap)
        return PositionVelocityFilter(
            origin=self.origin,
            a0=self.a0 + information,
            a1=self.a1,
            a2=self.a2,
            b0=self.b0 + vector,
            b1=self.b1,
            c0=self.c0 + np.einsum("ni,ni->n", vector, gap),
            count=self.count + (information[:, 2, 2] > 0),
        )

    def shifted(self, shift: Float64Array, drift: Float64Array) -> PositionVelocityFilter:
        """Return the sums as if each sighting had been displaced by ``shift + drift s``.

        Args:
            shift: (N, 3) metres now. drift: (N, 3) m/s.
        """
        turned = np.einsum("nij,nj->ni", self.a2, drift)
        moved = replace(
            self,
            origin=self.origin + shift,
            b0=self.b0 + np.einsum("nij,nj->ni", self.a1, drift),
            b1=self.b1 + turned,
            c0=self.c0 + np.einsum("ni,ni->n", drift, 2 * self.b1 + turned),
        )
        return moved._with_cov(self.position_cov)

    def static_position(self) -> tuple[Float64Array, Float64Array]:
        """Return each point's position if it is static: (N, 3) metres, covariance (N, 3, 3)."""
        return self.origin + np.einsum("nij,nj->ni", self.position_cov, self.b0), self.position_cov

    def velocity_information(self) -> tuple[Float64Array, Float64Array]:
        """Return each velocity's information (N, 3, 3) s^2/m^2, and information times velocity.

        Both may be summed over neighbours; ``information^-1 @ vector`` is the velocity.
        """
        gain = self.a1 @ self.position_cov
        information = self.a2 - gain @ self.a1
        vector = self.b1 - np.einsum("nij,nj->ni", gain, self.b0)
        return (information + np.swapaxes(information, 1, 2)) / 2, vector

    def moving_position(self, velocity: Float64Array) -> Float64Array:
        """Return where each point is now, (N, 3) metres, if it moves at (N, 3) m/s.

        If a moving point were assumed static, its depth would be wrong, because its lines of sight
        would intersect where it never was.
        """
        inner = self.b0 - np.einsum("nij,nj->ni", self.a1, velocity)
        position = self.origin + np.einsum("nij,nj->ni", self.position_cov, inner)
        return np.asarray(position, dtype=np.float64)

    def window_s(self) -> Float64Array:
        """Return the effective time span of the sightings, (N,) seconds.

        It is the length of a uniform window with the same variance of the sighting times.
        """
        mean, square = self.ages()
        return np.asarray(np.sqrt(12 * np.maximum(square - mean**2, 0.0)), np.float64)

    def ages(self) -> tuple[Float64Array, Float64Array]:
        """Return the mean age of the sightings, (N,) seconds, and the mean squared age (N,)."""
        weight = np.maximum(np.trace(self.a0, axis1=1, axis2=2), _TINY)
        mean = -np.trace(self.a1, axis1=1, axis2=2) / weight
        return mean, np.trace(self.a2, axis1=1, axis2=2) / weight

    def take(self, which: NDArray[np.intp] | NDArray[np.bool_]) -> PositionVelocityFilter:
        """Return the sums of some of the points."""
        # For rows, take() is several times as fast as indexing; it does not accept a mask.
        at = np.flatnonzero(which) if which.dtype == np.bool_ else which
        taken = PositionVelocityFilter(*(getattr(self, name).take(at, axis=0) for name in _NAMES))
        return taken._with_cov(self.position_cov.take(at, axis=0)) if self._has_cov else taken

    def joined(self, other: PositionVelocityFilter) -> PositionVelocityFilter:
        """Return these points and then the others."""
        both = PositionVelocityFilter(
            *(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _NAMES)
        )
        if not self._has_cov:
            return both
        return both._with_cov(np.concatenate([self.position_cov, other.position_cov]))


_NAMES = ("origin", "a0", "a1", "a2", "b0", "b1", "c0", "count")
