"""The parts of the benchmark that are measured only where they are asked for."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import typer

from app.cli.progress import progress_bar
from observer.evaluation.calibration_accuracy import (
    CalibrationAccuracy,
    calibration_accuracy,
    calibration_targets,
)
from observer.evaluation.calibration_report import calibration_markdown
from tools.benchmark.capture_report import capture_markdown
from tools.benchmark.live_capture import CaptureFigures, capture_figures
from tools.benchmark.recording_cost import RecordingFigures, recording_figures
from tools.benchmark.recording_report import recording_markdown


@dataclass(frozen=True)
class Parts:
    """What was measured of them.

    Attributes:
        calibration: one for each seed; empty where it was not asked for.
        capture, recording: None where it was not asked for.
        load: processes that wanted a processor during the last minute, before and after; None
            where the system does not tell.
    """

    calibration: tuple[CalibrationAccuracy, ...]
    capture: CaptureFigures | None
    recording: RecordingFigures | None
    load: tuple[float, float] | None

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        result: dict[str, Any] = {"load": self.load}
        if self.calibration:
            targets = calibration_targets(self.calibration)
            result["calibration"] = {
                "seeds": [run.as_dict() for run in self.calibration],
                "targets": {
                    name: [target.as_dict() for target in each] for name, each in targets.items()
                },
            }
        if self.capture is not None:
            result["capture"] = self.capture.as_dict()
        if self.recording is not None:
            result["recording"] = self.recording.as_dict()
        return result

    def markdown(self) -> str:
        """All tables."""
        parts = []
        if self.load is not None:
            parts.append(f"Load: {self.load[0]:.1f} before, {self.load[1]:.1f} after.\n")
        if self.calibration:
            parts.append(calibration_markdown(self.calibration))
        if self.capture is not None:
            parts.append(capture_markdown(self.capture))
        if self.recording is not None:
            parts.append(recording_markdown(self.recording))
        return "\n".join(parts)


def measured_parts(
    calibration_seeds: Sequence[int], *, capture: bool, recording_s: float | None
) -> Parts:
    """Measure what was asked for.

    Args:
        calibration_seeds: none where calibration was not asked for.
        recording_s: length of each measurement of recording; None where it was not asked for.

    Raises:
        BenchmarkError: a measurement could not be made.
        InputError: a seed is none, or gives no calibration.
    """
    before = _load()
    runs = []
    if calibration_seeds:
        with progress_bar("calibrating") as progress:
            for done, seed in enumerate(calibration_seeds):
                progress(done, len(calibration_seeds))
                runs.append(calibration_accuracy(seed))
    captured = capture_figures(say=_say) if capture else None
    recorded = None if recording_s is None else recording_figures(seconds=recording_s, say=_say)
    after = _load()
    load = None if before is None or after is None else (before, after)
    return Parts(tuple(runs), captured, recorded, load)


def _say(what: str) -> None:
    typer.echo(f"measuring {what}", err=True)


def _load() -> float | None:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
