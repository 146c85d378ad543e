"""Some of a run's frames out of all."""

from __future__ import annotations

import json

import pytest

from app.contract.run_frames import RunFrames
from app.contract.values import json_text, of_plain
from app.server.runs.frame_window import some_frames


def content(count: int) -> bytes:
    frames = [
        {
            "frame": 10 + k,
            "time": k / 15,
            "status": "ok",
            "obstacles": [],
            "truth": [],
            "counts": None,
            "observed_ms": 1.25,
            "plan": {"time": k / 15, "segment": 0, "camera": None, "obstacles": [], "truth": []},
        }
        for k in range(count)
    ]
    plain = {"width": 640, "height": 320, "frames": frames, "truth": False, "observed_ms": 1.25}
    text = json_text(of_plain(RunFrames, {**plain, "count": count}))
    return text if isinstance(text, bytes) else text.encode()


@pytest.mark.parametrize(
    ("window", "numbers", "every"),
    [
        ((0, None, 100), range(10), 1),
        ((0, None, 4), (0, 3, 6, 9), 3),
        ((0, None, 1), (0,), 10),
        ((4, 3, None), (4, 5, 6), 1),
        ((8, 50, None), (8, 9), 1),
        ((2, 8, 2), (2, 6), 4),
        ((10, 5, None), (), 1),
        ((99, None, 3), (), 1),
    ],
)
def test_a_window_contains_the_stored_frames(
    window: tuple[int, int | None, int | None], numbers: tuple[int, ...], every: int
) -> None:
    whole = json.loads(content(10))
    found = json.loads(some_frames(content(10), *window))
    assert found["frames"] == [whole["frames"][k] for k in numbers]
    assert (found["first"], found["every"], found["count"]) == (window[0], every, 10)
    assert {**found, "frames": [], "first": 0, "every": 1} == {**whole, "frames": []}


def test_an_empty_run_has_no_frames_in_any_window() -> None:
    assert json.loads(some_frames(content(0), 0, None, 5))["frames"] == []
