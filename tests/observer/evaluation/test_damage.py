"""Damaged JSON lines and grids of parameters: valid or refused with one line."""

from __future__ import annotations

import json
import math
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from observer.errors import DynamicObserverError, InputError, TruthError
from observer.evaluation.lines import checked_lines, read_both
from observer.evaluation.sweep.grid import grid_from_text
from observer.truth.alignment.observed import ObservedRun

from ...damage import damaged, damaged_text, examples, hostile_bytes, hostile_text, read_or_refused
from .sweep.test_grid import TEXT as GRID


def line(frame: int) -> dict[str, Any]:
    """Return a line of observe with one obstacle."""
    three = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]]
    obstacle = {
        "id": 3, "state": "confirmed", "motion": "moving", "position": [1.0, 0.2, 4.0],
        "velocity": [0.3, 0.0, 0.0], "speed": 0.3, "speed_std": 0.02, "position_cov": three,
        "velocity_cov": three, "velocity_time": frame / 15, "size": [0.4, 0.3, 0.5],
        "orientation_wxyz": [1.0, 0.0, 0.0, 0.0], "range": 4.1, "bearing": 0.2,
        "closing_speed": 0.1, "points": 30, "significance": 9.0,
        "box_px": [10.0, 20.0, 50.0, 80.0], "why": "it moves", "silhouette": [[[1, 2], [3, 4]]],
    }  # fmt: skip
    return {
        "frame": frame, "time": frame / 15, "segment": 0, "status": "ok", "reasons": [],
        "parameters_revision": 1,
        "pose": {"position": [0.1 * frame, 0.0, 0.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]},
        "obstacles": [obstacle], "timings_ms": {"features": 1.2},
        "unseen": {"share": 0.25, "causes": {"texture": 0.25}, "cell_px": 16, "rows": ["..", ".t"]},
    }  # fmt: skip


LINES = "".join(json.dumps(line(k)) + "\n" for k in range(4)).encode()


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage") / "observed.jsonl"


@examples(80)
@given(content=damaged([LINES], (b"null", b"[]", b'"pose": null')) | hostile_bytes((b"{}\n",)))
@example(LINES.replace(b'"frame": 1', b'"frame": ' + b"9" * 5000))
@example(LINES.replace(b"0.3", b"9" * 400))
@example(LINES.replace(b'"orientation_wxyz": [1.0', b'"orientation_wxyz": [0.0'))
@example(LINES.replace(b'"frame"', b'"' + b"a" * 5000 + b'"', 1))
@example(b"[" * 100_000)
def test_damaged_lines_are_refused_or_in_order(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    both = read_or_refused(lambda: read_both(path), InputError)
    if both is None:
        return
    lines, contents = both
    assert lines
    for before, after in pairwise(lines):
        assert after.segment != before.segment or after.time >= before.time
    for each in lines:
        assert math.isfinite(each.time)
        if each.pose is not None:
            assert math.hypot(*each.pose.orientation_wxyz) == pytest.approx(1, abs=1e-3)
    # Whatever evaluation accepts, alignment must accept too, or say why not.
    read_or_refused(lambda: ObservedRun.of_lines(contents), DynamicObserverError)


@examples(60)
@given(data=st.data())
def test_lines_of_any_shape_are_accepted_or_refused(data: st.DataObject) -> None:
    changed = line(0)
    within: Any = data.draw(st.sampled_from([changed, changed["obstacles"][0], changed["pose"]]))
    key = data.draw(st.sampled_from(sorted(within)))
    within[key] = data.draw(
        st.none() | st.floats() | st.text(max_size=5) | st.lists(st.floats(), max_size=5)
        | st.integers() | st.just({}) | st.just([{}]) | st.just(10**400)
    )  # fmt: skip
    read_or_refused(lambda: checked_lines([changed]), InputError)
    read_or_refused(lambda: ObservedRun.of_lines([changed]), TruthError)


WORDS = ("preset: paper\n", "set: {", "evidence.radius_px: [20]\n", "tracking.gate: ", "[1, 2]")


@examples(60)
@given(damaged_text([GRID], WORDS) | hostile_text(WORDS))
def test_damaged_grid_is_refused_or_can_be_swept(text: str) -> None:
    grid = read_or_refused(lambda: grid_from_text(text, "grid.yaml"), InputError)
    if grid is not None:
        assert grid.count >= 1
        first = read_or_refused(lambda: grid.combination(1), InputError)
        assert first is None or first.number == 1
