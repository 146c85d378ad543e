"""Boxes in the image: their overlap, admitted misses, and bodies that move in place."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from observer.errors import InputError
from observer.evaluation.evaluate import summarise
from observer.evaluation.lines import checked_lines
from observer.evaluation.tally import tally
from observer.truth.contract import TrueBody

from .hand_made import RIGHT, StraightTruth, evaluate, line, perfect


class BoxedTruth(StraightTruth):
    """One body with a known box; ``known`` holds what the truth knows of it."""

    def __init__(self, **known: Any) -> None:
        super().__init__(RIGHT)
        self.known = {"box_px": (0.0, 0.0, 10.0, 20.0), **known}

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        return tuple(replace(body, **self.known) for body in super().bodies(time))


@pytest.mark.parametrize(
    ("reported", "iou"),
    [
        ([0, 0, 10, 20], 1.0),
        ([0, 0, 5, 20], 0.5),
        ([5, 0, 15, 20], 1 / 3),
        ([50, 0, 60, 20], 0.0),
        ([0, 0, 0, 0], 0.0),
        (None, None),
    ],
)
def test_boxes_are_compared_by_intersection_over_union(
    reported: list[float] | None, iou: float | None
) -> None:
    truth = BoxedTruth()
    result = evaluate(perfect(truth, 20, box_px=reported), truth)
    assert result.box_iou_median == (None if iou is None else pytest.approx(iou))
    unknown = BoxedTruth(box_px=None)
    assert evaluate(perfect(unknown, 20, box_px=reported), unknown).box_iou_median is None


def test_median_covers_all_pairs_with_both_boxes() -> None:
    truth = BoxedTruth()
    lines = perfect(truth, 20, box_px=[0, 0, 10, 20])
    for each in lines[13:18]:
        each["obstacles"][0]["box_px"] = [0, 0, 5, 20]
    lines[18]["obstacles"][0]["box_px"] = lines[19]["obstacles"][0]["box_px"] = None
    # Seven values of 1 and five of 0.5.
    assert evaluate(lines, truth).box_iou_median == 1.0
    for each in lines[6:9]:
        each["obstacles"][0]["box_px"] = [0, 0, 5, 20]
    assert evaluate(lines, truth).box_iou_median == 0.5


def test_reported_box_is_clipped_to_the_image() -> None:
    truth = BoxedTruth(box_px=(89.5, 39.5, 99.5, 49.5))
    checked = checked_lines(perfect(truth, 20, box_px=[89.5, 39.5, 109.5, 59.5]))
    assert summarise([tally(checked, truth)]).box_iou_median == pytest.approx(0.25)
    cut = tally(checked, truth, image_size=(100, 50))
    assert summarise([cut]).box_iou_median == pytest.approx(1.0)


def unseen(*rows: str) -> dict[str, Any]:
    return {"share": 0.3, "causes": {"plain": 0.2, "dark": 0.1}, "cell_px": 10, "rows": list(rows)}


@pytest.mark.parametrize(
    ("changes", "flagged"),
    [
        ({}, False),
        ({"status": "lost"}, True),
        ({"status": "degraded"}, False),
        ({"status": "degraded", "unseen": None}, False),
        ({"status": "degraded", "unseen": unseen("..", "..", "..")}, False),
        ({"status": "degraded", "unseen": unseen("p.", "d.", "..")}, True),
        ({"status": "ok", "unseen": unseen("pp", "dd", "..")}, False),
        # Exactly half of the area is unseen, then a little less.
        ({"status": "degraded", "unseen": unseen("x.", "..", "..")}, True),
        ({"status": "degraded", "unseen": unseen(".x", "..", "xx")}, False),
        # The grid ends above the body.
        ({"status": "degraded", "unseen": unseen("..")}, False),
    ],
)
def test_miss_is_flagged_where_the_line_declares_it_unseen(
    changes: dict[str, Any], flagged: bool
) -> None:
    truth = BoxedTruth(box_px=(-0.5, -0.5, 9.5, 19.5))
    result = evaluate([line(k, [], **changes) for k in range(20)], truth)
    assert result.missed == 14
    assert result.flagged_misses == (14 if flagged else 0)
    assert result.unflagged_misses == (0 if flagged else 14)
    assert result.unflagged_misses_share == (0.0 if flagged else 1.0)


def test_unseen_half_of_the_box_is_measured_by_area_not_by_cells() -> None:
    """Its lower part covers only a tenth of two cells."""
    truth = BoxedTruth(box_px=(-0.5, -0.5, 19.5, 10.5))
    below = {"status": "degraded", "unseen": unseen("..", "dd")}
    above = {"status": "degraded", "unseen": unseen("dd", "..")}
    assert evaluate([line(k, [], **below) for k in range(20)], truth).flagged_misses == 0
    assert evaluate([line(k, [], **above) for k in range(20)], truth).flagged_misses == 14


def test_miss_without_a_known_box_is_flagged_only_by_a_lost_line() -> None:
    truth = BoxedTruth(box_px=None)
    blind = {"status": "degraded", "unseen": unseen("xx", "xx")}
    assert evaluate([line(k, [], **blind) for k in range(20)], truth).flagged_misses == 0
    assert evaluate([line(k, [], status="lost") for k in range(20)], truth).flagged_misses == 14


def test_miss_is_flagged_by_a_coasting_obstacle_at_its_place() -> None:
    truth = BoxedTruth()
    lines = perfect(truth, 20)
    for each in lines:
        each["obstacles"][0]["state"] = "coasting"
    result = evaluate(lines, truth)
    assert (result.missed, result.flagged_misses) == (14, 14)
    for each in lines:
        x, y, z = each["obstacles"][0]["position"]
        each["obstacles"][0]["position"] = [x + 1.0, y, z]
    assert evaluate(lines, truth).flagged_misses == 0


@pytest.mark.parametrize("motion", ["stopped", "in_place"])
def test_miss_is_flagged_by_an_unmoving_report_with_plausible_velocity(
    motion: str,
) -> None:
    """A body that reverses counts as stopped for a moment, but is not unseen."""
    truth = BoxedTruth()

    def flagged(off_mps: float, aside_m: float = 0.0, cov: object = None) -> int:
        lines = perfect(truth, 20, error=(off_mps, 0.0, 0.0), offset=(aside_m, 0.0, 0.0))
        for each in lines:
            each["obstacles"][0].update(motion=motion, velocity_cov=cov)
        result = evaluate(lines, truth)
        assert result.missed == 14
        return result.flagged_misses

    cov = (np.eye(3) * 0.1**2).tolist()
    # 95 % lie within 2.8 standard deviations.
    assert flagged(0.27, cov=cov) == 14
    assert flagged(0.29, cov=cov) == 0
    assert flagged(0.0, aside_m=1.0, cov=cov) == 0
    # Without a stated uncertainty the velocity is neither right nor wrong.
    assert flagged(0.0) == 0


def test_share_is_undefined_without_misses() -> None:
    truth = BoxedTruth()
    result = evaluate(perfect(truth, 20), truth)
    assert (result.missed, result.unflagged_misses, result.unflagged_misses_share) == (0, 0, None)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"share": 1.5}, "line 1, unseen.share"),
        ({"causes": {"dark": -1}}, "line 1, unseen.causes.dark"),
        ({"cell_px": 0}, "line 1, unseen.cell_px"),
        ({"rows": []}, "line 1, unseen.rows"),
        ({"rows": ["..", "."]}, "line 1, unseen.rows: all rows must have the same length"),
        ({"rows": [""]}, "line 1, unseen.rows.0"),
    ],
)
def test_malformed_unseen_regions_are_refused(change: dict[str, Any], says: str) -> None:
    wrong = line(0, [], unseen=unseen("..", "..") | change)
    with pytest.raises(InputError) as caught:
        checked_lines([wrong])
    assert says in str(caught.value)


def test_moving_report_of_a_body_moving_in_place_is_false() -> None:
    waving = BoxedTruth(kind="person")
    waving.paths = {1: ((0.0, 0.0, 2.0), (0.0, 0.0, 0.0))}
    in_place = tally(checked_lines(perfect(waving, 10, motion="in_place")), waving)
    assert (in_place.people, in_place.moved, in_place.false) == (True, False, [])
    assert len(tally(checked_lines(perfect(waving, 10)), waving).false) == 10


def test_samples_and_episodes_record_the_kind() -> None:
    person = BoxedTruth(kind="person")
    counted = tally(checked_lines(perfect(person, 20)), person)
    assert {s.kind for s in counted.samples} == {e.kind for e in counted.episodes} == {"person"}
    assert counted.people
    robot = BoxedTruth(kind="robot")
    assert not tally(checked_lines([line(k, []) for k in range(20)]), robot).people


@pytest.mark.parametrize(
    ("box", "size", "counts"),
    [
        ((0.0, 0.0, 50.0, 100.0), (200, 100), True),
        ((0.0, 0.0, 10.0, 100.0), (200, 100), False),
        ((0.0, 0.0, 50.0, 100.0), None, False),
        (None, (200, 100), False),
    ],
)
def test_person_filling_a_tenth_of_the_image_counts_even_if_hardly_visible(
    box: tuple[float, float, float, float] | None, size: tuple[int, int] | None, counts: bool
) -> None:
    truth = BoxedTruth(visible=0.3, box_px=box)
    counted = tally(checked_lines(perfect(truth, 20)), truth, image_size=size)
    assert bool(counted.samples) is counts
