"""The guard's verdicts, tick by tick."""

from __future__ import annotations

import math
import time as clocks
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from observer.guard.guard import Guard, Verdict, sight_trouble
from observer.guard.outline import Outline
from observer.guard.parameters import GuardParameters
from observer.guard.sight import FreeScan, SeenObstacle, Sight, sight_of
from observer.rig.rig import Role
from observer.robots.contract import SonarReading
from observer.robots.models import robot_spec
from observer.types import Status

BEARINGS = tuple(np.radians(np.arange(-30.0, 30.1, 2.0)).tolist())
AMIGO = robot_spec("amigo-sh")
P = GuardParameters()
OUTLINE = Outline(0.33, 0.28, 0.18)


def scan(blocked: float | None = None, begins: float = 1.0, ends: float = 4.0) -> FreeScan:
    ends = ends if blocked is None else min(ends, blocked)
    n = len(BEARINGS)
    return FreeScan(BEARINGS, (blocked,) * n, (begins,) * n, (max(begins, ends),) * n)


def sight(now: float, seen: FreeScan | None = None, **changes: object) -> Sight:
    base = Sight(round(now * 1e3), now, now, "real", Status.OK, (), True, (), seen or scan())
    return replace(base, **changes)  # type: ignore[arg-type]


def sonars(
    now: float, echo: float | None = None, *, only: Iterable[int] | None = None
) -> tuple[SonarReading, ...]:
    """Return clear readings, with an echo at the sonars in ``only`` (at all if None)."""
    hit = set(range(8) if only is None else only)
    return tuple(
        SonarReading(i, s.x, s.y, s.heading, echo if i in hit else None, now)
        for i, s in enumerate(AMIGO.sonars)
    )


class Loop:
    """A guard that is called every 20 ms."""

    def __init__(self, role: Role = "observer", p: GuardParameters = P) -> None:
        self.guard, self.role, self.now = Guard(p), role, 100.0

    def ask(
        self,
        wanted: tuple[float, float],
        seen: FreeScan | None = None,
        *,
        echo: float | None = None,
        only: Iterable[int] | None = None,
        sonar: bool = True,
        obstacles: tuple[SeenObstacle, ...] = (),
        measured: tuple[float | None, float | None] = (None, None),
        times: int = 1,
    ) -> Verdict:
        for _ in range(times):
            self.now += 0.02
            verdict = self.guard.limit(
                self.role, wanted, measured,
                sight(self.now - 0.05, seen, obstacles=obstacles), "real",
                sonars(self.now - 0.1, echo, only=only) if sonar else (),
                Outline.of(AMIGO.length_m, AMIGO.width_m, AMIGO.radius_m), self.now,
            )  # fmt: skip
        return verdict


def test_problems_with_a_sight_are_explained() -> None:
    now = 50.0
    cases = {
        "no camera source": None,
        "recording": sight(now, world=None),
        "a different world": sight(now, world="simulated:lab:1"),
        "for 200 ms": sight(now - 0.21),
        "more than a second": sight(now - 5.0),
        "height and tilt": sight(now, mount_known=False),
        "vision is lost: both images are black": sight(
            now, status=Status.LOST, reasons=("both images are black", "more")
        ),
        "vision is degraded": sight(now, status=Status.DEGRADED),
    }
    for words, one in cases.items():
        sentence = sight_trouble(one, now, "real")
        assert sentence is not None
        assert words in sentence
    assert sight_trouble(sight(now - 0.19), now, "real") is None


def test_a_sight_survives_conversion_to_plain_values() -> None:
    one = sight(1.0, obstacles=(SeenObstacle(1, 1, 2, 3, 4, 0.2, None, 0.1, True),))
    assert sight_of(one.facts()) == one


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("name", ["x", "vy", "radius_m", "position_sigma_m"])
def test_a_sight_with_a_number_that_is_not_finite_is_refused(name: str, bad: float) -> None:
    """The guard could not compare it, and would ignore the obstacle."""
    one = SeenObstacle(1, 1.0, 0.0, -0.5, 0.0, 0.3, 0.05, 0.1, False)
    seen = sight(1.0, obstacles=(replace(one, **{name: bad}),))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="finite"):
        sight_of(seen.facts())
    with pytest.raises(ValueError, match="finite"):
        sight_of(sight(1.0, replace(scan(), known_to_m=(bad,) * len(BEARINGS))).facts())
    with pytest.raises(ValueError, match="finite"):
        sight_of(sight(1.0, received=bad).facts())


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("role", ["observer", "obstacle"])
def test_a_declared_turning_circle_hides_nothing_ahead(role: Role, direction: float) -> None:
    # Length 0.8 m: its end is 0.1 m from a wall, well within the circle that it declares.
    length_m, width_m, wall_m, now = 0.8, 0.4, 0.5, 100.0
    away = 0.0 if direction > 0 else math.pi
    for radius_m in (0.45, 0.7, 1.2):
        for heard in (False, True):
            guard = Guard(P)
            readings: tuple[SonarReading, ...] = ()
            echo = wall_m - 0.4 if heard else None
            if heard or role == "obstacle":
                readings = (SonarReading(0, 0.4 * direction, 0.0, away, echo, now),)
            seen = scan(wall_m if direction > 0 and not heard else None, begins=0.0)
            verdict = guard.limit(
                role, (0.3 * direction, 0.0), (0.0, 0.0), sight(now, seen), "real", readings,
                Outline.of(length_m, width_m, radius_m), now,
            )  # fmt: skip
            is_there = heard or role == "observer"
            assert (verdict.level == "stop") == is_there, (radius_m, heard, verdict)


def test_a_blind_observer_is_stopped_and_never_clear() -> None:
    guard = Guard(P)
    for wanted in ((0.3, 0.0), (0.0, 0.0), (-0.3, 0.0)):
        verdict = guard.limit(
            "observer", wanted, (0.0, 0.0), None, "real", sonars(1.0), Outline(0.3, 0.3, 0.2), 1.0
        )
        assert (verdict.level, verdict.blind) == ("stop", True)
        assert (verdict.speed_mps, verdict.turn_rate_radps) == (0.0, 0.0)


@pytest.mark.parametrize("wanted", [(0.3, 0.0), (0.3, 0.4), (-0.2, 0.0), (0.0, 0.8)])
def test_a_command_passes_unchanged_over_ground_known_to_be_free(
    wanted: tuple[float, float],
) -> None:
    verdict = Loop().ask(wanted, times=3)
    assert verdict.level == "clear"
    assert (verdict.speed_mps, verdict.turn_rate_radps) == wanted
    assert verdict.limit_mps is None
    assert verdict.reason is None


@pytest.mark.parametrize("wanted", [(0.3, 0.0), (0.3, 0.4), (-0.2, 0.0), (0.0, 0.8)])
def test_unknown_ground_is_never_clear(wanted: tuple[float, float]) -> None:
    verdict = Loop().ask(wanted, sonar=False)
    assert (verdict.level, verdict.blind) == ("stop", False)
    assert "not known to be free" in (verdict.reason or "")
    nothing_seen = scan(begins=0.0, ends=0.0)
    hears = Loop().ask((0.3, 0.0), nothing_seen)
    # Sonar alone is trusted up to its range.
    assert hears.level == "clear"
    assert Loop().ask((0.3, 0.0), nothing_seen, sonar=False).level == "stop"


def test_outdated_sonar_readings_are_ignored() -> None:
    loop = Loop()
    loop.now += 0.02
    verdict = loop.guard.limit(
        "observer", (0.3, 0.0), (0.0, 0.0), sight(loop.now), "real",
        sonars(loop.now - P.sonar_fresh_s - 0.01), OUTLINE, loop.now,
    )  # fmt: skip
    assert verdict.level == "stop"


def test_a_surface_ahead_slows_and_stops_regardless_of_sonar() -> None:
    limits = [Loop().ask((0.5, 0.0), scan(blocked)) for blocked in (3.0, 1.0, 0.7, 0.5, 0.3)]
    speeds = [verdict.speed_mps for verdict in limits]
    assert speeds[0] == 0.5
    assert speeds == sorted(speeds, reverse=True)
    assert [verdict.level for verdict in limits][1:4] == ["slow"] * 3
    assert limits[-1].level == "stop"
    assert limits[-1].limit_mps == 0.0
    assert "obstruction ahead" in (limits[2].reason or "")
    # Backing out and turning away stay possible.
    assert Loop().ask((-0.2, 0.0), scan(0.35)).level == "clear"
    assert Loop().ask((0.0, 0.5), scan(0.35)).level == "clear"


def test_a_near_echo_ahead_stops_regardless_of_vision() -> None:
    verdict = Loop().ask((0.3, 0.0), echo=0.15, only=[2])
    assert (verdict.level, verdict.reason) == ("stop", "sonar 2 has an echo within 0.20 m")
    assert Loop().ask((0.3, 0.0), echo=0.15, only=[6, 7]).level == "clear"
    assert Loop().ask((-0.3, 0.0), echo=0.15, only=[6, 7]).level == "stop"


def test_an_echo_that_vision_places_beside_the_path_does_not_stop() -> None:
    # At 0.6 m in a 30 degree cone it may be ahead, but the near floor is seen to be free.
    near = scan(begins=0.3)
    assert Loop().ask((0.3, 0.0), near, echo=0.6, only=[2]).level == "clear"
    unseen = Loop().ask((0.3, 0.0), scan(begins=0.0, ends=0.0), echo=0.3, only=[2])
    assert unseen.level in ("slow", "stop")


def test_turning_on_the_spot_requires_a_clear_circle() -> None:
    assert Loop().ask((0.0, 0.5)).level == "clear"
    front_only = tuple(one for one in sonars(100.0) if one.index < 6)
    loop = Loop()
    loop.now += 0.02
    verdict = loop.guard.limit(
        "observer", (0.0, 0.5), (0.0, 0.0), sight(loop.now), "real", front_only, OUTLINE,
        loop.now,
    )  # fmt: skip
    assert verdict.level == "stop"


def test_speed_and_turn_rate_are_scaled_together() -> None:
    fast = Loop().ask((2.0, 1.0))
    assert fast.speed_mps == pytest.approx(P.speed_max_mps)
    assert fast.turn_rate_radps == pytest.approx(0.25)
    slowed = Loop().ask((0.5, 0.2), scan(0.8))
    assert slowed.level == "slow"
    assert slowed.turn_rate_radps / slowed.speed_mps == pytest.approx(0.4)


def test_a_limit_is_released_only_after_a_delay() -> None:
    loop = Loop()
    held = loop.ask((0.4, 0.0), scan(0.7))
    assert held.level == "slow"
    # One frame without the surface changes nothing.
    assert loop.ask((0.4, 0.0)).speed_mps == pytest.approx(held.speed_mps)
    assert loop.ask((0.4, 0.0), times=round(P.release_s / 0.02) + 2).level == "clear"
    # A lower limit applies at once.
    assert loop.ask((0.4, 0.0), scan(0.3)).level == "stop"
    # It does not affect another direction.
    assert loop.ask((-0.2, 0.0), scan(0.3)).level == "clear"


def test_a_tracked_obstacle_slows_and_is_named() -> None:
    coming = SeenObstacle(3, 1.6, 0.0, -0.4, 0.0, 0.2, 0.02, 0.02, False)
    verdict = Loop().ask((0.3, 0.0), obstacles=(coming,))
    # It is seen, so the remaining distance is known.
    assert not verdict.comes
    assert verdict.level == "slow"
    assert verdict.reason == "the time to contact with obstacle 3 is short"
    passed = replace(coming, y=1.2, vx=0.0, vy=0.4)
    assert Loop().ask((0.3, 0.0), obstacles=(passed,)).level == "clear"


def test_ground_recently_seen_free_counts_until_the_memory_expires() -> None:
    def after(outage_s: float, p: GuardParameters) -> Verdict:
        loop = Loop(p=p)
        wide = FreeScan((-math.pi, math.pi), (None, None), (0.0, 0.0), (3.0, 3.0))
        loop.ask((0.2, 0.0), wide, sonar=False, measured=(0.0, 0.0), times=3)
        nothing = scan(begins=0.0, ends=0.0)
        times = round(outage_s / 0.02)
        return loop.ask((0.2, 0.0), nothing, sonar=False, measured=(0.0, 0.0), times=times)

    assert after(0.3, P).level == "clear"
    assert after(P.memory_s + 0.2, P).level == "stop"
    assert after(0.3, P.model_copy(update={"memory_s": 0.0})).level == "stop"


def test_the_distance_driven_since_the_frame_is_subtracted() -> None:
    def at(speed: float) -> float:
        loop = Loop()
        loop.ask((0.5, 0.0), scan(0.8), measured=(speed, 0.0), times=5)
        return loop.ask((0.5, 0.0), scan(0.8), measured=(speed, 0.0)).speed_mps

    # The frame is 50 ms old, in which the fast robot came one sample nearer.
    assert at(2.0) < at(0.0)


def test_the_obstacle_robot_relies_on_sonar_alone() -> None:
    loop = Loop("obstacle")
    assert loop.ask((0.4, 0.0), scan(0.3)).level == "clear"
    assert loop.ask((0.4, 0.0), sonar=False).level == "clear"
    assert loop.ask((0.4, 0.0), echo=0.15).level == "stop"
    blind = Guard(P).limit(
        "obstacle", (0.4, 0.0), (0.0, 0.0), None, "real", (), Outline.of(None, None, None), 1.0
    )
    assert (blind.level, blind.blind) == ("clear", False)


@pytest.mark.parametrize("wanted", [(0.3, 0.0), (0.3, 0.4), (-0.3, 0.0)])
def test_the_obstacle_robot_stays_stopped_when_its_sonar_falls_silent(
    wanted: tuple[float, float],
) -> None:
    guard, heard = Guard(P), sonars(100.0, 0.15)
    for tick in range(75):
        now = 100.0 + 0.02 * tick
        verdict = guard.limit("obstacle", wanted, (0.0, 0.0), None, "real", heard, OUTLINE, now)
        assert (verdict.level, verdict.speed_mps) == ("stop", 0.0), now
    assert verdict.reason == "its sonar has been silent for more than 0.6 s"


@pytest.mark.parametrize("role", ["obstacle", "observer"])
def test_silent_sonars_block_the_direction_they_face(role: Role) -> None:
    def level(speed: float, *, fresh: Iterable[int]) -> str:
        loop, heard = Loop(role), set(fresh)
        loop.now += 0.02
        readings = tuple(
            one if one.index in heard else replace(one, received=loop.now - P.sonar_fresh_s - 0.01)
            for one in sonars(loop.now)
        )
        return loop.guard.limit(
            role, (speed, 0.0), (0.0, 0.0), sight(loop.now, scan(begins=0.0)), "real", readings,
            OUTLINE, loop.now,
        ).level  # fmt: skip

    # Sonars 0 and 5 point aside, 1 to 4 forward, 6 and 7 backward.
    assert level(0.1, fresh=range(8)) == "clear"
    assert level(0.1, fresh=(0, 5, 6, 7)) == "stop"
    assert level(-0.1, fresh=range(6)) == "stop"
    assert level(0.1, fresh=()) == "stop"
    if role == "obstacle":
        assert level(0.1, fresh=(2,)) == "clear"
        assert level(-0.1, fresh=(6,)) == "clear"


def test_the_zones_follow_the_arc() -> None:
    straight, bend = Loop().ask((0.5, 0.0)), Loop().ask((0.5, 0.6))
    assert max(x for x, _ in straight.stop_zone) == pytest.approx(
        AMIGO.length_m / 2 + P.margin_m + 1.1 * (0.5 * P.reaction_s + 0.25), abs=1e-3
    )
    assert max(x for x, _ in straight.slow_zone) > max(x for x, _ in straight.stop_zone)
    assert max(y for _, y in bend.slow_zone) > max(y for _, y in straight.slow_zone) + 0.1
    standing = Loop().ask((0.0, 0.0))
    assert standing.level == "clear"
    assert len(standing.stop_zone) == 4


def test_new_parameters_apply_from_the_next_tick() -> None:
    loop = Loop()
    assert loop.ask((0.5, 0.0)).speed_mps == 0.5
    loop.guard.use(P.model_copy(update={"speed_max_mps": 0.2}))
    assert loop.ask((0.5, 0.0)).speed_mps == pytest.approx(0.2)
    loop.guard.forget("observer")
    assert loop.ask((0.5, 0.0)).speed_mps == pytest.approx(0.2)


def test_zones_are_redrawn_for_new_parameters() -> None:
    loop = Loop()
    before = loop.ask((0.3, 0.6)).stop_zone
    for name, value in (("sigmas", 5.0), ("turn_acceleration_radps2", 0.2)):
        loop.guard.use(P.model_copy(update={name: value}))
        assert loop.ask((0.3, 0.6)).stop_zone != before


def test_a_verdict_takes_a_small_part_of_a_tick() -> None:
    loop = Loop()
    crowd = tuple(
        SeenObstacle(k, 2.5, 1.0 - 0.4 * k, 0, -0.3, 0.2, 0.05, 0.05, False) for k in range(4)
    )
    times = []
    for _ in range(100):
        begin = clocks.perf_counter()
        loop.ask((0.3, 0.2), obstacles=crowd)
        times.append(clocks.perf_counter() - begin)
    print(f"median {1e3 * sorted(times)[50]:.2f} ms")  # noqa: T201
    # 0.5 ms on a quiet machine; a tick is 20.
    assert sorted(times)[50] < 0.004
