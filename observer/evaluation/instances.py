"""Reported obstacles in the truth's world, for comparison with the ground truth."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Literal

import numpy as np

from observer.evaluation.lines import Line
from observer.geometry import Float64Array, Pose
from observer.truth.contract import TrueBody
from observer.types import BoxPx


@dataclass(frozen=True, eq=False)
class Instance:
    """A moving obstacle of one line, in the truth's world.

    Attributes:
        identity: segment and id. position: (3,) metres. velocity: (3,) m/s, at ``velocity_time``.
        velocity_cov: (3, 3), None where unknown. box_px: in the rectified left image.
    """

    identity: tuple[int, int]
    position: Float64Array
    velocity: Float64Array
    velocity_cov: Float64Array | None
    velocity_time: float
    speed: float
    box_px: BoxPx | None


def instances_of(
    line: Line,
    world: Pose,
    state: Literal["confirmed", "coasting"] = "confirmed",
    motions: Container[str] = ("moving",),
) -> list[Instance]:
    """Return the instances of a line that have one state.

    Args:
        world: ``T_truth_world`` of the line's segment. motions: reported motions to include.
    """
    R = world.rotation
    return [
        Instance(
            identity=(line.segment, entry.id),
            position=world.apply(entry.position),
            velocity=world.rotate(entry.velocity),
            velocity_cov=(
                None if entry.velocity_cov is None else R @ np.array(entry.velocity_cov) @ R.T
            ),
            velocity_time=entry.velocity_time,
            speed=entry.speed,
            box_px=entry.box_px,
        )
        for entry in line.obstacles
        if entry.state == state
        and entry.motion in motions
        and entry.position is not None
        and entry.velocity is not None
    ]


def centre_distance(body: TrueBody, instance: Instance) -> float:
    """Return the distance of an instance from a body's centre, metres."""
    return float(np.linalg.norm(body.position - instance.position))


def axis_distance(body: TrueBody, instance: Instance) -> float:
    """Return the distance of an instance from a body's upright axis, metres.

    Often only part of a tall body is seen, whose middle lies above or below the centre. The
    truth's world is upright except for the tilt of its first camera.
    """
    gap = instance.position - body.position
    half = float(body.size[2]) / 2
    gap[1] -= np.clip(gap[1], -half, half)
    return float(np.linalg.norm(gap))
