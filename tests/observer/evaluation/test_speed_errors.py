"""Speed errors, on motions with known, planted errors."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.evaluation.speed_errors import (
    AT_REST,
    SeenMotion,
    SpeedErrors,
    TrueMotion,
    identity_changes,
    identity_switches,
    sample_errors,
    speed_errors,
)

TIMES = np.arange(100) / 10.0


def true_motion(
    speeds: np.ndarray | float, directions: list[str] | None = None, ways: list[str] | None = None
) -> TrueMotion:
    full = np.broadcast_to(np.asarray(speeds, np.float64), TIMES.shape).copy()
    words = tuple(directions or ["towards"] * len(TIMES))
    return TrueMotion(
        "cart", TIMES, full, words, tuple(ways or ["forward"] * len(TIMES)), np.isfinite(full)
    )


def seen_motion(
    indexes: np.ndarray, errors: np.ndarray | float, *, std: float = 0.02, track: str = "0:1"
) -> SeenMotion:
    times = TIMES[indexes]
    return SeenMotion(
        track, "cart", times, times, 0.3 + np.broadcast_to(errors, times.shape),
        np.full(len(times), std),
    )  # fmt: skip


def of(found: tuple[SpeedErrors, ...], group: str, label: str) -> SpeedErrors:
    return next(each for each in found if (each.group, each.label) == (group, label))


def test_planted_errors_are_measured() -> None:
    errors = np.where(np.arange(50) % 2, 0.05, -0.03)
    whole = of(speed_errors([seen_motion(np.arange(50), errors)], [true_motion(0.3)]),
               "all", "whole run")  # fmt: skip
    assert whole.samples == 50
    assert whole.bias_mps == pytest.approx(0.01)
    assert whole.rmse_mps == pytest.approx(np.sqrt((0.05**2 + 0.03**2) / 2))
    assert whole.maximum_mps == pytest.approx(0.05)
    # 1.96 * 0.02 = 0.039: every second error lies within.
    assert whole.coverage == 0.5
    assert whole.seen_share == 0.5


def test_directions_and_ways_of_driving_are_grouped_separately() -> None:
    directions = ["towards"] * 40 + [AT_REST] * 20 + ["left"] * 40
    ways = ["forward"] * 40 + [AT_REST] * 20 + ["backward"] * 40
    speeds = np.where(np.array(directions) == AT_REST, 0.0, 0.3)
    indexes = np.r_[0:40, 60:80]
    errors = np.where(indexes < 50, 0.02, -0.04)
    found = speed_errors([seen_motion(indexes, errors)], [true_motion(speeds, directions, ways)])
    assert of(found, "direction", "towards").bias_mps == pytest.approx(0.02)
    assert of(found, "direction", "left").bias_mps == pytest.approx(-0.04)
    assert of(found, "way", "backward").samples == 20
    assert of(found, "direction", "left").seen_share == 0.5
    assert of(found, "direction", "towards").seen_share == 1.0
    assert not [e for e in found if e.label in ("away", "right", AT_REST)]


def test_gap_in_the_truth_gives_no_sample() -> None:
    speeds = np.full(100, 0.3)
    speeds[20:40] = np.nan
    seen = seen_motion(np.arange(100), 0.01)
    found = speed_errors([seen], [true_motion(speeds)])
    assert of(found, "all", "whole run").samples == 80
    # Between a sample and the first missing one nothing is known.
    shifted = SeenMotion("0:1", "cart", TIMES, TIMES + 0.05, seen.speeds, seen.stds)
    errors = sample_errors(shifted, true_motion(speeds))
    assert np.isnan(errors[19:40]).all()
    # Nor is anything after the last sample.
    assert np.isnan(errors[99])
    assert np.isfinite(errors[40:99]).all()


def test_missing_frames_of_truth_are_not_bridged() -> None:
    kept = np.r_[0:30, 60:100]
    full = true_motion(0.3)
    motion = TrueMotion(
        "cart", TIMES[kept], full.speeds[kept], tuple(full.directions[: len(kept)]),
        tuple(full.ways[: len(kept)]), full.in_sight[kept],
    )  # fmt: skip
    assert np.isnan(motion.speeds_at(np.array([3.5, 4.5, 5.5, -0.1]))).all()
    assert motion.speeds_at(np.array([2.9, 6.0])) == pytest.approx([0.3, 0.3])


def test_identities_are_counted_and_listed_separately() -> None:
    tracks = [
        seen_motion(np.arange(10), 0.0, track="0:1"),
        seen_motion(np.arange(20, 30), 0.1, track="0:2"),
        seen_motion(np.arange(40, 50), 0.0, track="0:1"),
    ]
    assert identity_changes(tracks) == {"cart": 2}
    found = speed_errors(tracks, [true_motion(0.3)])
    assert [e.bias_mps for e in found if e.group == "track"] == pytest.approx([0.0, 0.1, 0.0])


def test_a_new_segment_is_no_identity_switch() -> None:
    tracks = [
        seen_motion(np.arange(10), 0.0, track="0:1"),
        seen_motion(np.arange(20, 30), 0.0, track="1:4"),
        seen_motion(np.arange(40, 50), 0.0, track="1:5"),
    ]
    assert [each[2:] for each in identity_switches(tracks)] == [("1:4", "1:5")]
    assert identity_changes(tracks) == {"cart": 1}


def test_no_samples_give_no_errors() -> None:
    whole = speed_errors([], [true_motion(0.3)])[0]
    assert (whole.samples, whole.bias_mps, whole.coverage, whole.seen_share) == (0, None, None, 0.0)
    assert speed_errors([], [])[0].seen_share is None


def test_unknown_deviation_does_not_affect_the_coverage() -> None:
    seen = seen_motion(np.arange(10), 0.01, std=float("nan"))
    whole = speed_errors([seen], [true_motion(0.3)])[0]
    assert (whole.samples, whole.coverage, whole.covered_of) == (10, None, 0)


@given(st.floats(0.0, 9.9), st.floats(-2.0, 2.0), st.floats(0.0, 2.0))
def test_linear_speed_is_interpolated_exactly(at: float, slope: float, level: float) -> None:
    found = true_motion(level + slope * TIMES).speeds_at(np.array([at]))
    assert found[0] == pytest.approx(level + slope * at, abs=1e-9)
