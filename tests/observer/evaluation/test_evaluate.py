"""The metrics, on runs whose right answer is known by hand."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

import numpy as np
import pytest

from observer.evaluation.choices import ROAD_GATE_M
from observer.evaluation.evaluate import FIGURE_TITLES, summarise
from observer.evaluation.lines import checked_lines
from observer.evaluation.results import FALSE_LISTED, listed
from observer.evaluation.tally import tally
from observer.geometry import Pose
from observer.truth.contract import TrueBody
from observer.truth.sampled import SampledTruth, TruthSample

from .hand_made import DT, RIGHT, SIZE, StraightTruth, entry, evaluate, line, perfect


def test_perfect_run_scores_perfectly() -> None:
    truth = StraightTruth(RIGHT)
    result = evaluate(perfect(truth, 20), truth)
    # Evaluation starts at 0.6 s: frames 6 to 19.
    assert result.truth_count == result.matched == 14
    assert result.recall == result.mota == result.coverage == 1.0
    assert result.false == result.surplus_boxes == result.identity_switches == 0
    assert result.speed_rmse_mps == pytest.approx(0, abs=1e-12)
    assert result.velocity_rmse_mps == pytest.approx(0, abs=1e-12)
    assert result.motp_m == pytest.approx(0, abs=1e-12)
    assert (result.episodes, result.episodes_missed, result.delay_median_s) == (1, 0, 0.0)


def test_known_errors_are_measured() -> None:
    truth = StraightTruth(RIGHT)
    lines = perfect(truth, 20, offset=(0.0, 0.0, -0.19), error=(0.03, 0.04, 0.0))
    result = evaluate(lines, truth)
    assert result.velocity_rmse_mps == pytest.approx(0.05)
    assert result.speed_rmse_mps == pytest.approx(np.hypot(0.43, 0.04) - 0.4)
    assert result.speed_bias_mps == pytest.approx(np.hypot(0.43, 0.04) - 0.4)
    assert result.motp_m == pytest.approx(0.19)


def test_misses_and_delay_are_measured() -> None:
    truth = StraightTruth(RIGHT)
    lines = [line(k, [] if k < 9 else [entry(truth, k * DT)]) for k in range(20)]
    result = evaluate(lines, truth)
    assert result.recall == pytest.approx(11 / 14)
    assert result.mota == pytest.approx(11 / 14)
    assert result.delay_median_s == pytest.approx(0.9)
    nothing = evaluate([line(k, []) for k in range(20)], truth)
    assert nothing.recall == 0
    assert nothing.delay_median_s is None
    assert nothing.episodes_missed == 1
    assert nothing.speed_rmse_mps is None
    assert nothing.coverage is None


@pytest.mark.parametrize(("gate", "false"), [(0.5, 20), (ROAD_GATE_M, 0)])
def test_report_far_from_every_body_is_false(gate: float, false: int) -> None:
    truth = StraightTruth(RIGHT)
    far = perfect(truth, 20, offset=(0.0, 0.0, 1.0))
    result = evaluate(far, truth, gate_m=gate)
    assert result.false == false
    assert result.false_per_100_frames == 5 * false
    assert result.recall == (0.0 if false else 1.0)
    if false:
        assert result.mota == pytest.approx(1 - (14 + 20) / 14)


def test_false_instances_record_position_and_time() -> None:
    paths = {1: ((-1.0, 0.0, 3.0), (0.4, 0.0, 0.0)), 2: ((1.0, 0.0, 4.0), (0.0, 0.0, 0.0))}
    camera = Pose.from_rotvec((0, 0, 0), (0.0, 0.0, 1.0))
    truth = StraightTruth(paths, camera=camera)
    # Seen from a camera 1 m ahead of the truth's origin, and reported in that camera's world.
    ghost = entry(truth, 0.3, 1, id=42) | {"position": [1.0, 0.3, 3.4], "speed": 0.2}
    lines = [line(k, [ghost] if k == 3 else []) for k in range(5)]
    counted = tally(checked_lines(lines), truth)
    (found,) = counted.false
    assert (found.frame, found.segment, found.time, found.id) == (3, 0, pytest.approx(0.3), 42)
    assert found.position == pytest.approx((1.0, 0.3, 4.4))
    assert found.speed_mps == 0.2
    assert found.range_m == pytest.approx(np.sqrt(1 + 0.09 + 3.4**2))
    assert (found.nearest_id, found.nearest_moving) == (2, False)
    # From the body's upright axis, because often only part of a tall body is seen.
    assert found.nearest_m == pytest.approx(np.hypot(0.4, 0.3 - SIZE[2] / 2))
    assert counted.moved
    json.dumps(asdict(found), allow_nan=False)


def test_false_instances_are_listed_up_to_a_limit() -> None:
    truth = StraightTruth({})
    lines = [line(k, [entry(StraightTruth(RIGHT), k * DT)]) for k in range(FALSE_LISTED + 5)]
    counted = tally(checked_lines(lines), truth)
    assert not counted.moved
    result = listed(tuple(counted.false))
    assert len(result["false_instances"]) == FALSE_LISTED
    assert result["false_instances_left_out"] == 5
    assert result["false_instances"][0]["nearest_id"] is None
    assert summarise([counted]).false == FALSE_LISTED + 5


def test_degraded_and_lost_frames_are_counted() -> None:
    truth = StraightTruth(RIGHT)
    lines = [
        line(k, [], status=status)
        for k, status in enumerate(["degraded", "ok", "lost", "lost", "ok"])
    ]
    result = evaluate(lines, truth)
    assert (result.frames_degraded, result.frames_lost) == (1, 2)


def test_episode_direction_is_that_of_its_first_moments() -> None:
    """It comes near head-on and turns aside a second later."""

    class Turning(StraightTruth):
        def bodies(self, time: float) -> tuple[TrueBody, ...]:
            (b,) = super().bodies(time)
            velocity = np.array([0.0, 0.0, -0.4] if time < 1 else [0.4, 0.0, 0.0])
            return (TrueBody(**{**b.__dict__, "velocity": velocity}),)

    truth = Turning({1: ((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))})
    counted = tally(checked_lines([line(k, []) for k in range(40)]), truth)
    (episode,) = counted.episodes
    assert episode.radial == pytest.approx(1.0)
    assert episode.range_m == pytest.approx(3.0)


def test_report_of_a_parked_body_is_false() -> None:
    parked = StraightTruth({1: ((0.0, 0.0, 2.0), (0.04, 0.0, 0.0))})
    result = evaluate(perfect(parked, 10), parked)
    assert result.false == 10
    assert result.truth_count == 0
    assert result.recall is None
    assert result.mota is None


@pytest.mark.parametrize(
    "change",
    [{"state": "tentative"}, {"state": "coasting"}, {"motion": "stopped"}, {"position": None}],
)
def test_only_confirmed_moving_and_located_obstacles_are_instances(change: dict[str, Any]) -> None:
    truth = StraightTruth(RIGHT)
    result = evaluate(perfect(truth, 20, **change), truth)
    assert result.matched == result.false == 0
    far = (
        evaluate(perfect(truth, 20, offset=(0, 0, 2.0), **change), truth)
        if (change.get("position", 0) is not None)
        else result
    )
    assert far.false == 0


@pytest.mark.parametrize(("visible", "counted"), [(1.0, 14), (0.5, 14), (0.4, 0), (None, 14)])
def test_only_half_visible_bodies_count_and_others_are_not_false(
    visible: float | None, counted: int
) -> None:
    truth = StraightTruth(RIGHT, visible=visible)
    result = evaluate(perfect(truth, 20), truth)
    assert result.truth_count == counted
    assert result.false == result.surplus_boxes == 0


def test_own_robot_is_not_ground_truth() -> None:
    truth = StraightTruth(RIGHT, role="observer")
    result = evaluate(perfect(truth, 10), truth)
    assert result.truth_count == 0
    assert result.false == 10


def test_second_report_of_one_obstacle_is_a_surplus_box() -> None:
    truth = StraightTruth(RIGHT)
    lines = perfect(truth, 20)
    for k, each in enumerate(lines):
        each["obstacles"].append(entry(truth, k * DT, id=99, offset=(0.2, 0, 0)))
    result = evaluate(lines, truth)
    assert result.false == 0
    assert result.surplus_boxes == 14
    assert result.surplus_boxes_per_100_frames == pytest.approx(70)
    assert result.identity_switches == 0
    assert result.mota == pytest.approx(0.0)


def test_match_persists_while_possible() -> None:
    """A nearer newcomer does not take over, as in CLEAR-MOT."""
    truth = StraightTruth(RIGHT)
    lines = perfect(truth, 20, offset=(0.3, 0, 0))
    for k, each in enumerate(lines[10:], 10):
        each["obstacles"].append(entry(truth, k * DT, id=99))
    result = evaluate(lines, truth)
    assert result.identity_switches == 0
    assert result.motp_m == pytest.approx(0.3)


def test_identity_change_is_a_switch_even_after_a_gap() -> None:
    truth = StraightTruth(RIGHT)
    lines = perfect(truth, 20)
    lines[9]["obstacles"][0]["id"] = 8
    lines[10]["obstacles"] = []
    for each in lines[11:]:
        each["obstacles"][0]["id"] = 9
    result = evaluate(lines, truth)
    assert result.identity_switches == 2
    assert result.mota == pytest.approx(1 - 3 / 14)


def test_two_crossing_bodies_are_matched_one_to_one() -> None:
    paths = {1: ((-0.5, 0.0, 3.0), (0.4, 0.0, 0.0)), 2: ((0.6, 0.0, 3.2), (-0.4, 0.0, 0.0))}
    truth = StraightTruth(paths)
    lines = perfect(truth, 28)
    for each in lines:
        each["obstacles"].reverse()
    result = evaluate(lines, truth)
    assert result.truth_count == result.matched == 44
    assert result.identity_switches == 0
    assert result.velocity_rmse_mps == pytest.approx(0, abs=1e-12)


def test_velocity_is_compared_at_its_own_timestamp() -> None:
    class Accelerating(StraightTruth):
        def bodies(self, time: float) -> tuple[TrueBody, ...]:
            (b,) = super().bodies(time)
            velocity = np.array([0.4 + time, 0, 0])
            return (TrueBody(**{**b.__dict__, "velocity": velocity}),)

    truth = Accelerating(RIGHT)
    lines = []
    for k in range(20):
        report = entry(truth, k * DT)
        report["velocity"] = [0.4 + (k - 0.5) * DT, 0, 0]
        report["speed"] = abs(report["velocity"][0])
        lines.append(line(k, [report]))
    assert evaluate(lines, truth).velocity_rmse_mps == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("sigma", "coverage"), [(0.1, 0.95), (0.05, 0.417), (1.0, 1.0)])
def test_coverage_is_the_share_within_the_stated_95_percent(sigma: float, coverage: float) -> None:
    rng = np.random.default_rng(0)
    truth = StraightTruth({1: ((-1.0, 0.0, 3.0), (0.4, 0.0, 0.0))})
    cov = (np.eye(3) * sigma**2).tolist()
    lines = [
        line(k, [entry(truth, k * DT, error=rng.normal(0, 0.1, 3), velocity_cov=cov)])
        for k in range(2000)
    ]
    assert evaluate(lines, truth).coverage == pytest.approx(coverage, abs=0.03)


def test_reports_without_covariance_do_not_affect_the_coverage() -> None:
    truth = StraightTruth(RIGHT)
    result = evaluate(perfect(truth, 20, velocity_cov=None), truth)
    assert result.matched == 14
    assert result.coverage is None


def test_position_is_compared_with_surface_and_centre() -> None:
    """Seen from a corner, two faces are visible and the centre counts; seen from behind, one is."""
    ahead = StraightTruth({1: ((0.0, 0.0, 2.0), (0.0, 0.0, 0.4))})
    one_face = evaluate(perfect(ahead, 20, offset=(0, 0, -SIZE[0] / 2)), ahead)
    assert one_face.surface_rmse_m == pytest.approx(0, abs=1e-9)
    assert one_face.centre_rmse_m is None
    corner = StraightTruth({1: ((0.0, 0.0, 2.0), (0.3, 0.0, 0.3))})
    two_faces = evaluate(perfect(corner, 20, offset=(0, 0.1, 0)), corner)
    assert two_faces.centre_rmse_m == pytest.approx(0.1)
    assert two_faces.surface_rmse_m > 0.1


def test_later_segment_is_placed_by_the_true_camera_pose() -> None:
    turned = Pose.from_rotvec((0, 0.5, 0), (1.0, 0, 2.0))
    truth = StraightTruth(RIGHT, camera=turned)
    lines = []
    for k in range(20):
        report = entry(truth, k * DT)
        for name, moved in (
            ("position", turned.inverse().apply),
            ("velocity", turned.inverse().rotate),
        ):
            report[name] = moved(report[name]).tolist()
        lines.append(line(k, [report], segment=1))
    result = evaluate(lines, truth)
    assert result.recall == 1.0
    assert result.motp_m == pytest.approx(0, abs=1e-9)
    assert result.velocity_rmse_mps == pytest.approx(0, abs=1e-9)
    unknown = StraightTruth(RIGHT)
    left_out = evaluate(lines, unknown)
    assert left_out.frames == 0
    assert left_out.frames_without_world == 20
    assert left_out.recall is None


def test_a_frame_at_which_nothing_is_known_counts_neither_way() -> None:
    truth = StraightTruth(RIGHT, camera=Pose.identity())
    lines = perfect(truth, 20)
    samples = tuple(
        TruthSample(k, k * DT, truth.bodies(k * DT), truth.camera_pose(k * DT))
        for k in range(20)
        if k not in (12, 19)
    )
    found = evaluate(lines, SampledTruth(samples))
    # One missing sample is interpolated; at the end there is none to interpolate with.
    assert (found.frames, found.frames_without_truth, found.false) == (19, 1, 0)


@pytest.mark.parametrize("known", [range(10), range(10, 20)])
def test_frames_before_and_after_the_truth_count_neither_way(known: range) -> None:
    truth = StraightTruth(RIGHT, camera=Pose.identity())
    samples = tuple(
        TruthSample(k, k * DT, truth.bodies(k * DT), truth.camera_pose(k * DT)) for k in known
    )
    found = evaluate(perfect(truth, 20), SampledTruth(samples))
    assert (found.frames, found.frames_without_truth, found.false) == (10, 10, 0)


def test_several_runs_are_summarised_together() -> None:
    truth = StraightTruth(RIGHT)
    good = tally(checked_lines(perfect(truth, 20)), truth)
    bad = tally(checked_lines([line(k, []) for k in range(20)]), truth)
    both = summarise([good, bad])
    assert both.frames == 40
    assert both.recall == 0.5
    assert both.episodes == 2
    assert summarise([]).recall is None


def test_brief_motion_in_view_is_not_an_episode() -> None:
    truth = StraightTruth(RIGHT)
    result = evaluate([line(k, []) for k in range(5)], truth)
    assert result.truth_count == 0
    assert result.episodes == 0


def test_figures_as_dictionary_and_table() -> None:
    truth = StraightTruth(RIGHT)
    result = evaluate(perfect(truth, 20), truth)
    again = json.loads(json.dumps(result.as_dict(), allow_nan=False))
    assert again["recall"] == 1.0
    table = result.markdown().splitlines()
    assert len(table) == len(FIGURE_TITLES) + 2
    assert "| recall | 1.000 |" in table
    empty = evaluate([line(0, [])], truth).markdown()
    assert "| recall | - |" in empty
