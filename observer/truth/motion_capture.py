"""Motion capture data, in its own room frame and on its own clock.

Files (``observer.truth.files``) and live servers (``observer.truth.live``) produce these types;
``observer.truth.alignment`` converts them to the source's clock and the observer's world.
The room frame is whatever the system was set up with; Vicon's and VRPN's have z up, and Motive's is
rotated to z up when its files are read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from observer.errors import TruthError
from observer.geometry import Float64Array

SAME_INSTANT_S = 1e-5
"""Samples of a body at most this far apart are one, written twice with a rounded stamp, seconds."""


@dataclass(frozen=True, eq=False)
class BodySample:
    """A body at one instant, as a live server reported it.

    Attributes:
        name: the body's, as the system names it.
        time: the server's own stamp, seconds; only differences are meaningful.
        received: the host's monotonic clock at reception, seconds.
        position: (3,) metres, room frame; None where the body was not seen.
        rotation: (3, 3) ``R_room_body``; None where unknown.
    """

    name: str
    time: float
    received: float
    position: Float64Array | None
    rotation: Float64Array | None


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A body, or a marker, over time.

    Attributes:
        name: as the system names it.
        times: (N,) seconds, strictly increasing, on the system's clock.
        positions: (N, 3) metres, room frame; NaN rows are gaps.
        rotations: (N, 3, 3) ``R_room_body``, NaN in gaps; None without orientation.

    Raises:
        TruthError: shapes differ, or times do not increase.
    """

    name: str
    times: Float64Array
    positions: Float64Array
    rotations: Float64Array | None = None

    def __post_init__(self) -> None:
        count = len(self.times)
        if self.times.shape != (count,) or self.positions.shape != (count, 3):
            raise TruthError(f"{self.name}: times and positions must have the same length")
        if self.rotations is not None and self.rotations.shape != (count, 3, 3):
            raise TruthError(f"{self.name}: there must be one rotation for each time")
        if not np.isfinite(self.times).all() or (np.diff(self.times) <= 0).any():
            raise TruthError(
                f"{self.name}: times must be finite and increase from sample to sample"
            )

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Mask (N,) of the samples in which the body was seen."""
        return np.asarray(np.isfinite(self.positions).all(axis=1))

    @property
    def gaps(self) -> int:
        """Number of samples in which it was not seen."""
        return int(len(self.times) - self.seen.sum())

    def part(self, chosen: slice | NDArray[np.bool_]) -> Trajectory:
        """Return some of the samples, by a slice or a mask (N,)."""
        rotations = None if self.rotations is None else self.rotations[chosen]
        return Trajectory(self.name, self.times[chosen], self.positions[chosen], rotations)

    def fixed_points(self, offset: Float64Array | None) -> Float64Array:
        """Return positions (N, 3) of a point at an offset (3,) in the body's axes.

        If the offset is None or the body has no rotations, return those of the body's origin.
        """
        if offset is None or self.rotations is None:
            return self.positions
        return np.asarray(self.positions + self.rotations @ offset)


@dataclass(frozen=True, eq=False)
class Capture:
    """Content of a file, or what was recorded live.

    Attributes:
        format: the recognised format in words for people, such as ``Vicon Tracker objects``.
        rate_hz: nominal; None where samples have their own stamps and no rate is given.
        bodies: by name, in the order of the file: rigid bodies, or single markers.
        notes: what was understood and decided, one sentence each (units, angles, gaps).
    """

    format: str
    rate_hz: float | None
    bodies: Mapping[str, Trajectory]
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "bodies", MappingProxyType(dict(self.bodies)))


def rising_samples(samples: Iterable[BodySample]) -> dict[str, list[BodySample]]:
    """Return samples by body in order of arrival, without those whose stamp did not increase.

    An increase within ``SAME_INSTANT_S`` is none.
    """
    bodies: dict[str, list[BodySample]] = {}
    for sample in samples:
        kept = bodies.setdefault(sample.name, [])
        if not kept or sample.time > kept[-1].time + SAME_INSTANT_S:
            kept.append(sample)
    return bodies


def trajectory_of(name: str, kept: Sequence[BodySample]) -> Trajectory:
    """Return one body's samples, in their order, as a trajectory; NaN where it was not seen."""
    unknown = np.full(3, np.nan)
    positions = [unknown if s.position is None else s.position for s in kept]
    rotations = None
    if any(s.rotation is not None for s in kept):
        lost = np.full((3, 3), np.nan)
        rotations = np.array([lost if s.rotation is None else s.rotation for s in kept])
    return Trajectory(name, np.array([s.time for s in kept]), np.array(positions), rotations)
