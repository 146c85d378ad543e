"""Results of a benchmark, as plain data for JSON, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from observer.evaluation.breakdown import Breakdown
from observer.evaluation.choices import Scale
from observer.evaluation.counts import FalseInstance
from observer.evaluation.evaluate import Evaluation
from observer.evaluation.sources import BenchmarkSource
from observer.evaluation.targets import Target

# Number of false instances of a preset on a source that are listed; the rest are only counted.
FALSE_LISTED = 100


@dataclass(frozen=True)
class Timing:
    """Milliseconds of a stage over all frames."""

    median_ms: float
    p95_ms: float

    def as_dict(self) -> dict[str, float]:
        """Return plain values for JSON."""
        return {"median": self.median_ms, "p95": self.p95_ms}


@dataclass(frozen=True)
class OpenCvCost:
    """Bare cost of OpenCV's calls in ``observe``, measured on separate frames.

    Attributes:
        timing: of all calls of a frame together.
        ratio: median of the whole ``observe`` on the other frames, over the median of this.
        ratio_within: median of the ratio of both on the same frame; the overhead of timing counts
            as part of ``observe``, but a busy machine disturbs it less.
        calls_ms: mean of each call per frame, most expensive first.
    """

    timing: Timing
    ratio: float
    ratio_within: float
    calls_ms: Mapping[str, float]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "per_frame_ms": self.timing.as_dict(),
            "ratio": self.ratio,
            "ratio_within": self.ratio_within,
            "calls_ms": dict(self.calls_ms),
        }


@dataclass(frozen=True)
class SourceResult:
    """Result of a preset on a source.

    Attributes:
        frames: observed. skipped: frames that the source could not read.
        evaluation: None where the source has no truth.
        false: instances with no moving true obstacle nearby.
    """

    preset: str
    source: BenchmarkSource
    frames: int
    skipped: int
    evaluation: Evaluation | None
    false: tuple[FalseInstance, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
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
    """Result of a preset over all sources.

    Attributes:
        timings: by stage, ``total`` being the whole of ``observe``; without the first frames.
            Empty if sources ran in parallel.
        opencv: None if it was not measured.
        evaluation, breakdown: of all sources with ground truth together, None without any.
        targets: empty at road scale, and without ground truth.
    """

    preset: str
    timings: Mapping[str, Timing]
    opencv: OpenCvCost | None
    evaluation: Evaluation | None
    breakdown: Breakdown | None
    targets: tuple[Target, ...] = field(default=())

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "preset": self.preset,
            "timings_ms": {stage: t.as_dict() for stage, t in self.timings.items()},
            "opencv": self.opencv.as_dict() if self.opencv else None,
            "evaluation": self.evaluation.as_dict() if self.evaluation else None,
            "breakdown": asdict(self.breakdown) if self.breakdown else None,
            "targets": [t.as_dict() for t in self.targets],
        }


@dataclass(frozen=True)
class Benchmark:
    """Result of ``run_benchmark``.

    Attributes:
        jobs: processes over which the sources were spread; cost is measured with one only.
    """

    scale: Scale
    jobs: int
    presets: tuple[PresetResult, ...]
    sources: tuple[SourceResult, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "scale": self.scale.name,
            "jobs": self.jobs,
            "presets": [p.as_dict() for p in self.presets],
            "sources": [s.as_dict() for s in self.sources],
        }


def listed(false: tuple[FalseInstance, ...]) -> dict[str, Any]:
    """Return false instances for JSON: the first ones, and the number of the others."""
    return {
        "false_instances": [asdict(each) for each in false[:FALSE_LISTED]],
        "false_instances_left_out": max(0, len(false) - FALSE_LISTED),
    }
