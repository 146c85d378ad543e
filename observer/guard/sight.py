"""Sight: the content of an observed frame for the drive process, in the robot's own frame."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, ClassVar

from pydantic import ConfigDict, TypeAdapter

from observer.types import Status

# Seconds: highest age of the newest frame since its reception.
SIGHT_FRESH_S = 0.2
# The world that live cameras show.
REAL_WORLD = "real"
# Any comparison with NaN is false, so an obstacle with one would limit nothing.
_FINITE = ConfigDict(allow_inf_nan=False)


@dataclass(frozen=True)
class SeenObstacle:
    """A tracked obstacle over the floor, in the robot's base frame at the frame's instant.

    Attributes:
        x, y: of its centre, metres. vx, vy: over ground, m/s, in the base's axes.
        radius_m: of a circle about the centre that encloses the whole body.
        position_sigma_m, velocity_sigma_mps: largest standard deviation over all directions;
            None where unknown.
        coasting: not seen in this frame.
    """

    __pydantic_config__: ClassVar[ConfigDict] = _FINITE

    id: int
    x: float
    y: float
    vx: float
    vy: float
    radius_m: float
    position_sigma_m: float | None
    velocity_sigma_mps: float | None
    coasting: bool


@dataclass(frozen=True)
class FreeScan:
    """Free ground ahead, by direction from the base's origin.

    Between two neighbouring bearings the worse one counts. Directions outside are unknown.

    Attributes:
        bearings: radians to the left, ascending.
        blocked_m: distance of the nearest surface in the way, None where none is seen.
        known_from_m, known_to_m: distances between which the direction is seen to be free; equal
            where nothing is known.
        blind_m: distance below which a surface is too near to be measured; empty if every surface
            is measured.
    """

    __pydantic_config__: ClassVar[ConfigDict] = _FINITE

    bearings: tuple[float, ...]
    blocked_m: tuple[float | None, ...]
    known_from_m: tuple[float, ...]
    known_to_m: tuple[float, ...]
    blind_m: tuple[float, ...] = ()


@dataclass(frozen=True)
class Sight:
    """One frame, as far as driving needs it.

    Attributes:
        frame: its number. received, published: the host's monotonic clock at its reception and
            after it was observed.
        world: which world it shows; a robot moves only by sight of its own world. ``real`` for
            live cameras, another text for each simulated world, None for replayed recordings.
        status, reasons: of the observation.
        mount_known: whether the pose of the cameras on the robot is known; without it there are
            no obstacles and no scan.
    """

    __pydantic_config__: ClassVar[ConfigDict] = _FINITE

    frame: int
    received: float
    published: float
    world: str | None
    status: Status
    reasons: tuple[str, ...]
    mount_known: bool
    obstacles: tuple[SeenObstacle, ...] = ()
    scan: FreeScan | None = None

    def facts(self) -> dict[str, Any]:
        """Return plain values, for JSON."""
        return asdict(self)


_SIGHT = TypeAdapter(Sight)


def sight_of(facts: Mapping[str, Any]) -> Sight:
    """Return the sight with these ``facts``.

    Raises:
        ValueError: they do not describe a sight, or a number is not finite.
    """
    return _SIGHT.validate_python(facts)


def obstacle_named(number: int | None) -> str:
    """Return an obstacle in words; a tentative track has no lasting number yet."""
    if number is None or number < 0:
        return "an object that has started to move"
    return f"obstacle {number}"
