"""Obstacles and true bodies as drawn in both Foxglove and ROS: box, velocity and label."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from observer.intervals import half_95
from observer.jsonl import MotionWord
from observer.recording.payloads import MatchedBody

Rgba = tuple[float, float, float, float]

VELOCITY: Rgba = (1.0, 0.3, 0.0, 0.9)
WHITE: Rgba = (1.0, 1.0, 1.0, 1.0)
_MOTIONS: dict[MotionWord, Rgba] = {
    "moving": (1.0, 0.85, 0.0, 0.45),
    "in_place": (0.45, 0.85, 0.45, 0.45),
    "stopped": (0.3, 0.6, 1.0, 0.45),
}
_COASTING: Rgba = (0.6, 0.6, 0.6, 0.3)
_TRUE: Rgba = (0.1, 0.9, 0.3, 1.0)
# An arrow's length is the distance travelled in one second.
_SHORTEST_ARROW_MPS = 0.02
_LABEL_ABOVE_M = 0.15


@dataclass(frozen=True)
class DrawnBody:
    """A body in the observation's world.

    Attributes:
        kind: ``obstacle``, or a true body's role. id: its number. name: for people.
        position: (3,) metres, its middle. wxyz, size: of its box, (3,) metres along the box's axes.
        velocity: (3,) m/s. color: of the box. text: of the label.
        true: whether it is ground truth.
    """

    kind: str
    id: int
    name: str
    position: Sequence[float]
    wxyz: Sequence[float]
    size: Sequence[float]
    velocity: Sequence[float]
    color: Rgba
    text: str
    true: bool = False

    @property
    def arrow_m(self) -> float:
        """Length of the velocity arrow; 0 for a body that hardly moves."""
        speed = math.hypot(*self.velocity)
        return speed if speed >= _SHORTEST_ARROW_MPS else 0.0

    def label_position(self, height_m: float) -> tuple[float, float, float]:
        """Return the place of the label above a box of this height."""
        x, y, z = self.position
        # y points down.
        return x, y - height_m / 2 - _LABEL_ABOVE_M, z


def drawn_obstacles(line: Mapping[str, Any]) -> list[DrawnBody]:
    """Return the obstacles of an observation's JSON line whose pose is known."""
    found = []
    for entry in line["obstacles"]:
        if entry["position"] is None or entry["orientation_wxyz"] is None:
            continue
        std = entry["speed_std"]
        sure = "" if std is None else f" ± {half_95(std):.2f}"
        found.append(
            DrawnBody(
                kind="obstacle",
                id=entry["id"],
                name=str(entry["id"]),
                position=entry["position"],
                wxyz=entry["orientation_wxyz"],
                size=entry["size"],
                velocity=entry["velocity"],
                color=_COASTING if entry["state"] == "coasting" else _MOTIONS[entry["motion"]],
                text=f"{entry['id']}: {entry['speed']:.2f}{sure} m/s",
            )
        )
    return found


def drawn_truth(bodies: Sequence[MatchedBody]) -> list[DrawnBody]:
    """Return true bodies, turned by their heading about the world's y, which points down."""
    found = []
    for body in bodies:
        length, width, height = body.size
        half_yaw = body.yaw / 2
        found.append(
            DrawnBody(
                kind=body.role,
                id=body.id,
                name=body.name,
                position=body.position,
                wxyz=(math.cos(half_yaw), 0.0, math.sin(half_yaw), 0.0),
                size=(width, height, length),
                velocity=body.velocity,
                color=_TRUE,
                text=f"{body.name}: {body.speed:.2f} m/s",
                true=True,
            )
        )
    return found
