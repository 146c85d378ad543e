"""Runs of presets over one source: results and cost.

Time spent in the source (rendering, reading) is left out of every figure.
"""

from __future__ import annotations

import random
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

from observer.errors import InputError
from observer.evaluation.counts import Tally
from observer.evaluation.lines import checked_lines
from observer.evaluation.opencv_time import OpenCvRecorder
from observer.evaluation.sources import BenchmarkSource
from observer.evaluation.tally import tally
from observer.jsonl import ObservationLine, observation_line
from observer.observer import Observer
from observer.opening import OpenedSource, open_source
from observer.parameters import Parameters
from observer.sources.contract import begins_segment
from observer.types import StereoFrame

# First frames that are not timed: caches and clock rates settle.
_WARM_UP_FRAMES = 3
# Share of the frames on which OpenCV's calls are timed instead of the stages. They are drawn at
# random, so that periodic work of the method falls on both kinds of frames.
_RECORDED_SHARE = 1 / 3


@dataclass
class SourceRun:
    """Run of a preset on a source.

    Attributes:
        image_size: width, height.
        frames: observed. skipped: frames that the source could not read.
        tally: None if the source has no ground truth, or the preset saw only part of it.
        times_ms: by stage, one value for each frame on which stages were timed.
        opencv_ms: by call, one mapping for each of the other frames. recorded_ms: time of the
            whole of ``observe`` on these, including the overhead of timing.
        timed_frames: the frame number of each value in ``times_ms``.
    """

    image_size: tuple[int, int]
    frames: int = 0
    skipped: int = 0
    tally: Tally | None = None
    times_ms: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    opencv_ms: list[Mapping[str, float]] = field(default_factory=list)
    recorded_ms: list[float] = field(default_factory=list)
    timed_frames: list[int] = field(default_factory=list)


def run_source(
    source: BenchmarkSource,
    presets: Mapping[str, Parameters],
    max_frames: int,
    gate_m: float,
    report: Callable[[int], None],
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, SourceRun]:
    """Observe one source with all presets in turn, frame by frame.

    The presets see the same noise and share the machine's load.

    Args:
        report: called with the number of frames done, before each one.

    Raises:
        InputError: the source cannot be opened or has no calibration.
    """
    opened = open_source(source.spec)
    with closing(opened.source):
        return run_opened(opened, source, presets, max_frames, gate_m, report, clock)


def run_opened(
    opened: OpenedSource,
    source: BenchmarkSource,
    presets: Mapping[str, Parameters],
    max_frames: int,
    gate_m: float,
    report: Callable[[int], None],
    clock: Callable[[], float] = time.perf_counter,
    *,
    during: Mapping[str, range] | None = None,
    recorded_share: float = _RECORDED_SHARE,
) -> dict[str, SourceRun]:
    """Observe an open source as ``run_source`` does; it stays open.

    Args:
        during: frame numbers of presets that see only part of the source.
        recorded_share: share of the frames on which OpenCV's calls are timed.

    Raises:
        InputError: the source has no calibration.
    """
    calibration = opened.source.calibration
    if calibration is None:
        raise InputError(f"{source.spec} has no calibration, so it cannot be benchmarked")
    observers = {
        name: Observer(calibration, parameters, mount=opened.source.info.mount, clock=clock)
        for name, parameters in presets.items()
    }
    info = opened.source.info
    runs = {name: SourceRun((info.width, info.height)) for name in presets}
    lines: dict[str, list[ObservationLine]] = {name: [] for name in presets}
    spans = {name: (during or {}).get(name, range(max_frames)) for name in presets}
    recorder, draw = OpenCvRecorder(clock), random.Random(0)  # nosec B311
    for number, frame in enumerate(_frames(opened.source.read, max_frames)):
        report(number)
        settled = number >= _WARM_UP_FRAMES
        recorded = settled and draw.random() < recorded_share
        if not isinstance(frame, StereoFrame):
            for run in runs.values():
                run.skipped += 1
            continue
        for name, observer in observers.items():
            run = runs[name]
            if number not in spans[name]:
                continue
            if begins_segment(opened.source):
                observer.begin_segment()
            if recorded:
                with recorder.on():
                    observation = observer.observe(frame)
                run.opencv_ms.append(recorder.take())
                run.recorded_ms.append(observation.timings_ms["total"])
            else:
                observation = observer.observe(frame)
            lines[name].append(observation_line(observation))
            if number - spans[name].start >= _WARM_UP_FRAMES and not recorded:
                run.timed_frames.append(number)
                for stage, ms in observation.timings_ms.items():
                    run.times_ms[stage].append(ms)
    for name, run in runs.items():
        run.frames = len(lines[name])
        if opened.truth is not None and name not in (during or {}):
            checked = checked_lines(lines[name])
            run.tally = tally(checked, opened.truth, gate_m, source.scored_for, run.image_size)
    return runs


def _frames(read: Callable[[], Any], most: int) -> Iterator[Any]:
    for _ in range(most):
        frame = read()
        if frame is None:
            return
        yield frame
