"""Choices for an alignment, made by a person or the rig before it is computed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

from observer.errors import TruthError
from observer.geometry import Pose
from observer.mount import CameraMount
from observer.truth.alignment.body_camera import Assumed
from observer.truth.alignment.observed import TrackKey

BodyRole = Literal["observer", "obstacle", "ignored"]


@dataclass(frozen=True, eq=False)
class AlignmentChoices:
    """Choices for an alignment.

    Attributes:
        roles: of bodies by name. Bodies without one are obstacles; if none is the observer, a
            body that moves like the camera is used, if there is one.
        matches: a person's corrections: the body of a track, None for no body.
        search: lowest and highest offset to consider, seconds to be added to truth's times; None
            for all at which the recordings overlap.
        drift: estimate the clocks' drift if the overlap is long enough.
        mount: the camera's; gives the vertical and the height. T_body_base: of the observer's
            body.
        T_body_camera: as typed in; None if it is to be estimated, or follows from mount and
            T_body_base.

    Raises:
        TruthError: two bodies are the observer.
    """

    roles: Mapping[str, BodyRole] = field(default_factory=dict)
    matches: Mapping[TrackKey, str | None] = field(default_factory=dict)
    search: tuple[float, float] | None = None
    drift: bool = True
    mount: CameraMount | None = None
    T_body_base: Pose | None = None
    T_body_camera: Pose | None = None

    def __post_init__(self) -> None:
        observers = [name for name, role in self.roles.items() if role == "observer"]
        if len(observers) > 1:
            raise TruthError(
                f"only one body can be the observer, not both {observers[0]} and {observers[1]}"
            )
        for key in ("roles", "matches"):
            object.__setattr__(self, key, MappingProxyType(dict(getattr(self, key))))

    @property
    def assumed(self) -> Assumed:
        """Prior knowledge of the camera on its body."""
        T_body_camera = self.T_body_camera
        if T_body_camera is None and self.mount is not None and self.T_body_base is not None:
            T_body_camera = self.T_body_base @ self.mount.T_base_camera
        if self.mount is None:
            return Assumed(None, T_body_camera, None)
        return Assumed(-self.mount.down, T_body_camera, self.mount.height_m)
