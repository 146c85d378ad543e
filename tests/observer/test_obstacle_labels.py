"""Tests of the labels of obstacles."""

from __future__ import annotations

from observer.obstacle_labels import obstacle_label


def test_a_label_has_the_speed_and_its_95_percent_interval() -> None:
    assert obstacle_label(3, "moving", 0.407) == "#3  0.41 m/s"
    assert obstacle_label(3, "stopped", 0.0, 0.01) == "#3  0.00 ± 0.02 m/s"


def test_what_moves_in_place_has_no_speed() -> None:
    assert obstacle_label(3, "in_place", 0.01, 0.02) == "#3  in place"
