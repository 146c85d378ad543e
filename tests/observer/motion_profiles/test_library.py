"""The programmes shipped with the project do what they say."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path

import pytest

from observer.errors import InputError
from observer.motion_profiles.library import (
    library_text,
    load_profile,
    profile_names,
    read_profile,
)
from observer.motion_profiles.playing import duration_s, velocity_at
from observer.motion_profiles.profile import MotionProfile
from observer.motion_profiles.profile_file import profile_from_text, profile_text
from observer.rig.rig import Role

TICK_S = 0.01
# Limits that any of the four robots can follow; programmes for people should not jerk.
GENTLE_MPS2, GENTLE_RADPS2 = 0.31, math.radians(31)


def path_of(programme: MotionProfile, role: Role) -> list[tuple[float, float, float]]:
    """Return x, y, yaw every ``TICK_S``."""
    x = y = yaw = 0.0
    path = []
    for i in range(round(duration_s(programme) / TICK_S)):
        speed, rate = velocity_at(programme, role, (i + 0.5) * TICK_S) or (math.nan, math.nan)
        x += speed * TICK_S * math.cos(yaw + rate * TICK_S / 2)
        y += speed * TICK_S * math.sin(yaw + rate * TICK_S / 2)
        yaw += rate * TICK_S
        path.append((x, y, yaw))
    return path


def test_the_required_programmes_exist() -> None:
    assert set(profile_names()) >= {
        "figure17_a", "figure17_b", "square_observer", "square_obstacle", "rig_turn", "rig_drive",
    }  # fmt: skip


@pytest.mark.parametrize("name", profile_names())
def test_each_programme_is_described_ends_at_rest_and_round_trips(name: str) -> None:
    programme = load_profile(name)
    assert programme.name == name
    assert len(programme.title) > 5
    assert len(programme.help) > 40
    assert profile_from_text(profile_text(programme)) == programme
    assert profile_from_text(library_text(name)) == programme
    end = duration_s(programme)
    for role in programme.roles:
        speed, rate = velocity_at(programme, role, end - 1e-6) or (math.nan, math.nan)
        assert abs(speed) < 1e-5
        assert abs(rate) < 1e-5


@pytest.mark.parametrize("name", profile_names())
def test_each_programme_accelerates_gently_after_its_gesture(name: str) -> None:
    programme = load_profile(name)
    start = duration_s(programme) - max(
        sum(step.seconds for step in steps) for steps in programme.steps.values()
    )
    for role in programme.roles:
        ticks = range(round(start / TICK_S), round(duration_s(programme) / TICK_S))
        wanted = [velocity_at(programme, role, (i + 0.5) * TICK_S) for i in ticks]
        for before, now in pairwise(wanted):
            assert before is not None
            assert now is not None
            assert abs(now[0] - before[0]) <= GENTLE_MPS2 * TICK_S
            assert abs(now[1] - before[1]) <= GENTLE_RADPS2 * TICK_S


def test_figure_17_programmes_move_the_obstacle_in_opposite_directions() -> None:
    a, b = load_profile("figure17_a"), load_profile("figure17_b")
    for programme in (a, b):
        assert programme.roles == ("observer", "obstacle")
        assert programme.gesture
        assert path_of(programme, "observer")[-1] == pytest.approx((0.7, 0, 0), abs=1e-9)
    assert path_of(a, "obstacle")[-1] == pytest.approx((2.1, 0, 0), abs=1e-9)
    assert path_of(b, "obstacle")[-1] == pytest.approx((-2.1, 0, 0), abs=1e-9)


@pytest.mark.parametrize("role", ["observer", "obstacle"])
def test_the_square_has_sides_of_2_m_and_closes(role: Role) -> None:
    path = path_of(load_profile(f"square_{role}"), role)
    assert path[-1] == pytest.approx((0, 0, 2 * math.pi), abs=1e-9)
    xs, ys = [p[0] for p in path], [p[1] for p in path]
    assert (min(xs), max(xs), min(ys), max(ys)) == pytest.approx((0, 2, 0, 2), abs=1e-9)


def test_the_rig_programmes_turn_60_degrees_and_drive_1_2_m() -> None:
    turn = path_of(load_profile("rig_turn"), "observer")
    assert max(p[2] for p in turn) == pytest.approx(math.radians(60))
    assert min(p[2] for p in turn) == pytest.approx(math.radians(-60))
    assert turn[-1] == pytest.approx((0, 0, 0), abs=1e-9)
    drive = path_of(load_profile("rig_drive"), "observer")
    assert drive[-1] == pytest.approx((1.2, 0, 0), abs=1e-9)


def test_a_name_is_never_treated_as_a_path(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text("steps: {observer: [{seconds: 1, speed_mps: 0.1}]}")
    paths = (str(file), "../library/figure17_a", "figure17_a.yaml", "", "x/../figure17_a")
    for name in paths:
        with pytest.raises(InputError, match="available are figure17_a, figure17_b"):
            load_profile(name)
    assert read_profile(file).name == "mine"


def test_an_unreadable_file_is_refused_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no programme file"):
        read_profile(tmp_path / "none.yaml")
    with pytest.raises(InputError, match="cannot be read"):
        read_profile(tmp_path)
    (tmp_path / "image.yaml").write_bytes(b"\xfe\x00steps")
    with pytest.raises(InputError, match="UTF-8"):
        read_profile(tmp_path / "image.yaml")
