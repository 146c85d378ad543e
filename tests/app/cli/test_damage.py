"""Option values and files given to the command line: valid, or refused with one sentence."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given

from app.cli.assignments import chosen_parameters
from app.reports.comparison import Comparison
from observer.errors import InputError
from observer.geometry import Pose
from observer.truth.alignment.result import Alignment
from observer.truth.alignment.time_offset import TimeOffset

from ...damage import damaged, damaged_text, examples, hostile_bytes, hostile_text, read_or_refused

ASSIGNMENTS = ("flow.residual_threshold_px=2.5", "ego_motion.model=affine", "tracking.gate = 3",
               "matching.cross_check=false")  # fmt: skip
WORDS = ("=", ".", "true", "evidence.radius_px=", "1e3", "NaN")


@examples(80)
@given(damaged_text(ASSIGNMENTS, WORDS) | hostile_text(WORDS + ASSIGNMENTS))
@example("flow.residual_threshold_px=" + "9" * 5000)
@example("flow.residual_threshold_px=" + "[" * 100_000)
@example("a" * 100_000)
@example("a\nb=1")
def test_any_assignment_is_valid_or_refused(text: str) -> None:
    chosen = read_or_refused(lambda: chosen_parameters("paper", [text]), InputError)
    if chosen is not None:
        assert all(
            math.isfinite(each) for each in chosen.flat().values() if isinstance(each, float)
        )


COMPARED = json.dumps(
    {
        "alignment": Alignment(
            TimeOffset(0.5, 0.01, 10.0, 1.0, None, 0.9, None, 20.0, 0.02, 200),
            {"cart": "obstacle"},
            ((0, 0.0),),
            {0: Pose.identity()},
            0.01,
            Pose.identity(),
            {},
            {"cart": (0.0, 0.1, 0.2)},
            ("a note",),
        ).as_dict(),
        "truth": {"path": "/nowhere/a.csv", "name": "a", "rate_hz": 100.0, "angles": None},
    }
).encode()


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage") / "alignment.json"


@examples(40)
@given(damaged([COMPARED], (b"null", b"{}", b"[]")) | hostile_bytes((b'{"alignment": ', b"{}")))
@example(b"[" * 100_000)
@example(b'{"alignment": [], "truth": null}')
@example(b'{"alignment": {"T_room_world": 1}, "truth": null}')
@example(b'{"alignment": null, "truth": {"path": "\\u0000"}}')
def test_a_damaged_alignment_is_refused_or_read(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    read = read_or_refused(lambda: Comparison.read(path), InputError)
    if read is not None and read.alignment is not None:
        for pose in read.alignment.T_world_room.values():
            np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-5)
