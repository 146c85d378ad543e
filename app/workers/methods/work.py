"""Job of the worker that compares methods."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import asdict, replace
from pathlib import Path

import cv2

from app.runtime.jobs import Report
from app.workers.methods.messages import Compared, CompareMethods
from app.workers.methods.method_run import KnownTruth, MethodRun
from app.workers.methods.picture import MethodsPicture
from observer.calibration.formats.opencv_file import (
    calibration_id,
    calibration_text,
    read_calibration,
)
from observer.errors import CalibrationError, SourceError
from observer.jsonl import ObservationLine
from observer.mount import CameraMount
from observer.opening import open_source
from observer.recording.payloads import Anchor, Begins, RunFacts
from observer.recording.run_time import RunTime
from observer.recording.source import RecordingSource
from observer.rig.applied import mount_for
from observer.rig.rig_file import read_rig
from observer.sources.contract import Source
from observer.types import StereoFrame

# Shares of the total progress for opening the source and for reading the results.
_OPENING, _READING = 0.02, 0.05


def compare(job: CompareMethods, report: Report) -> Compared:
    """Observe each frame with every method, one thread each, while the next frame is read.

    Raises:
        SourceError: the source cannot be opened, or has no readable frame.
        CalibrationError: the source has no calibration, or one that cannot be used.
        RecordingError: a recording cannot be written.
    """
    report("opening the source", 0.0)
    # Each method's CPU time is measured for its thread only, so OpenCV must not use others.
    cv2.setNumThreads(1)
    opened = open_source(job.source)
    with closing(opened.source) as source, ExitStack() as stack:
        text = job.calibration_yaml or _own_calibration(source)
        rig = None if job.rig_yaml is None else read_rig(job.rig_yaml, "the rig")
        facts = _facts(job, source, text, mount_for(source.info, rig, calibration_id(text)))
        truth = None if opened.truth is None else KnownTruth(opened.truth)
        methods = [MethodRun(run, facts, truth) for run in job.runs]
        for method in methods:
            stack.callback(method.finish)
        shown = MethodsPicture(Path(job.picture), read_calibration(text, name="the calibration"))
        progress = _Progress(report, _planned(source, job.seconds), shown)
        threads = stack.enter_context(ThreadPoolExecutor(len(methods)))
        run_time, begin = RunTime(), facts.anchor.monotonic
        for frame, begins in _frames(source, job):
            if run_time.begin_s is None:
                begin -= frame.time
            # Log times follow the source's clock, not the speed at which this machine observes.
            frame = replace(frame, received=begin + frame.time)
            if truth is not None:
                truth.look_up(frame.time)
            progress.wait()
            progress.begin(frame, [threads.submit(each.observe, frame, begins) for each in methods])
            run_time.add(frame.time, frame.received)
        progress.wait()
        if not progress.frames:
            raise SourceError(f"{source.info.spec} has no frame that could be read")
        report("comparing with ground truth", 1 - _READING)
        for method in methods:
            method.finish()
            method.write_frames()
        return Compared(
            frames=progress.frames,
            segments=tuple(method.segments for method in methods),
            begin_s=run_time.begin_s,
            duration_s=run_time.duration_s,
            calibration_yaml=text,
            spec=source.info.spec,
        )


class _Progress:
    """Frame being observed, and progress so far.

    Attributes:
        frames: number of frames that all methods have observed.
    """

    def __init__(self, report: Report, planned: int, picture: MethodsPicture) -> None:
        self._report = report
        self._planned = planned
        self._picture = picture
        self._going: tuple[StereoFrame, list[Future[ObservationLine]]] | None = None
        self.frames = 0

    def begin(self, frame: StereoFrame, lines: list[Future[ObservationLine]]) -> None:
        """Take the next frame with each method's pending result; call ``wait`` first."""
        self._going = frame, lines

    def wait(self) -> None:
        """Wait until all methods have observed the frame, if there is one; report progress."""
        if self._going is None:
            return
        frame, lines = self._going
        self._going = None
        self._picture.show(frame, [line.result() for line in lines])
        self.frames += 1
        share = min(1.0, self.frames / self._planned)
        self._report(
            f"frame {self.frames} of {max(self._planned, self.frames)}",
            _OPENING + (1 - _OPENING - _READING) * share,
        )


def _own_calibration(source: Source) -> str:
    if source.calibration is None:
        raise CalibrationError(
            f"{source.info.spec} has no calibration, so no distance or speed can be compared; "
            "calibrate its cameras first"
        )
    return calibration_text(source.calibration)


def _facts(job: CompareMethods, source: Source, text: str, mount: CameraMount | None) -> RunFacts:
    """Return the facts that all runs share."""
    return RunFacts(
        id="",
        name="",
        source=source.info.spec,
        info=asdict(source.info),
        calibration_yaml=text,
        rig_yaml=job.rig_yaml,
        mount=None if mount is None else asdict(mount),
        versions=dict(job.versions),
        anchor=Anchor.now(),
    )


def _planned(source: Source, seconds: float) -> int:
    info = source.info
    wanted = max(1, round(seconds * (info.frame_rate or 1.0)))
    return wanted if info.frame_count is None else max(1, min(wanted, info.frame_count))


def _frames(source: Source, job: CompareMethods) -> Iterator[tuple[StereoFrame, Begins | None]]:
    """Yield the frames of the wanted seconds, each with what begins at it, if anything."""
    if job.newest and isinstance(source, RecordingSource):
        times = source.times
        source.seek(next(k for k, t in enumerate(times) if t > times[-1] - job.seconds))
    begin: float | None = None
    while (item := source.read()) is not None:
        if not isinstance(item, StereoFrame):
            continue
        if begin is not None and not 0 <= item.time - begin < job.seconds:
            return
        begins = source.begins if isinstance(source, RecordingSource) else None
        # The observers are new at the first frame in any case.
        yield item, None if begin is None else begins
        begin = item.time if begin is None else begin
