"""Comparison of two methods on identical frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

from app.contract.values import means

# Tag of the runs that a comparison keeps.
COMPARISON_TAG = "comparison"


@dataclass(frozen=True)
class ComparisonProgress:
    source_name: Annotated[str, means("Display name.")]
    words: Annotated[str, means('Current activity, such as "frame 12 of 120".')]
    share: Annotated[float, means("Progress, from 0 to 1.")]
    held: Annotated[bool, means("Whether it is paused because a robot is armed.")]


@dataclass(frozen=True)
class ComparisonStatus:
    going: Annotated[ComparisonProgress | None, means("null: no comparison is in progress.")]
    runs: Annotated[
        Sequence[str] | None,
        means("The runs of the newest comparison since the server started, one for each method."),
    ]
    trouble: Annotated[str | None, means("Why the newest comparison failed, one sentence.")]
