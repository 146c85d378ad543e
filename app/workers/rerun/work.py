"""Job of the re-run worker."""

from __future__ import annotations

import time
from collections import deque
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import msgspec

from app.runtime.jobs import Report
from app.workers.frame_results import FrameResult, frame_result, result_line
from app.workers.rerun.messages import Rerun, Rerunned
from observer.errors import SourceError
from observer.jsonl import observation_line
from observer.mount import CameraMount
from observer.parameters import Parameters
from observer.recording.observed import ObservedWriter
from observer.recording.payloads import ParameterRevision, RecordedFrame, RunFacts
from observer.recording.reader import Recording
from observer.recording.replay import replay
from observer.recording.run_time import RunTime
from observer.recording.source import RecordingSource
from observer.recording.writer import RecordingWriter
from observer.rig.applied import mount_for
from observer.rig.rig_file import read_rig
from observer.sources.contract import SkippedFrame
from observer.types import Observation, StereoFrame

_REPORT_S = 0.25
_REVISION = 0


def rerun(job: Rerun, report: Report) -> Rerunned:
    """Observe all frames with the parameters of the job.

    Every frame keeps its times, so the new run has the recorded one's length and clock.

    Raises:
        SourceError: the recording cannot be read or holds no images.
        RecordingError: the new recording cannot be written.
    """
    with closing(_Frames(job.images)) as source:
        recording = source.recording
        mount = recording.facts.camera_mount() or _rig_mount(source, job.rig_yaml)
        facts = _facts(job, recording, mount)
        with (
            closing(_Kept(job, facts, recording)) as kept,
            Path(job.results).open("wb") as results,
        ):
            revisions = {0: (Parameters().changed(Parameters.own(job.parameters)), _REVISION)}
            count, reported = len(recording.frames), 0.0
            for observation in replay(source, revisions, mount=mount):
                result = kept.observed(
                    source.position - 1, source.recorded, source.frame, observation
                )
                results.write(result_line(result))
                now = time.monotonic()
                if now - reported >= _REPORT_S:
                    reported = now
                    report("observing", source.position / count)
            if kept.frames == 0:
                raise SourceError(
                    "none of the recording's frames could be read; see whether its file is damaged"
                )
    return Rerunned(
        frames=kept.frames,
        segments=kept.segments,
        begin_s=kept.time.begin_s,
        duration_s=kept.time.duration_s,
        bytes=Path(job.output).stat().st_size,
        lost=source.lost,
    )


class _Frames(RecordingSource):
    """Recording as a source that also remembers the frame read last.

    Attributes:
        frame: last frame, with its original reception time. lost: number of unreadable frames.
    """

    frame: StereoFrame
    lost = 0

    @property
    def recorded(self) -> RecordedFrame:
        """Return the recorded facts of the last frame, and what began with it."""
        recorded = self.recording.frames[self.position - 1]
        return msgspec.structs.replace(recorded, begins=self.begins)

    def read(self) -> StereoFrame | SkippedFrame | None:
        item = super().read()
        if isinstance(item, StereoFrame):
            item = self.frame = replace(item, received=self.recorded.received)
        elif item is not None:
            self.lost += 1
        return item


class _Kept:
    """Writer of the new recording.

    Attributes:
        time: the run's clock. frames: number of observed frames. segments: number of segments.
    """

    def __init__(self, job: Rerun, facts: RunFacts, recording: Recording) -> None:
        self.time = RunTime()
        self.frames = 0
        self.segments = 1
        self._writer = RecordingWriter(Path(job.output), facts)
        self._observed = ObservedWriter(self._writer, None)
        # Ground truth by the position of its first frame, of which the first is due next.
        self._truths = deque(recording.truths())
        revision = ParameterRevision(revision=_REVISION, values=dict(job.parameters))
        self._writer.parameters(revision, facts.anchor.monotonic)

    def close(self) -> None:
        """Complete the file; safe to call after an error."""
        self._writer.finish()

    def observed(
        self, position: int, recorded: RecordedFrame, frame: StereoFrame, observation: Observation
    ) -> FrameResult:
        """Write a frame, at its position in the original recording, and its observation."""
        while self._truths and self._truths[0][0] <= position:
            self._observed = ObservedWriter(self._writer, self._truths.popleft()[1])
        self._writer.frame(
            frame,
            source_position=recorded.source_position,
            source_time=recorded.source_time,
            begins=recorded.begins,
        )
        self.segments = observation.segment + 1
        self.frames += 1
        self.time.add_recorded(recorded)
        line = observation_line(observation)
        truth = self._observed.write(frame, observation, line)
        return frame_result(line, truth, self.time.offset_s)


def _rig_mount(source: RecordingSource, rig_yaml: str | None) -> CameraMount | None:
    rig = None if rig_yaml is None else read_rig(rig_yaml, "the run's rig")
    return mount_for(source.info, rig)


def _facts(job: Rerun, recording: Recording, mount: CameraMount | None) -> RunFacts:
    """Return the facts of the new run; its clocks are those of the recorded one."""
    return msgspec.structs.replace(
        recording.facts,
        id=job.id,
        name=job.name,
        preset=job.preset,
        versions=dict(job.versions),
        images="none",
        rig_yaml=job.rig_yaml,
        mount=None if mount is None else vars(mount),
    )
