"""What a benchmark found, as plain data for JSON, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from observer.evaluation.breakdown import Breakdown, Scale
from observer.evaluation.evaluate import Evaluation
from observer.evaluation.sources import BenchmarkSource
from observer.evaluation.tally import FalseInstance
from observer.evaluation.targets import Target

# So many false instances of one preset on one source are listed; the rest are counted only.
FALSE_LISTED = 100


@dataclass(frozen=True)
class Timing:
    """Milliseconds of one stage over all frames."""

    median_ms: float
    p95_ms: float

    def as_dict(self) -> dict[str, float]:
        """Plain values for JSON."""
        return {"median": self.median_ms, "p95": self.p95_ms}


@dataclass(frozen=True)
class OpenCvCost:
    """The bare cost of OpenCV's calls in ``observe``, taken on frames of their own.

    Attributes:
        timing: of all calls of a frame together.
        ratio: median of the whole ``observe`` on the other frames, over the median of this.
        ratio_within: median of the ratio of both on one and the same frame; the taking of the
            time counts as ``observe``'s, but a busy machine disturbs it less.
        calls_ms: mean of each call, per frame, the most expensive ones first.
    """

    timing: Timing
    ratio: float
    ratio_within: float
    calls_ms: Mapping[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "per_frame_ms": self.timing.as_dict(),
            "ratio": self.ratio,
            "ratio_within": self.ratio_within,
            "calls_ms": dict(self.calls_ms),
        }


@dataclass(frozen=True)
class SourceResult:
    """One preset on one source.

    Attributes:
        frames: observed. skipped: frames that the source could not read.
        evaluation: None where the source has no truth.
        false: instances with no moving truth near.
    """

    preset: str
    source: BenchmarkSource
    frames: int
    skipped: int
    evaluation: Evaluation | None
    false: tuple[FalseInstance, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "preset": self.preset,
            "source": self.source.spec,
            "declares": self.source.declares,
            "scored_for": self.source.scored_for,
            "frames": self.frames,
            "skipped": self.skipped,
            "evaluation": self.evaluation.as_dict() if self.evaluation else None,
            **listed(self.false),
        }


@dataclass(frozen=True)
class PresetResult:
    """One preset over all sources.

    Attributes:
        timings: by stage, ``total`` being the whole of ``observe``; without the first frames.
            Empty where sources ran side by side.
        opencv: None where it was not measured.
        evaluation, breakdown: all sources with truth together, None without any.
        targets: empty on the road, and without truth.
    """

    preset: str
    timings: Mapping[str, Timing]
    opencv: OpenCvCost | None
    evaluation: Evaluation | None
    breakdown: Breakdown | None
    targets: tuple[Target, ...] = field(default=())

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "preset": self.preset,
            "timings_ms": {stage: t.as_dict() for stage, t in self.timings.items()},
            "opencv": self.opencv.as_dict() if self.opencv else None,
            "evaluation": self.evaluation.as_dict() if self.evaluation else None,
            "breakdown": self.breakdown.as_dict() if self.breakdown else None,
            "targets": [t.as_dict() for t in self.targets],
        }


@dataclass(frozen=True)
class Benchmark:
    """What ``run_benchmark`` found.

    Attributes:
        jobs: processes over which the sources were spread; cost is measured with one only.
    """

    scale: Scale
    jobs: int
    presets: tuple[PresetResult, ...]
    sources: tuple[SourceResult, ...]

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {
            "scale": self.scale.name,
            "jobs": self.jobs,
            "presets": [p.as_dict() for p in self.presets],
            "sources": [s.as_dict() for s in self.sources],
        }


def listed(false: tuple[FalseInstance, ...]) -> dict[str, Any]:
    """The false instances for JSON: the first ones, and how many were left out."""
    return {
        "false_instances": [each.as_dict() for each in false[:FALSE_LISTED]],
        "false_instances_left_out": max(0, len(false) - FALSE_LISTED),
    }
