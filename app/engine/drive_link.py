"""Direct link from the engine to the drive process, bypassing the web process."""

from __future__ import annotations

from dataclasses import dataclass

from app.engine.sight import SightWriter
from app.engine.wayfinding import Wayfinder
from app.engine.wheel_feed import WheelFeed


@dataclass(frozen=True, eq=False)
class DriveLink:
    """Both directions of the link.

    Attributes:
        sight: sends the sight of each frame. wheels: receives the wheel odometry.
        wayfinder: plans the observer's path.
    """

    sight: SightWriter
    wheels: WheelFeed
    wayfinder: Wayfinder
