"""What a benchmark goes over: sources, and what their scenarios say of themselves."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Literal

from observer.evaluation.tally import ScoredFor
from observer.opening import open_source
from observer.simulation.scenarios import load_scenario

_SIMULATED = "simulated:"


@dataclass(frozen=True)
class BenchmarkSource:
    """One source of a benchmark.

    Attributes:
        spec: as ``open_source`` takes it.
        declares: what its scenario says of its cameras; None where there is no scenario.
        scored_for: which figures count.
        frames: how many it has, None where that is not known.
    """

    spec: str
    declares: Literal["ideal", "faulty"] | None
    scored_for: ScoredFor
    frames: int | None

    def planned(self, max_frames: int) -> int:
        """How many frames will be read, for all that is known."""
        return max_frames if self.frames is None else min(self.frames, max_frames)


def simulated_sources(scenarios: Sequence[str], seeds: Sequence[int]) -> tuple[str, ...]:
    """The specs of every scenario with every seed."""
    return tuple(f"{_SIMULATED}{name}?seed={seed}" for name in scenarios for seed in seeds)


def described(spec: str) -> BenchmarkSource:
    """What is known of a source before it is run.

    Raises:
        InputError: there is no such source or scenario.
    """
    if spec.startswith(_SIMULATED):
        scenario = load_scenario(spec.removeprefix(_SIMULATED).partition("?")[0] or "lab")
        return BenchmarkSource(spec, scenario.declares, scenario.scored_for, scenario.frame_count)
    with closing(open_source(spec).source) as source:
        return BenchmarkSource(spec, None, "everything", source.info.frame_count)
