"""Evidence of the followed features: its parts belong together."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from observer.methods.rigid.point_evidence import PointEvidence


def evidence(count: int) -> PointEvidence:
    return PointEvidence(
        px=np.zeros((count, 2), np.float32),
        depth=np.full(count, np.nan),
        age_s=np.zeros(count),
        velocity=np.zeros((count, 3)),
        velocity_std=np.ones(count),
        significance=np.zeros(count),
        threshold=5.0,
        dynamic=np.zeros(count, np.bool_),
        neighbours=np.ones(count, np.int_),
        obstacle_id=np.full(count, -1),
    )


@pytest.mark.parametrize("count", [0, 1, 7])
def test_it_is_of_as_many_features_as_it_says(count: int) -> None:
    assert len(evidence(count)) == count


@pytest.mark.parametrize("name", [f.name for f in fields(PointEvidence) if f.name != "threshold"])
def test_every_part_must_be_of_the_same_features(name: str) -> None:
    other = getattr(evidence(4), name)
    named = "px|depth|age_s|velocity" if name == "px" else name
    with pytest.raises(ValueError, match=named):
        replace(evidence(3), **{name: other})


@pytest.mark.parametrize("name", ["px", "velocity", "depth"])
def test_every_part_must_have_its_shape(name: str) -> None:
    changes: dict[str, Any] = {name: np.zeros((3, 4))}
    with pytest.raises(ValueError, match=f"{name} must have shape"):
        replace(evidence(3), **changes)
