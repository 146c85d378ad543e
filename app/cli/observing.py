"""The work of ``observe``, once its progress bar is shown: observing a source at full speed."""

from __future__ import annotations

import json
import sys
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import typer

from app.cli.assignments import chosen_parameters
from app.cli.keeping import Keeper, keeping
from app.cli.output import whole_text
from app.cli.progress import ProgressBar
from observer.calibration.formats.recognition import named_file, read_any
from observer.calibration.formats.understanding import Size
from observer.calibration.formats.units import UnitUnclear, parse_unit
from observer.camera import StereoCalibration
from observer.errors import CalibrationError, InputError
from observer.jsonl import observation_line
from observer.number_format import count_of
from observer.observer import Observer
from observer.opening import OpenedSource, open_source
from observer.recording.payloads import Images
from observer.sources.contract import NoFrame, SkippedFrame, Source, begins_segment


@dataclass(frozen=True, kw_only=True)
class Observing:
    """Requested observation; the fields are the options of ``observe``."""

    source: str
    output: Path | None
    calibration: list[str]
    unit: str | None
    assignments: list[str]
    preset: str
    frames: int | None
    tentative: bool
    record: Path | None
    record_images: Images
    video: Path | None

    def run(self, progress: ProgressBar) -> None:
        """Observe to the end and write the requested files.

        Raises:
            DynamicObserverError: one sentence; an input is wrong, or the work failed.
        """
        parameters = chosen_parameters(self.preset, self.assignments)
        found = open_source(self.source)
        opened = found.source
        try:
            used = self._calibration(found)
            if found.truth_note is not None:
                typer.echo(f"ground truth: {found.truth_note}", err=True)
            observer = Observer(used, parameters, mount=opened.info.mount)
            keeper = keeping(
                opened.info, found.truth, used, parameters, self.preset,
                record=self.record, images=self.record_images, video=self.video,
            )  # fmt: skip
            with (
                nullcontext(sys.stdout) if self.output is None else whole_text(self.output) as file,
                keeper as kept,
            ):
                progress.begin(f"observing {self.source}")
                if self.output is None and sys.stdout.isatty():
                    # The lines themselves show the progress.
                    progress.end()
                skipped = _observe_all(
                    opened, observer, file, progress, self.frames, self.tentative, kept
                )
            if self.video is not None:
                typer.echo(f"{self.video}: {kept.video_summary}", err=True)
        finally:
            opened.close()
        if skipped:
            shown = "; ".join(f"{s.index}: {s.reason}" for s in skipped[:5])
            more = f"; and {len(skipped) - 5} more" if len(skipped) > 5 else ""
            typer.echo(f"skipped {count_of(len(skipped), 'frame')}: {shown}{more}", err=True)

    def _calibration(self, found: OpenedSource) -> StereoCalibration:
        """Return the calibration to observe with; log decisions to stderr."""
        info = found.source.info
        if self.calibration:
            return _read_calibration(self.calibration, (info.width, info.height), self.unit)
        if found.calibration_notes:
            typer.echo(f"calibration: {'; '.join(found.calibration_notes)}", err=True)
        if found.source.calibration is None:
            raise CalibrationError(
                f"{self.source} has no calibration; name one with --calibration FILE (OpenCV YAML "
                "with K1 D1 K2 D2 R T, or the format of another tool)"
            )
        return found.source.calibration


def _read_calibration(names: list[str], size: Size, unit: str | None) -> StereoCalibration:
    """Read the calibration from these files for images of this size; log decisions to stderr.

    Args:
        unit: as ``parse_unit`` takes it, or None for the format's own.
    """
    # A file name may contain a comma.
    paths = [
        path
        for name in names
        for path in ([name] if Path(name).exists() else filter(None, name.split(",")))
    ]
    try:
        read = read_any(
            [named_file(path) for path in paths],
            unit=None if unit is None else parse_unit(unit),
            expected_size=size,
        )
    except UnitUnclear as error:
        raise error.asking("say --unit {}") from None
    typer.echo(f"calibration: {'; '.join((read.format, *read.notes))}", err=True)
    return read.calibration


def _observe_all(
    source: Source,
    observer: Observer,
    file: IO[str],
    progress: ProgressBar,
    limit: int | None,
    tentative: bool,
    kept: Keeper,
) -> list[SkippedFrame]:
    """Write one line per readable frame; return the frames that could not be read."""
    skipped: list[SkippedFrame] = []
    observed = 0
    trouble: str | None = None
    while limit is None or observed < limit:
        frame = source.read()
        if frame is None:
            break
        if isinstance(frame, SkippedFrame):
            skipped.append(frame)
            kept.skipped(frame)
            continue
        if isinstance(frame, NoFrame):
            # Reported once as long as it stays the same.
            if frame.trouble not in (None, trouble):
                typer.echo(frame.trouble, err=True)
            trouble = frame.trouble
            kept.waited()
            continue
        kept.frame(frame)
        if begins_segment(source):
            observer.begin_segment()
        observation = observer.observe(frame)
        line = observation_line(observation, tentative=tentative)
        file.write(json.dumps(line, allow_nan=False) + "\n")
        kept.observed(frame, observation, line)
        observed += 1
        progress(observed, limit or source.info.frame_count)
    if observed == 0:
        reasons = f": {skipped[0].reason}" if skipped else ""
        raise InputError(f"{source.info.spec} has no frame that could be read{reasons}")
    return skipped
