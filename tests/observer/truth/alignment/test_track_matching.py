"""Tracks are matched to bodies by position; the user's choice overrides it."""

from __future__ import annotations

from observer.truth.alignment.observed import TrackKey
from observer.truth.alignment.track_matching import Match, match_tracks

A, B, C = TrackKey(0, 1), TrackKey(0, 2), TrackKey(0, 3)


def test_one_body_may_match_several_consecutive_tracks() -> None:
    matches = match_tracks(
        {A: (0, 5), B: (5.3, 9), C: (2, 4)},
        {A: {"P3DX": 0.1}, B: {"P3DX": 0.2}, C: {"P3DX": 0.4}},
        {},
    )
    assert matches[A] == Match("P3DX", "position", 0.1)
    assert matches[B].body == "P3DX"
    # Beside A at the same time: a second track of one body is a ghost.
    assert matches[C].body is None


def test_each_track_matches_the_nearest_body_within_the_gate() -> None:
    matches = match_tracks(
        {A: (0, 9), B: (0, 9), C: (0, 9)},
        {
            A: {"one": 0.2, "two": 2.0},
            B: {"one": 0.9, "two": 0.1},
            C: {"one": 1.4, "two": float("nan")},
        },
        {},
    )
    assert [matches[key].body for key in (A, B, C)] == ["one", "two", None]


def test_user_choice_overrides_matching_by_position() -> None:
    matches = match_tracks(
        {A: (0, 9), B: (0, 9)},
        {A: {"one": 0.1, "two": 0.5}, B: {"one": 0.15, "two": 3.0}},
        {A: "two", C: "one"},
    )
    assert matches[A] == Match("two", "person", 0.5)
    assert matches[B].body == "one"
    assert C not in matches
    none = match_tracks({A: (0, 9)}, {A: {"one": 0.1}}, {A: None})
    assert none[A] == Match(None, "person", None)


def test_unknown_distance_to_the_chosen_body_is_none() -> None:
    matches = match_tracks({A: (0, 9), B: (0, 9)}, {A: {"one": float("nan")}}, {A: "one", B: "two"})
    assert matches == {A: Match("one", "person", None), B: Match("two", "person", None)}
