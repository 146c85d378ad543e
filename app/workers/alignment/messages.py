"""Messages to and from the worker: plain frozen dataclasses, sent as pickles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from observer.geometry import Pose
from observer.mount import CameraMount
from observer.truth.alignment.live_clocks import LiveClocks
from observer.truth.alignment.result import Alignment
from observer.truth.motion_capture import Trajectory


@dataclass(frozen=True, eq=False)
class Choices:
    """Prior knowledge; see ``observer.truth.alignment.choices``.

    Attributes:
        observer: the body that carries the camera; None if it is to be found.
        ignore: bodies to leave out.
        mount: mount of the camera.
        T_body_base: pose of the base in the observer's body.
    """

    observer: str | None = None
    ignore: tuple[str, ...] = ()
    mount: CameraMount | None = None
    T_body_base: Pose | None = None


@dataclass(frozen=True, eq=False)
class Solve:
    """Request to align with the data since the last one.

    Attributes:
        anew: earlier observations belong to another source, or to an earlier start of this one.
        lines: as made by ``observer.jsonl.observation_line``, with what the alignment needs.
        samples: motion capture's bodies, on its own clock.
        clocks: the relation between both clocks, as known now.
    """

    anew: bool
    lines: tuple[Mapping[str, object], ...]
    samples: tuple[Trajectory, ...]
    clocks: LiveClocks
    choices: Choices


@dataclass(frozen=True, eq=False)
class Solved:
    """Result of an alignment.

    Attributes:
        state: the alignment, or the reason why there is none, beginning with "not aligned yet".
        seconds: time it took.
    """

    state: Alignment | str
    seconds: float
