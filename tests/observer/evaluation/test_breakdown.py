"""Every class of the breakdown on one scene whose figures are known by hand."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import pytest

from observer.evaluation.breakdown import (
    Breakdown,
    break_down,
    breakdown_tables,
    direction_of,
)
from observer.evaluation.choices import LAB, ROAD
from observer.evaluation.counts import Episode, Sample, Tally
from observer.evaluation.lines import checked_lines
from observer.evaluation.tally import tally
from observer.geometry import Pose
from observer.truth.contract import TrueBody

DT = 0.1
FRAMES = 13

# Start and velocity, camera frame: x right, z forward. The camera stands still at the origin.
BODIES: dict[int, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    1: ((-0.1, 0.0, 1.5), (0.1, 0.0, 0.0)),  # < 2 m, slow, lateral
    2: ((0.0, 0.0, 2.8), (0.0, 0.0, -0.3)),  # 2-3 m, radial
    3: ((0.0, 0.0, 3.5), (0.3, 0.0, 0.3)),  # 3-4 m, 0.42 m/s, diagonal, two faces seen
    4: ((-0.5, 0.0, 5.0), (0.8, 0.0, 0.0)),  # > 4 m, fast, lateral
    5: ((-0.3, 0.0, 8.0), (0.5, 0.0, 0.0)),  # > 4 m, lateral, never reported
}


class Scene:
    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        return tuple(
            TrueBody(
                id=number,
                name=f"robot {number}",
                role="obstacle",
                position=np.array(start) + time * np.array(velocity),
                velocity=np.array(velocity),
                size=np.array([0.45, 0.38, 0.24]),
                yaw=float(np.arctan2(velocity[0], velocity[2])),
                visible=1.0,
                commanded_speed=None,
            )
            for number, (start, velocity) in BODIES.items()
        )

    def camera_pose(self, time: float) -> Pose:
        assert np.isfinite(time)
        return Pose.identity()


def report(body: TrueBody, time: float) -> dict[str, Any]:
    """Return the run's report of a body, with errors of known size."""
    error = {1: (0.03, 0.04, 0.0), 2: (0.0, 0.0, -0.1)}.get(body.id, (0.0, 0.0, 0.0))
    velocity = body.velocity + error
    offset = (0.0, 0.1, 0.0) if body.id == 3 else (0.0, 0.0, 0.0)
    # Body 2 claims 0.03 m/s and errs by 0.1: outside its 95 %. Body 4 states no uncertainty.
    variance = {1: 0.01, 2: 0.0009, 3: 0.01}.get(body.id)
    return {
        "id": body.id,
        "state": "confirmed",
        "motion": "moving",
        "position": (body.position + offset).tolist(),
        "velocity": velocity.tolist(),
        "speed": float(np.linalg.norm(velocity)),
        "velocity_cov": None if variance is None else (variance * np.eye(3)).tolist(),
        "velocity_time": time - DT / 2,
    }


def counted() -> Tally:
    lines = []
    for frame in range(FRAMES):
        time = frame * DT
        reported = [b for b in Scene().bodies(time) if b.id != 5 and (b.id != 1 or frame >= 9)]
        lines.append(
            {
                "frame": frame,
                "time": time,
                "segment": 0,
                "status": "degraded" if frame == 0 else "ok",
                "pose": {"position": [0, 0, 0], "orientation_wxyz": [1, 0, 0, 0]},
                "obstacles": [report(b, time) for b in reported],
            }
        )
    return tally(checked_lines(lines), Scene())


@pytest.fixture(scope="module")
def scene() -> Breakdown:
    run = counted()
    faulty = replace(run, samples=[s for s in run.samples if s.range_m < 2])
    return break_down([run], LAB, {"ideal": [run], "faulty": [faulty]})


SLOW_SPEED_ERROR = float(np.hypot(0.13, 0.04) - 0.1)
# label: (count, matched, speed RMSE, velocity RMSE, centre RMSE, coverage)
EXPECTED = {
    "by_range": {
        "< 2 m": (7, 4, SLOW_SPEED_ERROR, 0.05, None, 1.0),
        "2-3 m": (7, 7, 0.1, 0.1, None, 0.0),
        "3-4 m": (7, 7, 0.0, 0.0, 0.1, 1.0),
        "> 4 m": (14, 7, 0.0, 0.0, None, None),
    },
    "by_speed": {
        "0.05-0.2 m/s": (7, 4, SLOW_SPEED_ERROR, 0.05, None, 1.0),
        "0.2-0.4 m/s": (7, 7, 0.1, 0.1, None, 0.0),
        "0.4-0.7 m/s": (14, 7, 0.0, 0.0, 0.1, 1.0),
        "> 0.7 m/s": (7, 7, 0.0, 0.0, None, None),
    },
    "by_direction": {
        # Four pairs of body 1 and seven of body 4.
        "lateral": (
            21,
            11,
            SLOW_SPEED_ERROR * np.sqrt(4 / 11),
            0.05 * np.sqrt(4 / 11),
            None,
            1.0,
        ),
        "diagonal": (7, 7, 0.0, 0.0, 0.1, 1.0),
        "radial": (7, 7, 0.1, 0.1, None, 0.0),
    },
    "by_kind": {
        "ideal": (
            35,
            25,
            np.sqrt((4 * SLOW_SPEED_ERROR**2 + 7 * 0.1**2) / 25),
            np.sqrt((4 * 0.05**2 + 7 * 0.1**2) / 25),
            0.1,
            11 / 18,
        ),
        "faulty": (7, 4, SLOW_SPEED_ERROR, 0.05, None, 1.0),
    },
}


@pytest.mark.parametrize("grouping", EXPECTED)
def test_every_class_has_exactly_its_samples_figures(scene: Breakdown, grouping: str) -> None:
    groups = getattr(scene, grouping)
    assert [g.label for g in groups] == list(EXPECTED[grouping])
    for g in groups:
        count, matched, speed, velocity, centre, coverage = EXPECTED[grouping][g.label]
        assert (g.count, g.matched) == (count, matched)
        assert g.recall == pytest.approx(matched / count)
        for found, expected in (
            (g.speed_rmse_mps, speed),
            (g.velocity_rmse_mps, velocity),
            (g.centre_rmse_m, centre),
            (g.coverage, coverage),
        ):
            assert (found is None) == (expected is None), g
            if expected is not None:
                assert found == pytest.approx(expected, abs=1e-9), g


def test_delays_are_grouped_by_initial_direction(scene: Breakdown) -> None:
    found = {d.label: (d.episodes, d.missed, d.median_s) for d in scene.delays}
    assert found == {
        # 0.9 s, 0 s and never.
        "lateral": (3, 1, pytest.approx(0.9)),
        "diagonal": (1, 0, 0.0),
        "radial": (1, 0, 0.0),
        "radial, started within 3 m": (1, 0, 0.0),
    }


def test_motion_started_farther_away_is_not_counted_as_near() -> None:
    far = Tally(episodes=[Episode(1, 0.0, 2.0, range_m=3.2, radial=1.0, first_seen=1.0)])
    near = {d.label: d for d in break_down([far]).delays}
    assert near["radial"].median_s == 1.0
    assert near["radial, started within 3 m"].episodes == 0
    assert near["radial, started within 3 m"].median_s is None


def test_detection_only_runs_give_no_errors_but_are_counted() -> None:
    run = replace(counted(), scored_for="detection")
    both = break_down([run, counted()])
    alone = break_down([run])
    for g, whole, double in zip(
        alone.by_range, break_down([counted()]).by_range, both.by_range, strict=True
    ):
        assert (g.speed_rmse_mps, g.velocity_rmse_mps, g.centre_rmse_m) == (None, None, None)
        assert (g.count, g.recall, g.coverage) == (whole.count, whole.recall, whole.coverage)
        assert double.count == 2 * whole.count
        assert double.velocity_rmse_mps == whole.velocity_rmse_mps


@pytest.mark.parametrize(
    ("radial", "direction"),
    [
        (0.0, "lateral"),
        (0.349, "lateral"),
        (0.35, "diagonal"),
        (0.849, "diagonal"),
        (0.85, "radial"),
        (1.0, "radial"),
    ],
)
def test_direction_of_classifies_by_radial_share(radial: float, direction: str) -> None:
    assert direction_of(radial) == direction


def test_limit_belongs_to_the_class_above_it() -> None:
    samples = [Sample(r, v, 0.0, matched=True) for r, v in ((2, 0.2), (3, 0.4), (4, 0.7))]
    groups = break_down([Tally(samples=samples)])
    assert [g.count for g in groups.by_range] == [0, 1, 1, 1]
    assert [g.count for g in groups.by_speed] == [0, 1, 1, 1]


def test_road_has_its_own_classes() -> None:
    samples = [Sample(r, v, 1.0, matched=False) for r, v in ((9, 4), (10, 5), (29, 9), (60, 15))]
    groups = break_down([Tally(samples=samples)], ROAD)
    assert {g.label: g.count for g in groups.by_range} == {
        "< 10 m": 1,
        "10-20 m": 1,
        "20-30 m": 1,
        "> 30 m": 1,
    }
    assert {g.label: g.count for g in groups.by_speed} == {
        "< 5 m/s": 1,
        "5-10 m/s": 2,
        "> 10 m/s": 1,
    }


def test_robots_and_people_are_separated_when_the_kind_is_known() -> None:
    samples = [
        Sample(2, 0.4, 0.0, matched=True, box_iou=0.8, kind="robot"),
        Sample(2, 0.4, 0.0, matched=True, box_iou=0.5, kind="person"),
        Sample(2, 0.4, 0.0, matched=True, box_iou=0.3, kind="person"),
        Sample(2, 0.4, 0.0, matched=False, kind="person"),
        Sample(2, 0.4, 0.0, matched=False, kind="person", flagged=True),
    ]
    robots, people = break_down([Tally(samples=samples)]).by_body
    assert (robots.label, robots.count, robots.recall, robots.box_iou_median) == (
        "robots", 1, 1.0, 0.8,
    )  # fmt: skip
    assert (people.label, people.count, people.recall) == ("people", 4, 0.5)
    assert people.box_iou_median == pytest.approx(0.4)
    assert (robots.unflagged_misses, people.unflagged_misses) == (0, 1)
    assert [g.label for g in break_down([counted()]).by_body] == ["unknown"]


def test_breakdown_is_written_as_json_and_tables(scene: Breakdown) -> None:
    again = json.loads(json.dumps(asdict(scene), allow_nan=False))
    assert again["by_range"][0]["label"] == "< 2 m"
    assert again["delays"][0]["median_s"] == pytest.approx(0.9)
    text = breakdown_tables({"paper": scene, "default": scene})
    assert "| 3-4 m | default | 7 | 1.000 | 0.000 | 0.000 | 0.100 | 1.000 | - | 0 |" in text
    assert "| lateral | paper | 3 | 1 | 0.900 |" in text
    alone = breakdown_tables({"": break_down([counted()])})
    assert "| 3-4 m | 7 | 1.000 | 0.000 | 0.000 | 0.100 | 1.000 | - | 0 |" in alone
    assert "| lateral | 3 | 1 | 0.900 |" in alone
    assert "scenarios" not in alone
