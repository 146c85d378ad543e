"""A person in the simulated lab: figure, clothes, and carried box."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from observer.geometry import Pose
from observer.simulation.bodies import box_parts
from observer.simulation.facets import Material, Part, moved
from observer.simulation.motion import PlanarMotion
from observer.simulation.people.ellipsoids import Ellipsoids
from observer.simulation.people.figure import Cloth, Figure
from observer.simulation.people.gait import Gait
from observer.simulation.people.outfit import dressed
from observer.simulation.specs.people import PersonSpec
from observer.simulation.specs.places import BoxSpec, TextureSpec

# Shares of the height: extent of a walking person along the heading and across.
_LENGTH, _WIDTH = 0.36, 0.30
# The carried box: its size, metres, and where it is held, as shares of the height.
_CARRIED_M = (0.30, 0.42, 0.28)
_HELD_AHEAD, _HELD_ABOVE = 0.19, 0.56


@dataclass(frozen=True, eq=False)
class Person:
    """Build and clothes of one person.

    Attributes:
        size: length, width, height, metres, while walking. carried: in the body's frame.
    """

    figure: Figure
    outfit: Mapping[Cloth, Material]
    size: tuple[float, float, float]
    carried: tuple[Part, ...]

    @staticmethod
    def of(
        spec: PersonSpec, motion: PlanarMotion, texture: TextureSpec, duration_s: float, seed: int
    ) -> Person:
        """Build a person who walks along ``motion`` for a scenario's duration."""
        height = spec.height_m
        gait = Gait(motion, height, Figure.leg_m(height), spec.gesture, spec.swing, duration_s)
        return Person(
            Figure(height, spec.build, gait),
            dressed(spec.clothes, seed),
            (_LENGTH * height, _WIDTH * height * spec.build, height),
            _carried(height, texture, seed) if spec.gesture == "carry" else (),
        )

    def seen(self, T_camera_body: Pose, time: float) -> Ellipsoids:
        """Return the figure at an instant, in a camera's frame."""
        return self.figure.shape(time).moved(T_camera_body.rotation, T_camera_body.translation)


def _carried(height: float, texture: TextureSpec, seed: int) -> tuple[Part, ...]:
    box = BoxSpec(kind="cardboard", x=0, y=0, size=_CARRIED_M, above_m=_HELD_ABOVE * height)
    ahead = Pose(np.eye(3), np.array([_HELD_AHEAD * height, 0.0, 0.0]))
    return tuple(moved(part, ahead) for part in box_parts(box, texture, seed))
