"""Sentences that list possible sources name every kind that exists."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.server.errors import FieldError
from app.server.source.chosen_source import check_spec
from app.server.source.hints import source_entries, source_title
from observer.errors import SourceError
from observer.opening import open_source
from observer.simulation.scenarios import load_scenario, scenario_names

KINDS = ("simulated:", "camera:", "rtsp:", "video:", "coppeliasim:")


def test_every_kind_can_be_chosen_and_is_named_in_every_hint() -> None:
    specs = [entry.spec for entry in source_entries()]
    with pytest.raises(FieldError) as refused:
        check_spec("")
    page = Path(__file__).resolve().parents[4] / "static" / "app" / "sources" / "source-picker.js"
    for kind in KINDS:
        assert any(spec.startswith(kind) for spec in specs), kind
        assert kind in str(refused.value), kind
        assert kind in page.read_text(), kind
    with pytest.raises(SourceError) as unknown:
        open_source("nonsense:1")
    assert "coppeliasim:HOST:PORT" in str(unknown.value)


def test_every_scenario_is_listed_with_beginners_scenarios_first() -> None:
    entries = [entry for entry in source_entries() if entry.spec.startswith("simulated:")]
    names = [entry.spec.removeprefix("simulated:") for entry in entries]
    assert sorted(names) == sorted(scenario_names())
    assert names[:4] == ["lab", "people", "drive", "calibration"]
    assert all(entry.picture and not entry.template for entry in entries)


def test_a_scenario_with_a_board_lists_it() -> None:
    boards = {entry.spec: entry.board for entry in source_entries() if entry.board is not None}
    assert set(boards) == {"simulated:calibration", "simulated:calibration_charuco"}
    for spec, board in boards.items():
        shown = load_scenario(spec.removeprefix("simulated:")).board
        assert shown is not None
        assert (board.kind, board.columns, board.rows, board.square_mm) == (
            shown.pattern,
            shown.columns,
            shown.rows,
            shown.square_mm,
        )


def test_recent_sources_are_listed_in_their_groups() -> None:
    recent = ["/data/KITTI/05", "simulated:people", "run:a1", "simulated:lab?seed=3", "gone:1",
              "rtsp://a/1,rtsp://b/2", "video:/v/l.mp4,/v/r.mp4"]  # fmt: skip
    entries = {entry.spec: entry for entry in source_entries(recent, {"run:a1": "Morning"})}
    assert "gone:1" not in entries
    told = {spec: (entries[spec].group, entries[spec].recent) for spec in recent if spec in entries}
    assert told == {
        "/data/KITTI/05": ("folders", 0),
        "simulated:people": ("simulated", 1),
        "run:a1": ("recordings", 2),
        "simulated:lab?seed=3": ("simulated", 3),
        "rtsp://a/1,rtsp://b/2": ("cameras", 5),
        "video:/v/l.mp4,/v/r.mp4": ("folders", 6),
    }
    assert entries["/data/KITTI/05"].title == "05"
    assert not entries["/data/KITTI/05"].template
    assert entries["run:a1"].title == "Morning"
    assert entries["simulated:lab?seed=3"].title == "The lab, seed 3"
    assert entries["simulated:lab"].recent is None


@pytest.mark.parametrize(
    ("spec", "title"),
    [
        ("simulated:lab", "The lab"),
        ("simulated:lab?seed=5", "The lab, seed 5"),
        ("/data/corridor", "corridor"),
        ("rtsp://user:secret@host/left,rtsp://host/right", "Network cameras"),
    ],
)
def test_a_source_has_a_title(spec: str, title: str) -> None:
    assert source_title(spec) == title
