"""Row drift over time: constructed rotations, in numbers and in rendered pairs."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest

from observer.calibration.ageing.row_drift import RowDrift, RowDriftWatch
from observer.calibration.ageing.row_refinement import matched_points
from observer.camera import StereoCamera
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import scenario_from_text
from observer.simulation.world import World
from observer.vision.rectification import Rectification

CAMERA = StereoCamera(640, 480, 500.0, 500.0, 319.5, 239.5, 0.12)
DT = 0.5


class Rows:
    """Points all over the image whose row errors follow a given pitch and roll."""

    def __init__(self, seed: int = 0, noise_px: float = 0.15) -> None:
        self._rng = np.random.default_rng(seed)
        self._noise_px = noise_px
        self.watch = RowDriftWatch(CAMERA)
        self.time = 0.0
        self.seen: list[RowDrift] = []

    def seconds(
        self,
        duration: float,
        pitch_px: Callable[[float], float] = lambda _: 0.0,
        roll_deg: Callable[[float], float] = lambda _: 0.0,
        noise_px: float | None = None,
    ) -> RowDrift:
        """Run for ``duration``; pitch and roll are functions of the watch's time, seconds."""
        noise = self._noise_px if noise_px is None else noise_px
        for _ in range(round(duration / DT)):
            self.time += DT
            px = self._rng.uniform((0, 0), (640, 480), (80, 2))
            turn = np.deg2rad(roll_deg(self.time))
            offset = pitch_px(self.time) - turn * (px[:, 0] - CAMERA.cx)
            offset += self._rng.normal(0, noise, 80)
            offset[::9] += self._rng.uniform(-3, 3, 9)  # mismatches
            self.seen.append(self.watch.add_frame(self.time, px, offset))
        return self.seen[-1]


def test_nothing_is_reported_until_enough_time_has_passed() -> None:
    rows = Rows()
    found = rows.seconds(3, lambda _: 2.0)
    assert found.now_px is None
    assert found.median_px is None
    assert found.roll_rad is None
    assert found.warning is None
    assert rows.watch.add_frame(10, None, None).now_px is None


@pytest.mark.parametrize("seed", range(4))
def test_aligned_rows_never_raise_a_warning(seed: int) -> None:
    rows = Rows(seed)
    found = rows.seconds(600)
    assert found.now_px == pytest.approx(0, abs=0.06)
    assert all(each.warning is None for each in rows.seen)
    assert all(each.trend_px_per_min is None for each in rows.seen)
    assert len(found.history) == pytest.approx(19, abs=2)


def test_pitch_and_roll_are_distinguished() -> None:
    pitched = Rows().seconds(20, pitch_px=lambda _: 0.9)
    assert pitched.median_px == pytest.approx(0.9, abs=0.05)
    assert pitched.roll_rad == pytest.approx(0, abs=5e-4)
    assert pitched.warning is not None
    assert f"{np.degrees(0.9 / 500):+.2f} deg" in pitched.warning
    assert "pitch" in pitched.warning
    assert "roll" not in pitched.warning
    rolled = Rows().seconds(20, roll_deg=lambda _: -0.3)
    assert rolled.median_px == pytest.approx(0, abs=0.06)
    assert rolled.roll_rad == pytest.approx(np.deg2rad(-0.3), abs=5e-4)
    # RMS of a slope over the width: its value at the edge divided by the root of three.
    assert rolled.now_px == pytest.approx(np.deg2rad(0.3) * 320 / np.sqrt(3), abs=0.05)
    assert rolled.warning is not None
    assert "roll (−0.30 deg)" in rolled.warning
    assert "pitch" not in rolled.warning
    both = Rows().seconds(20, pitch_px=lambda _: 0.6, roll_deg=lambda _: 0.2)
    assert both.warning is not None
    assert "pitch (" in both.warning
    assert "and roll (" in both.warning


def test_drift_is_reported_with_its_trend() -> None:
    rows = Rows()
    found = rows.seconds(600, pitch_px=lambda t: 0.2 + 0.06 * t / 60)
    assert found.now_px == pytest.approx(0.8, abs=0.05)
    assert found.trend_px_per_min == pytest.approx(0.06, abs=0.01)
    assert found.warning is not None
    match = re.search(
        r"is (0\.8) px, (0\.\d) px (\d+) minutes ago and growing by (0\.\d+) px per minute",
        found.warning,
    )
    assert match is not None, found.warning
    then, ago, rate = (float(match[k]) for k in (2, 3, 4))
    assert then == pytest.approx(0.8 - 0.06 * ago, abs=0.1)
    assert rate == pytest.approx(0.06, abs=0.01)
    # It was reported when it passed half a pixel, and not before.
    assert found.since_s == pytest.approx(350, abs=50)
    px = [value for _, value in found.history]
    assert px[0] < 0.3
    assert px[-1] > 0.7
    assert all(a.warning is None for a in rows.seen[: round(270 / DT)])


def test_receding_drift_clears_the_warning() -> None:
    rows = Rows()
    rows.seconds(120, pitch_px=lambda _: -0.9)
    found = rows.seconds(240, pitch_px=lambda t: -0.9 + 0.8 * (t - 120) / 240)
    assert found.trend_px_per_min is not None
    assert found.trend_px_per_min < -0.1
    assert found.warning is None
    shrinking = [each.warning for each in rows.seen if each.warning and "shrinking" in each.warning]
    assert shrinking


def test_one_blurred_second_is_ignored() -> None:
    rows = Rows()
    rows.seconds(30)
    rows.seconds(1.5, pitch_px=lambda _: 3.0, noise_px=2.0)
    rows.seconds(30)
    assert all(each.warning is None for each in rows.seen)


def test_warning_does_not_flicker_around_its_threshold() -> None:
    rows = Rows(noise_px=0.4)
    rows.seconds(900, pitch_px=lambda t: 0.5 + 0.05 * np.sin(t / 20))
    states = [each.warning is not None for each in rows.seen]
    changes = sum(a != b for a, b in pairwise(states))
    assert changes <= 1


def test_restarted_source_retains_the_history() -> None:
    rows = Rows()
    rows.seconds(120, pitch_px=lambda _: 0.8)
    rows.time = 0.0
    found = rows.seconds(60, pitch_px=lambda _: 0.8)
    times = [time for time, _ in found.history]
    assert times == sorted(times)
    assert len(times) >= 4
    assert found.warning is not None


def test_history_is_bounded() -> None:
    watch = RowDriftWatch(CAMERA)
    rng = np.random.default_rng(0)
    px = rng.uniform((0, 0), (640, 480), (30, 2))
    for time in np.arange(0, 2 * 3600, 4.0):
        found = watch.add_frame(time, px, np.full(30, 0.1))
    assert 50 <= len(found.history) < 120
    assert found.history[0][0] < 300
    assert found.history[-1][0] > 1.9 * 3600


def test_old_observations_expire() -> None:
    rows = Rows()
    rows.seconds(30, pitch_px=lambda _: 0.8)
    for second in range(31, 120):
        found = rows.watch.add_frame(second, None, None)
    assert found.now_px is None
    assert found.warning is None


def lab(pitch_deg: float) -> World:
    """A lab whose calibration has this pitch error."""
    text = f"based_on: turning\nfaults: {{miscalibration: {{pitch_deg: {pitch_deg}}}}}"
    return World(scenario_from_text(text, "wrong"), 1)


def test_rendered_pairs_of_a_warming_camera_head_show_drift() -> None:
    pair = StereoImager(lab(0.0)).pair(0, 0.0)
    camera = Rectification(lab(0.0).calibration).camera
    watch = RowDriftWatch(camera)
    time, states = 0.0, []
    for pitch_deg in (0.0, 0.03, 0.06, 0.09, 0.12):
        left, right = matched_points(*Rectification(lab(pitch_deg).calibration).apply(*pair))
        px, offset = left[:200], (left - right)[:200, 1]
        for _ in range(70):
            time += 1.0
            found = watch.add_frame(time, px, offset)
        true_px = np.deg2rad(pitch_deg) * camera.fy
        assert found.now_px == pytest.approx(true_px, abs=0.08)
        assert (found.warning is not None) == (true_px > 0.5)
        states.append(found)
    assert states[-1].trend_px_per_min == pytest.approx(np.deg2rad(0.03) * camera.fy * 60 / 70, 0.2)
    assert states[-1].warning is not None
    assert "growing" in states[-1].warning
    # The watch and the refinement define pitch alike.
    assert abs(states[-1].median_px or 0) == pytest.approx(np.deg2rad(0.12) * camera.fy, abs=0.08)
