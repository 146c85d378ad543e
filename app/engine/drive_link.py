"""Link of the engine to the drive process, past the web process."""

from __future__ import annotations

from dataclasses import dataclass

from app.engine.sight import SightTeller
from app.engine.wayfinding import Wayfinder
from app.engine.wheel_feed import WheelFeed


@dataclass(frozen=True, eq=False)
class DriveLink:
    """Both directions of the link.

    Attributes:
        sight: tells of each frame. wheels: tell where the robots are.
        wayfinder: plans the observer's way.
    """

    sight: SightTeller
    wheels: WheelFeed
    wayfinder: Wayfinder
