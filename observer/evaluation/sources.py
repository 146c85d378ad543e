"""Sources of a benchmark, and what their scenarios declare."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Literal

from observer.evaluation.counts import ScoredFor
from observer.opening import open_source, simulated_world, source_kind
from observer.simulation.scenarios import load_scenario


@dataclass(frozen=True)
class BenchmarkSource:
    """Source of a benchmark.

    Attributes:
        spec: as for ``open_source``.
        declares: what its scenario declares about its cameras; None without a scenario.
        scored_for: the figures that count.
        frames: their number, None where unknown.
    """

    spec: str
    declares: Literal["ideal", "faulty"] | None
    scored_for: ScoredFor
    frames: int | None

    def planned(self, max_frames: int) -> int:
        """Return the number of frames that will be read, as far as known."""
        return max_frames if self.frames is None else min(self.frames, max_frames)


def simulated_sources(scenarios: Sequence[str], seeds: Sequence[int]) -> tuple[str, ...]:
    """Return the specs of every scenario with every seed."""
    return tuple(f"simulated:{name}?seed={seed}" for name in scenarios for seed in seeds)


def described(spec: str) -> BenchmarkSource:
    """Describe a source before it is run.

    Raises:
        InputError: there is no such source or scenario.
    """
    if source_kind(spec) == "simulated":
        scenario = load_scenario(simulated_world(spec)[0])
        return BenchmarkSource(spec, scenario.declares, scenario.scored_for, scenario.frame_count)
    with closing(open_source(spec).source) as source:
        return BenchmarkSource(spec, None, "everything", source.info.frame_count)
