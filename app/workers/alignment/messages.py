"""What goes into the worker, and what comes out of it. Plain frozen dataclasses, as pickles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from observer.geometry import Pose
from observer.mount import CameraMount
from observer.truth.alignment.live_clocks import LiveClocks
from observer.truth.motion_capture import Trajectory


@dataclass(frozen=True, eq=False)
class Choices:
    """What is known beforehand; see ``observer.truth.alignment.choices``.

    Attributes:
        observer: the body that carries the camera, None where it is to be found out.
        ignore: bodies that are none of it.
        mount: of the camera. T_body_base: of the observer's body.
    """

    observer: str | None = None
    ignore: tuple[str, ...] = ()
    mount: CameraMount | None = None
    T_body_base: Pose | None = None


@dataclass(frozen=True, eq=False)
class Solve:
    """Align with what came since the last time.

    Attributes:
        anew: what was observed before belongs to another source or another beginning of it.
        lines: as ``observer.jsonl.observation_line`` makes them.
        samples: motion capture's bodies, on its own clock.
        clocks: between the two, as they are known now.
    """

    anew: bool
    lines: tuple[dict[str, Any], ...]
    samples: tuple[Trajectory, ...]
    clocks: LiveClocks
    choices: Choices


@dataclass(frozen=True)
class Solved:
    """What came of it.

    Attributes:
        alignment: as ``Alignment.as_dict`` makes it; None where there is none.
        sentence: why, beginning with "not yet aligned".
        tried: whether enough was there, and time enough has passed, to try.
        seconds: that it took.
    """

    alignment: dict[str, Any] | None
    sentence: str | None
    tried: bool
    seconds: float
