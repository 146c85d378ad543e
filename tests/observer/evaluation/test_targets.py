"""The table of targets: what counts in it, and when a target is reached."""

from __future__ import annotations

import pytest

from observer.evaluation.counts import Episode, FalseInstance, Sample, Tally
from observer.evaluation.targets import Cost, Target, targets, targets_table
from observer.truth.contract import Kind


def pair(
    range_m: float = 2.0, speed: float = 0.35, radial: float = 0.0, error: float = 0.01
) -> Sample:
    return Sample(
        range_m,
        speed,
        radial,
        matched=True,
        centre_error_m=2 * error,
        speed_error_mps=error,
        velocity_error_mps=1.5 * error,
        mahalanobis2=1.0,
    )


def miss(range_m: float = 2.0, speed: float = 0.35, radial: float = 0.0) -> Sample:
    return Sample(range_m, speed, radial, matched=False)


def false_one() -> FalseInstance:
    return FalseInstance(1, 0, 0.1, 5, (0.0, 0.0, 2.0), 0.3, 2.0, None, None, None)


def by_figure(*runs: tuple[Tally, str | None], cost: Cost | None = None) -> dict[str, Target]:
    return {t.figure: t for t in targets(runs, cost)}


def test_only_samples_in_range_and_fast_enough_count_for_recall() -> None:
    samples = [
        pair(0.8, 0.2),  # lateral, at both limits
        pair(4.0, 0.3, radial=0.9),
        pair(2.0, 0.3, radial=0.5),
        miss(2.0, 0.25),
        miss(0.79),  # too near, too far
        miss(4.01),
        miss(2.0, 0.19),  # too slow for its direction
        miss(2.0, 0.29, radial=0.9),
        miss(2.0, 0.29, radial=0.5),
    ]
    found = by_figure((Tally(frames=10, samples=samples, moved=True), "ideal"))
    every = found["recall, 0.2 m/s lateral or 0.3 m/s otherwise"]
    assert (every.measured, every.count, every.reached) == (0.75, 4, False)
    assert found["recall, lateral from 0.2 m/s"].measured == 0.5
    assert found["recall, radial and diagonal from 0.3 m/s"].measured == 1.0
    assert found["recall, radial and diagonal from 0.3 m/s"].reached


def test_errors_are_grouped_by_scenario_and_exclude_out_of_range_samples() -> None:
    ideal = Tally(frames=1, samples=[pair(error=0.01), pair(5.0, error=9.0)], moved=True)
    faulty = Tally(frames=1, samples=[pair(error=0.06), miss()], moved=True)
    blind = Tally(frames=1, samples=[pair(error=7.0)], moved=True, scored_for="detection")
    found = by_figure((ideal, "ideal"), (faulty, "faulty"), (blind, "faulty"))
    expected = {
        "speed RMSE, ideal, m/s": (0.01, 1, True),
        "velocity RMSE, ideal, m/s": (0.015, 1, True),
        "speed RMSE, faulty, m/s": (0.06, 1, False),
        "velocity RMSE, faulty, m/s": (0.09, 1, False),
        "centre RMSE, m": (((0.02**2 + 0.12**2) / 2) ** 0.5, 2, False),
        # The one scored for detection counts here.
        "coverage of velocity": (1.0, 3, False),
    }
    for figure, (value, count, reached) in expected.items():
        target = found[figure]
        assert target.measured == pytest.approx(value), figure
        assert (target.count, target.reached) == (count, reached), figure


def test_false_rates_overall_and_for_static_scenarios() -> None:
    moving = Tally(frames=300, moved=True, false=[false_one()])
    static = Tally(frames=100, false=[false_one()])
    found = by_figure((moving, "ideal"), (static, "ideal"))
    assert found["false per 100 frames, scenarios without people"].measured == 0.5
    assert found["false per 100 frames, scenarios without people"].reached
    assert found["false per 100 frames, static scenarios"].measured == 1.0
    assert found["false per 100 frames, static scenarios"].reached is False
    quiet = by_figure((Tally(frames=100), "ideal"))
    assert quiet["false per 100 frames, static scenarios"].reached


def test_delays_count_episodes_started_in_range() -> None:
    episodes = [
        Episode(1, 0.0, 3.0, first_seen=0.4, range_m=3.9, radial=0.1),
        Episode(2, 0.0, 3.0, first_seen=None, range_m=4.1, radial=0.1),
        Episode(3, 0.0, 3.0, first_seen=0.6, range_m=3.0, radial=0.9),
        Episode(4, 0.0, 3.0, first_seen=None, range_m=3.1, radial=0.9),
        Episode(5, 0.0, 3.0, first_seen=None, range_m=2.0, radial=0.5),
    ]
    found = by_figure((Tally(frames=10, episodes=episodes), "ideal"))
    assert found["delay s, lateral, median"].measured == 0.4
    assert found["delay s, lateral, median"].count == 1
    assert found["delay s, radial started within 3 m, median"].measured == 0.6
    assert found["delay s, radial started within 3 m, median"].reached


def test_never_reported_misses_the_target_and_no_episode_is_neutral() -> None:
    never = Episode(1, 0.0, 3.0, first_seen=None, range_m=3.0, radial=0.0)
    found = by_figure((Tally(frames=10, episodes=[never]), "ideal"))
    lateral = found["delay s, lateral, median"]
    assert (lateral.measured, lateral.reached) == (None, False)
    radial = found["delay s, radial started within 3 m, median"]
    assert (radial.measured, radial.reached) == (None, None)
    text = targets_table({"default": list(found.values())})
    assert "| delay s, lateral, median | <= 0.5 | never | **no** |" in text
    assert "| delay s, radial started within 3 m, median | <= 0.7 | - | - |" in text


def test_identity_switches_count_only_in_range() -> None:
    switched = Sample(2.0, 0.35, 0.0, matched=True, switched=True)
    outside = Sample(4.5, 0.35, 0.0, matched=True, switched=True)
    found = by_figure((Tally(frames=2, samples=[pair(), switched, outside]), "ideal"))
    assert found["identity switches"].measured == 1
    assert found["identity switches"].reached is False


@pytest.mark.parametrize(
    ("size", "most"), [((512, 256), 8.0), ((1242, 375), 25.0), ((640, 480), None), (None, None)]
)
def test_cost_has_a_limit_at_known_image_sizes(
    size: tuple[int, int] | None, most: float | None
) -> None:
    found = by_figure((Tally(frames=1), None), cost=Cost(size, 7.0, 2.5))
    assert found["observe relative to OpenCV alone"].reached is False
    if most is None:
        assert "observe ms, median" not in found
    else:
        assert found["observe ms, median"].most == most
        assert found["observe ms, median"].reached
    unknown = by_figure((Tally(frames=1), None), cost=Cost(size, 7.0, None))
    assert unknown["observe relative to OpenCV alone"].reached is None
    assert "observe relative to OpenCV alone" not in by_figure((Tally(frames=1), None))


PEOPLE = "people, 0.4 m/s at 0.5-6 m: "


def person(
    range_m: float = 2.0,
    speed: float = 1.0,
    *,
    matched: bool = True,
    flagged: bool = False,
    iou: float | None = 0.7,
    error: float = 0.08,
) -> Sample:
    kind: Kind = "person"
    if not matched:
        return Sample(range_m, speed, 0.0, matched=False, kind=kind, flagged=flagged)
    return Sample(
        range_m, speed, 0.0, matched=True, velocity_error_mps=error, speed_error_mps=error,
        centre_error_m=1.0, mahalanobis2=50.0, switched=True, box_iou=iou, kind=kind,
    )  # fmt: skip


def test_people_have_their_own_figures() -> None:
    samples = [
        *(person() for _ in range(18)),
        person(0.5, 0.4),  # at both limits
        person(6.0, iou=0.1),
        person(matched=False, flagged=True),
        person(0.4, matched=False),  # too near, too far, too slow
        person(6.1, matched=False),
        person(2.0, 0.39, matched=False),
    ]
    tally = Tally(frames=200, samples=samples, moved=True, people=True, surplus_boxes=2)
    found = by_figure((tally, "ideal"))
    expected = {
        PEOPLE + "recall": (20 / 21, 21, True),
        PEOPLE + "velocity RMSE, m/s": (0.08, 20, True),
        PEOPLE + "box IoU, median": (0.7, 20, True),
        PEOPLE + "unflagged misses": (0, 21, True),
        "surplus boxes per 100 frames, scenarios with people": (1.0, 200, False),
        "false per 100 frames, scenarios with people": (0.0, 200, True),
    }
    for figure, (value, count, reached) in expected.items():
        target = found[figure]
        assert target.measured == pytest.approx(value), figure
        assert (target.count, target.reached) == (count, reached), figure
    missed = Tally(frames=1, samples=[person(matched=False)], moved=True, people=True)
    assert by_figure((missed, "ideal"))[PEOPLE + "unflagged misses"].reached is False
    blind = Tally(frames=1, samples=[person()], people=True, scored_for="detection")
    only = by_figure((blind, "faulty"))
    assert only[PEOPLE + "velocity RMSE, m/s"].count == 0
    assert only[PEOPLE + "box IoU, median"].count == 1


def test_people_and_robots_do_not_affect_each_others_figures() -> None:
    robots = Tally(frames=100, samples=[pair(), miss()], moved=True, false=[false_one()])
    robots.episodes = [Episode(1, 0.0, 3.0, first_seen=0.4, range_m=2.0)]
    static = Tally(frames=100)
    people = Tally(
        frames=100, samples=[person(), person(matched=False)], moved=True, people=True,
        false=[false_one()] * 50, surplus_boxes=9,
        episodes=[Episode(1, 0.0, 3.0, range_m=2.0, kind="person")],
    )  # fmt: skip
    standing = Tally(frames=100, people=True, false=[false_one()])
    alone = by_figure((robots, "ideal"), (static, "ideal"))
    mixed = by_figure((robots, "ideal"), (static, "ideal"), (people, "ideal"), (standing, "ideal"))
    among = by_figure((people, "ideal"), (standing, "ideal"))
    assert set(alone) == set(mixed) == set(among)
    for figure, target in mixed.items():
        assert (
            target == (among if "people," in figure or "with people" in figure else alone)[figure]
        ), figure
        other = alone if "people," in figure or "with people" in figure else among
        assert other[figure].reached is None, figure


def test_limits_as_text_and_table_columns() -> None:
    assert Target("a", 0.97, None, 1.0, 1).wanted == ">= 0.97"
    assert Target("a", None, 0.5, 1.0, 1).wanted == "<= 0.5"
    assert Target("a", None, 0.0, 1.0, 1).wanted == "0"
    assert Target("a", 0.9, 0.98, 1.0, 1).wanted == "0.9-0.98"
    run = (Tally(frames=4, samples=[pair()], moved=True), "ideal")
    text = targets_table({"paper": targets([run]), "default": targets([run], Cost(None, 5, 1.5))})
    assert "| metric at 0.8-4 m | target | paper | reached | default | reached |" in text
    assert "| speed RMSE, ideal, m/s | <= 0.02 | 0.010 | yes | 0.010 | yes |" in text
    assert "| coverage of velocity | 0.9-0.98 | 1.000 | **no** | 1.000 | **no** |" in text
    assert "| observe relative to OpenCV alone | <= 2 | - | - | 1.500 | yes |" in text
