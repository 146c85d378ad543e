"""Answers from evidence gathered over time, on arrays; every promised change is tried."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from observer.camera import StereoCamera
from observer.explanation import PixelAnswer, PixelVerdict, explain_pixel
from observer.geometry import Pose
from observer.methods.planar.ego_motion import PlanarEgoMotion
from observer.methods.rigid.point_motion import PointEvidence
from observer.parameters import Parameters
from observer.types import Status, Unseen

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
HERE = (200.0, 100.0)
EGO = PlanarEgoMotion(
    "rigid", Status.OK, (), np.arange(50) < 45, None, None, Pose.identity(), None, 0.2
)
TESTS = 40
RATE = 0.01
PARAMETERS = Parameters().changed({"evidence.false_alarms_per_frame": RATE})
THRESHOLD = float(np.sqrt(chi2.isf(RATE / TESTS, df=3)))


def evidence(significance: Any, **changes: Any) -> PointEvidence:
    """Features in a row from ``HERE`` to the right, 2 px apart, nearest first."""
    length = np.atleast_1d(np.asarray(significance, dtype=np.float64))
    count = len(length)
    px = np.stack([HERE[0] + 2 * np.arange(count), np.full(count, HERE[1])], axis=1)
    std = np.full(count, 0.05)
    made = PointEvidence(
        px=px.astype(np.float32),
        depth=np.full(count, 3.0),
        age_s=np.full(count, 0.6),
        velocity=np.stack([length * std, 0 * std, 0 * std], axis=1),
        velocity_std=std,
        significance=length,
        threshold=THRESHOLD,
        dynamic=length > THRESHOLD,
        neighbours=np.full(count, 12),
        obstacle_id=np.where(length > THRESHOLD, 3, -1),
        cornered=np.ones(count, np.bool_),
        recurs=np.zeros(count, np.bool_),
        on_outline=np.zeros(count, np.bool_),
    )
    return replace(made, **changes)


def ask(made: PointEvidence, px: tuple[float, float] = HERE) -> PixelAnswer:
    return explain_pixel({"ego_motion": EGO, "evidence": made}, CAMERA, PARAMETERS, px)


def test_significant_motion_is_dynamic_with_its_figures() -> None:
    answer = ask(evidence([9.0] * 4 + [1.0]))
    assert answer.verdict is PixelVerdict.DYNAMIC
    assert "obstacle 3" in answer.sentence
    assert "0.45 m/s" in answer.sentence
    assert answer.numbers == {
        "features_near": 5,
        "nearest_feature_px": 0.0,
        "depth_m": 3.0,
        "age_s": 0.6,
        "speed_mps": pytest.approx(0.45),
        "speed_std_mps": 0.05,
        "least_speed_mps": pytest.approx(0.05 * THRESHOLD),
        "significance": 9.0,
        "threshold": THRESHOLD,
        "neighbours": 12,
        "inliers": 45,
        "matches": 50,
    }
    loose = ask(evidence(9.0, obstacle_id=np.array([-1])))
    assert "not yet part of an obstacle" in loose.sentence


def test_the_majority_of_the_nearest_features_decides() -> None:
    assert ask(evidence([1.0, 9.0, 9.0])).verdict is PixelVerdict.DYNAMIC
    assert ask(evidence([9.0, 1.0, 1.0])).verdict is PixelVerdict.STATIC
    # Of two, the nearer one decides; features beyond the radius do not count.
    assert ask(evidence([9.0, 1.0])).verdict is PixelVerdict.DYNAMIC
    far = evidence([1.0] + [9.0] * 4)
    far.px[1:, 1] += 20
    assert ask(far).verdict is PixelVerdict.STATIC


def test_noise_is_static_and_the_least_detectable_speed_is_stated() -> None:
    answer = ask(evidence([0.5, 1.0, 1.5]))
    assert answer.verdict is PixelVerdict.STATIC
    assert answer.numbers["significance"] == 1.0
    assert f"faster than {0.05 * THRESHOLD:.2f} m/s" in answer.would_change


def test_between_noise_and_the_threshold_it_is_undecided() -> None:
    assert THRESHOLD > 4
    assert ask(evidence(3.9)).verdict is PixelVerdict.UNDECIDED
    assert ask(evidence(3.3)).verdict is PixelVerdict.STATIC


def test_young_features_are_undecided_until_the_stated_time() -> None:
    answer = ask(evidence([1.0], age_s=np.array([0.07])))
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert "0.13 s more" in answer.would_change
    assert ask(evidence([1.0], age_s=np.array([0.07 + 0.14]))).verdict is PixelVerdict.STATIC


def test_unjudged_features_are_undecided() -> None:
    answer = ask(evidence(0.0, age_s=np.array([0.4])))
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert "evidence.min_sightings" in answer.would_change


def test_too_few_agreeing_features_are_undecided() -> None:
    alone = evidence(9.0, neighbours=np.array([1]), dynamic=np.array([False]))
    answer = ask(alone)
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert "only 1 feature here agrees" in answer.sentence
    assert "evidence.min_points at 1" in answer.would_change


def test_a_feature_without_depth_is_undecided_unless_it_moves() -> None:
    nowhere = np.array([np.nan])
    standing = ask(evidence(1.0, depth=nowhere))
    assert standing.verdict is PixelVerdict.UNDECIDED
    assert standing.numbers["depth_m"] is None
    assert ask(evidence(9.0, depth=nowhere)).verdict is PixelVerdict.DYNAMIC


def test_it_is_too_far_where_a_slow_walk_is_undetectable() -> None:
    # The noise of a velocity grows with the depth squared.
    def at(depth: float, age: float = 0.6, length: float = 1.0) -> PixelAnswer:
        std = np.array([0.3 * (depth / 20.0) ** 2])
        return ask(
            evidence(length, depth=np.array([depth]), velocity_std=std, age_s=np.array([age]))
        )

    far = at(30.0)
    assert far.verdict is PixelVerdict.TOO_FAR
    assert "at 30.0 m" in far.sentence
    assert f"faster than {0.3 * 1.5**2 * THRESHOLD:.1f} m/s" in far.sentence
    near = float(re.search(r"Within about ([\d.]+) m", far.would_change).group(1))
    assert at(near - 0.1).verdict is PixelVerdict.STATIC
    assert at(near + 0.1).verdict is PixelVerdict.TOO_FAR
    assert at(30.0, length=9.0).verdict is PixelVerdict.DYNAMIC
    # A young feature's velocity may still become more certain.
    young = at(30.0, age=0.4)
    assert young.verdict is PixelVerdict.UNDECIDED
    assert "evidence.memory_s" in young.would_change
    # The range of the displayed cloud does not limit what is judged.
    cut = PARAMETERS.changed({"stereo.max_depth_m": 2.0})
    trace = {"ego_motion": EGO, "evidence": evidence(1.0)}
    assert explain_pixel(trace, CAMERA, cut, HERE).verdict is PixelVerdict.STATIC


def test_obstacle_features_are_dynamic_while_the_obstacle_is_tracked() -> None:
    seen = ask(evidence([6.0] * 5 + [1.0]))
    assert "as long as it is tracked" in seen.would_change
    assert "obstacles.min_points at 6 or above (now 3)" in seen.would_change
    many = ask(evidence([6.0] * 60))
    assert "No value of obstacles.min_points" in many.would_change
    stopped = ask(evidence(1.0, dynamic=np.array([True]), obstacle_id=np.array([3])))
    assert stopped.verdict is PixelVerdict.DYNAMIC
    assert "It is part of obstacle 3, which was seen to move" in stopped.sentence
    assert "obstacle 3 would not be seen" in stopped.would_change


def test_an_unconfirmed_obstacle_is_mentioned_without_a_number() -> None:
    made = evidence(9.0, dynamic=np.array([True]), obstacle_id=np.array([-2]))
    answer = ask(made)
    assert "an unconfirmed obstacle" in answer.sentence
    assert "an unconfirmed obstacle would not be seen" in answer.would_change
    assert "-2" not in answer.sentence + answer.would_change


def test_unjudged_features_have_no_speed() -> None:
    answer = ask(evidence(0.0, age_s=np.array([0.07])))
    assert answer.numbers["speed_mps"] is None
    assert answer.numbers["speed_std_mps"] is None
    assert answer.numbers["least_speed_mps"] is None


def test_the_nearest_feature_decides_within_the_tracking_spacing() -> None:
    """One is tracked per square of ``klt_tracking.spacing_px`` and speaks for pixels around it."""
    lonely = ask(evidence([9.0, 1.0, 1.0]), (HERE[0] - 17, HERE[1]))
    assert lonely.verdict is PixelVerdict.DYNAMIC
    assert lonely.numbers["nearest_feature_px"] == 17
    assert ask(evidence(9.0), (HERE[0] - 19, HERE[1])).verdict is PixelVerdict.TOO_FEW_FEATURES


def test_without_a_nearby_feature_there_are_too_few() -> None:
    answer = ask(evidence(1.0), (HERE[0] + 40, HERE[1]))
    assert answer.verdict is PixelVerdict.TOO_FEW_FEATURES
    assert answer.numbers["nearest_feature_px"] == 40
    nothing = ask(evidence(np.empty(0)))
    assert nothing.verdict is PixelVerdict.TOO_FEW_FEATURES
    assert nothing.numbers["nearest_feature_px"] is None


def test_without_a_feature_the_texture_determines_the_advice() -> None:
    plain = np.full((256, 512), 90, np.uint8)
    noise = np.random.default_rng(0).integers(0, 256, (256, 512)).astype(np.uint8)
    faint = (90 + (noise.astype(float) - 128) / 128).astype(np.uint8)
    ways = []
    for left in (plain, faint, noise):
        trace = {"ego_motion": EGO, "evidence": evidence(1.0), "left": left}
        answer = explain_pixel(trace, CAMERA, PARAMETERS, (HERE[0] + 40, HERE[1]))
        assert answer.verdict is PixelVerdict.TOO_FEW_FEATURES
        ways.append((answer.numbers["texture_grey_per_px"], answer.would_change))
    assert ways[0][0] == 0
    assert "No setting can help" in ways[0][1]
    least = float(re.search(r"klt_tracking.min_texture at ([\d.]+) or below", ways[1][1]).group(1))
    assert least < ways[1][0] < PARAMETERS.klt_tracking.min_texture
    assert "klt_tracking.spacing_px at 7 or below (now 18)" in ways[2][1]
    closer = PARAMETERS.changed({"klt_tracking.spacing_px": 7})
    trace = {"ego_motion": EGO, "evidence": evidence(1.0), "left": noise}
    answer = explain_pixel(trace, CAMERA, closer, (HERE[0] + 40, HERE[1]))
    assert "spacing" not in answer.would_change


@pytest.mark.parametrize("length", [3.5, 4.0, THRESHOLD - 0.01, THRESHOLD + 0.01, 6.0])
def test_the_stated_rate_of_false_alarms_changes_the_verdict(length: float) -> None:
    def answer(rate: float) -> PixelAnswer:
        threshold = float(np.sqrt(chi2.isf(rate / TESTS, df=3)))
        dynamic, free = np.atleast_1d(length > threshold), np.array([-1])
        made = evidence(length, threshold=threshold, dynamic=dynamic, obstacle_id=free)
        return explain_pixel({"ego_motion": EGO, "evidence": made}, CAMERA, PARAMETERS, HERE)

    now = answer(RATE)
    found = re.search(r"false_alarms_per_frame at (\S+) or (above|below)", now.would_change)
    assert found, now.would_change
    value = float(found[1])
    moves = length > THRESHOLD
    assert (now.verdict is PixelVerdict.DYNAMIC) == moves
    assert (answer(value).verdict is PixelVerdict.DYNAMIC) != moves
    # Somewhat short of that rate, the verdict does not change.
    nearly = value * (1.15 if moves else 0.85)
    if (nearly < RATE) == moves:
        assert (answer(nearly).verdict is PixelVerdict.DYNAMIC) == moves


def test_it_is_stated_if_no_rate_of_false_alarms_would_change_the_verdict() -> None:
    for length, words in ((1.0, "would make it count as moving"), (30.0, "would change it")):
        change = ask(evidence(length, obstacle_id=np.array([-1]))).would_change
        assert "No value of evidence.false_alarms_per_frame" in change
        assert words in change


def test_features_on_a_straight_edge_are_undecided() -> None:
    answer = ask(evidence([0.0] * 4, cornered=np.zeros(4, np.bool_)))
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert "straight edge" in answer.sentence


def test_features_whose_texture_repeats_are_undecided() -> None:
    answer = ask(evidence([0.0] * 4, recurs=np.ones(4, np.bool_)))
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert "repeats along the row" in answer.sentence


def test_features_on_an_outline_belong_to_its_obstacle() -> None:
    moving = np.ones(4, np.bool_)
    changed = {"dynamic": moving, "on_outline": moving, "obstacle_id": np.full(4, 3)}
    answer = ask(evidence([1.0] * 4, **changed))
    assert answer.verdict is PixelVerdict.DYNAMIC
    assert "part of obstacle 3" in answer.sentence
    assert "is separate in depth" in answer.would_change


def test_the_cause_of_undetectable_motion_is_stated_first() -> None:
    """The cell at 256, 64 is plain; features still speak for their own surroundings."""
    rows = ("." * 32,) * 4 + ("." * 16 + "p" * 16,) + ("." * 32,) * 11
    unseen = Unseen(16 / 512, {"plain": 16 / 512}, 16, rows, hides_person=False)

    def ask_with(px: tuple[float, float]) -> str:
        trace = {"ego_motion": EGO, "evidence": evidence(9.0), "unseen": unseen}
        return explain_pixel(trace, CAMERA, PARAMETERS, px).sentence

    assert ask_with((300.0, 70.0)).startswith(
        "Motion could not be detected here: too little texture. No "
    )
    assert ask_with((250.0, 70.0)).startswith("No feature")
    assert ask_with((300.0, 81.0)).startswith("No feature")
    assert ask_with(HERE).startswith("It moves")
