"""The guard in a closed loop with a kinematic robot, sight and sonar made from the truth."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from observer.simulation.robots.floor import Outline

from .closed_loop import (
    AMIGO,
    SEEDS,
    TICK_S,
    Crosser,
    Lab,
    drive,
    ray,
    share,
    steady,
    wandering,
)


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.5])
def test_driving_over_free_floor_is_not_restricted(speed: float) -> None:
    lab = drive(Lab(x=-1.0), steady(speed), 5.0)
    assert share(lab, "stop") == 0
    assert share(lab, "clear") > 0.95
    assert lab.driven_m > 0.8 * speed * 5 - 0.5 * speed**2 / 0.3 - 0.4 * speed


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("ahead", ["wall", "box"])
def test_the_robot_stops_close_to_an_obstacle_ahead_without_contact(
    speed: float, ahead: str
) -> None:
    boxes = () if ahead == "wall" else (Outline.of_box(2.0, 0.1, 0.3, 0.4, 0.35),)
    lab = drive(Lab(boxes, x=4.0 if ahead == "wall" else 1.0), steady(speed), 12.0)
    assert lab.touched_mps == []
    gap = -_gap(lab)
    assert 0.05 < gap < 0.45


@pytest.mark.parametrize("speed", [-0.1, -0.3])
def test_reversing_stops_before_a_wall_detected_only_by_sonar(speed: float) -> None:
    lab = drive(Lab(x=-2.2), steady(speed), 8.0)
    assert lab.touched_mps == []
    assert lab.driven_m > 0.2


def test_the_robot_does_not_move_into_unseen_ground_without_sonar() -> None:
    for wish in (steady(0.3), steady(-0.3), steady(0.0, 0.5)):
        assert drive(Lab(), wish, 2.0, sonar=False).driven_m == 0


def test_a_crossing_robot_is_not_hit() -> None:
    touched, driven = [], []
    for seed in range(SEEDS or 6):
        rng = random.Random(seed)
        crosser = Crosser(
            rng.uniform(2.0, 2.6), 1.6, math.radians(-90 + rng.uniform(-15, 15)),
            rng.uniform(0.2, 0.5),
        )  # fmt: skip
        lab = Lab((), crosser, x=rng.uniform(-0.5, 0.3))
        drive(lab, steady((0.1, 0.3, 0.5)[seed % 3]), 8.0, seed)
        touched += lab.touched_mps
        driven.append(lab.driven_m)
    print(f"fastest contact {max(touched, default=0.0):.3f} m/s, driven {np.round(driven, 2)}")  # noqa: T201
    assert max(touched, default=0.0) < 0.05
    assert min(driven) > 0.3


def from_the_side(seed: int) -> tuple[float, Lab, float]:
    """Return the own speed, a lab with a robot crossing from beside the lane, and the duration."""
    rng = random.Random(seed)
    speed, its = rng.choice((0.1, 0.2, 0.3, 0.4, 0.5)), rng.uniform(0.2, 0.6)
    beside, side, slant = rng.uniform(0.8, 1.8), rng.choice((-1, 1)), rng.uniform(-0.4, 0.4)
    x, begins = -2.0, 2.2
    takes = beside / (its * math.cos(slant))
    meets = x + speed * (begins + takes - 0.5) + rng.uniform(-0.2, 0.3)
    crosser = Crosser(
        meets - math.sin(slant) * its * takes, side * (beside + 0.2),
        side * (slant - math.pi / 2), its, 3.0, begins,
    )  # fmt: skip
    return speed, Lab((), crosser, x=x), begins + takes + 1.0


def test_the_robot_usually_stops_for_someone_approaching_from_the_side() -> None:
    touched, reasons = [], set[str]()
    for seed in range(SEEDS or 10):
        speed, lab, seconds = from_the_side(seed)
        drive(lab, steady(speed), seconds, seed)
        touched.append(max(lab.touched_mps, default=0.0))
        reasons |= lab.reasons
    moving = sum(v > 0.05 for v in touched)
    print(f"{moving} of {len(touched)} touched the moving robot, at {max(touched):.2f} m/s most")  # noqa: T201
    # Without the sonar watch it would be every second one, at up to full speed.
    assert moving <= 0.1 * len(touched)
    assert any("approaching" in reason for reason in reasons)


@pytest.mark.parametrize("speed", [0.15, 0.4])
def test_boxes_and_a_door_frame_beside_the_path_do_not_count_as_approaching(speed: float) -> None:
    boxes = [Outline.of_box(x, y, x, 0.4, 0.3) for x, y in ((-1.3, 0.75), (-0.7, -0.7))]
    frame = [Outline.of_box(0.4, s * 1.55, 0.0, 0.12, 2.0) for s in (1, -1)]
    lab = drive(Lab((*boxes, *frame), x=-2.5), steady(speed), 7.0)
    assert lab.touched_mps == []
    assert not any("approaching" in reason for reason in lab.reasons)
    assert share(lab, "stop") == 0


def test_wandering_touches_nothing_and_is_rarely_stopped_in_an_open_room() -> None:
    touched, stops, ticks = [], 0, 0
    for seed in range(SEEDS or 6):
        rng = random.Random(100 + seed)
        boxes = tuple(
            Outline.of_box(4.3 * math.cos(a), 2.6 * math.sin(a), a, 0.5, 0.4)
            for a in (rng.uniform(0, 6.3) for _ in range(4))
        )
        lab = Lab(boxes, yaw=rng.uniform(-0.5, 0.5))
        drive(lab, wandering(seed, (0.15, 0.3, 0.5)[seed % 3]), 8.0, seed)
        touched += lab.touched_mps
        stops += lab.levels.get("stop", 0)
        ticks += sum(lab.levels.values())
    print(f"contacts {touched}, stopped {100 * stops / ticks:.1f} % of {ticks * TICK_S:.0f} s")  # noqa: T201
    assert touched == []
    assert stops < 0.1 * ticks


def _gap(lab: Lab) -> float:
    """Return the negative distance from the middle of the front to the obstacle ahead."""
    x = lab.x + AMIGO.length_m / 2 * math.cos(lab.yaw)
    y = lab.y + AMIGO.length_m / 2 * math.sin(lab.yaw)
    return -ray(lab.around(0.0).edges(), x, y, lab.yaw)
