"""One of the runs made from the same frames."""

from __future__ import annotations

import json
import time
from pathlib import Path

import msgspec

from app.contract.values import plain
from app.workers.frame_results import frame_result, result_line
from app.workers.methods.frames import run_frames
from app.workers.methods.messages import FRAMES, SPEEDS, NewRun
from observer.calibration.formats.opencv_file import read_calibration
from observer.geometry import Pose
from observer.jsonl import ObservationLine, observation_line
from observer.observer import Observer
from observer.parameters import Parameters
from observer.recording.observed import ObservedWriter
from observer.recording.payloads import Begins, ParameterRevision, RunFacts
from observer.recording.reader import Recording
from observer.recording.run_folder import RECORDING
from observer.recording.writer import RecordingWriter
from observer.truth.contract import TrueBody, Truth
from observer.types import StereoFrame

# Frames whose truth is remembered: the one being observed and the next one.
_REMEMBERED = 2


class KnownTruth:
    """Truth at a few instants, for all methods; implements ``observer.truth.contract.Truth``.

    A simulator renders to determine what is visible, and only one thread may use it: the thread
    that reads the source calls ``look_up``; afterwards any thread may query these instants.
    """

    def __init__(self, truth: Truth) -> None:
        self._truth = truth
        self._known: dict[float, tuple[tuple[TrueBody, ...], Pose | None]] = {}

    def look_up(self, time: float) -> None:
        """Look up the truth at an instant; the oldest instant is forgotten."""
        known = [*self._known.items()][1 - _REMEMBERED :]
        found = self._truth.bodies(time), self._truth.camera_pose(time)
        self._known = {**dict(known), time: found}

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        return self._known[time][0]

    def camera_pose(self, time: float) -> Pose | None:
        return self._known[time][1]


class MethodRun:
    """Observer with its recording and the per-frame results for the server.

    Attributes:
        segments: number of segments so far.

    Raises:
        RecordingError, OSError: a file cannot be written.
    """

    def __init__(self, run: NewRun, common: RunFacts, truth: KnownTruth | None) -> None:
        """Begin its files.

        Args:
            common: the facts that all runs share.
        """
        self._folder = Path(run.folder)
        facts = msgspec.structs.replace(
            common, id=run.id, name=run.name, preset=run.preset, images=run.images
        )
        self._observer = Observer(
            read_calibration(facts.calibration_yaml, name="the calibration"),
            Parameters().changed(Parameters.own(run.parameters)),
            mount=facts.camera_mount(),
            # Other load on the machine must not count as the method's cost.
            clock=time.thread_time,
        )
        self._speeds = (self._folder / SPEEDS).open("wb")
        self._writer = RecordingWriter(self._folder / RECORDING, facts)
        self._observed = ObservedWriter(self._writer, truth)
        revision = ParameterRevision(revision=0, values=dict(run.parameters))
        self._writer.parameters(revision, facts.anchor.monotonic)
        self.segments = 1

    def observe(self, frame: StereoFrame, begins: Begins | None) -> ObservationLine:
        """Observe the next frame, write the result and return its JSON line."""
        if begins is not None:
            self._observer.begin_segment()
        self._writer.frame(frame, begins=None if begins is None else "segment")
        observation = self._observer.observe(frame)
        line = observation_line(observation)
        bodies = self._observed.write(frame, observation, line)
        self.segments = max(self.segments, line["segment"] + 1)
        self._speeds.write(result_line(frame_result(line, bodies)))
        return line

    def finish(self) -> None:
        """Complete the files; safe to call twice."""
        self._writer.finish()
        self._speeds.close()

    def write_frames(self) -> None:
        """Write the results of each frame; call ``finish`` first."""
        with Recording(self._folder / RECORDING) as recording:
            found = run_frames(recording, recording.truth())
        text = json.dumps(plain(found), allow_nan=False)
        (self._folder / FRAMES).write_text(text, encoding="utf-8")
