"""Results of each frame of a run, with the counts against ground truth so far."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from statistics import median

import numpy as np

from app.contract.robots import GoalNow
from app.contract.run_frames import FrameBody, FrameCounts, FrameEntry, FrameObstacle, RunFrames
from app.workers.methods.goals import Goals
from app.workers.methods.plans import Plans, plan_maps
from observer.camera import StereoCamera
from observer.evaluation.counts import Sample, Tally
from observer.evaluation.lines import checked_lines
from observer.evaluation.tally import tally
from observer.geometry import Pose
from observer.jsonl import ObservationLine, ObstacleEntry, line_pose
from observer.recording.payloads import RecordedFrame
from observer.recording.reader import Recording
from observer.recording.run_times import RunTimes
from observer.truth.contract import Truth
from observer.vision.rectification import Rectification

# A picture does not show finer digits.
_PX_DIGITS, _SPEED_DIGITS, _MS_DIGITS = 1, 4, 2
# Metres: an arrow to a point closer to the camera than this would leave the picture.
_NEAREST_M = 0.2
_TOTAL = "total"

# Segment and frame of a line.
_Place = tuple[int, int]


def run_frames(recording: Recording, truth: Truth | None) -> RunFrames:
    """Return the answer of ``GET /api/runs/{id}/frames``: an entry for each recorded frame.

    Args:
        truth: ground truth on the run's clock (see ``RunTimes``); None if there is none.

    Raises:
        InputError: the recorded observations are not in the format that this program writes.
        CalibrationError: the recorded calibration cannot be used.
    """
    camera = Rectification(recording.calibration()).camera
    placed = list(recording.positioned_lines())
    lines, by_position = [line for _, line in placed], dict(placed)
    times = RunTimes(recording.frames)
    scores = None
    if truth is not None:
        size = camera.width, camera.height
        scores = _Scores(tally(checked_lines(times.lines(lines)), truth, image_size=size))
    plans, goals = Plans(recording, truth), Goals(recording)
    entries = [
        # A killed engine leaves a frame without a line.
        _entry(
            frame, by_position.get(k), camera, _bodies(truth, time), scores, plans, goals.of(frame)
        )
        for k, (frame, (_, time)) in enumerate(zip(recording.frames, times.frames, strict=True))
    ]
    took = [entry.observed_ms for entry in entries if entry.observed_ms is not None]
    return RunFrames(
        width=camera.width,
        height=camera.height,
        frames=entries,
        truth=truth is not None,
        observed_ms=round(median(took), _MS_DIGITS) if took else None,
        count=len(entries),
        maps=plan_maps(recording),
    )


class _Scores:
    """Counts against ground truth, frame by frame in order."""

    def __init__(self, counted: Tally) -> None:
        self._samples: defaultdict[_Place, list[Sample]] = defaultdict(list)
        for sample in counted.samples:
            self._samples[sample.segment, sample.frame].append(sample)
        self._false: defaultdict[_Place, set[int]] = defaultdict(set)
        for each in counted.false:
            self._false[each.segment, each.frame].add(each.id)
        self._sums = _Sums()

    def false(self, place: _Place) -> set[int]:
        """Return the ids of the false obstacles of a frame."""
        return self._false.get(place, set())

    def up_to(self, place: _Place | None) -> FrameCounts:
        """Return the counts up to and including the next frame, whose line is at ``place``."""
        sums = self._sums
        if place is not None:
            sums.false += len(self.false(place))
            for sample in self._samples.get(place, ()):
                sums.add(sample)
        return FrameCounts(
            false=sums.false,
            found=sums.found,
            missed=sums.missed,
            velocity_rmse_mps=sums.velocity_rmse_mps,
        )


@dataclass
class _Sums:
    false: int = 0
    found: int = 0
    missed: int = 0
    squares: float = 0.0

    def add(self, sample: Sample) -> None:
        self.found += sample.matched
        self.missed += not sample.matched
        self.squares += (sample.velocity_error_mps or 0.0) ** 2

    @property
    def velocity_rmse_mps(self) -> float | None:
        if not self.found:
            return None
        return round(math.sqrt(self.squares / self.found), _SPEED_DIGITS)


def _entry(
    frame: RecordedFrame,
    line: ObservationLine | None,
    camera: StereoCamera,
    bodies: list[FrameBody],
    scores: _Scores | None,
    plans: Plans,
    goal: GoalNow | None,
) -> FrameEntry:
    place = None if line is None else (line["segment"], line["frame"])
    false = set() if scores is None or place is None else scores.false(place)
    took = None if line is None else line["timings_ms"].get(_TOTAL)
    return FrameEntry(
        frame=frame.index,
        time=frame.time,
        status="lost" if line is None else line["status"],
        obstacles=[] if line is None else list(_obstacles(line, camera, false)),
        truth=bodies,
        counts=None if scores is None else scores.up_to(place),
        observed_ms=None if took is None else round(took, _MS_DIGITS),
        plan=plans.of(frame, line, goal),
        goal=goal,
    )


def _obstacles(
    line: ObservationLine, camera: StereoCamera, false: set[int]
) -> Iterator[FrameObstacle]:
    pose = line_pose(line)
    for entry in line["obstacles"]:
        std = entry["speed_std"]
        yield FrameObstacle(
            id=entry["id"],
            state=entry["state"],
            motion=entry["motion"],
            speed=round(entry["speed"], _SPEED_DIGITS),
            speed_std=None if std is None else round(std, _SPEED_DIGITS),
            box_px=[round(value, _PX_DIGITS) for value in entry["box_px"]],
            arrow_px=_arrow(entry, pose, camera),
            # Older recordings hold no silhouettes.
            silhouette=entry.get("silhouette"),
            false=entry["id"] in false,
        )


def _arrow(entry: ObstacleEntry, pose: Pose | None, camera: StereoCamera) -> list[float] | None:
    """Return the motion of the next second in the image; None if unknown or not visible."""
    if entry["motion"] != "moving" or entry["state"] == "coasting":
        return None
    if pose is None or entry["position"] is None or entry["velocity"] is None:
        return None
    begin = np.array(entry["position"])
    ends = pose.inverse().apply([begin, begin + np.array(entry["velocity"])])
    if not (ends[:, 2] > _NEAREST_M).all():
        return None
    px, _ = camera.project(ends)
    return [round(value, _PX_DIGITS) for value in px.ravel().tolist()]


def _bodies(truth: Truth | None, time: float) -> list[FrameBody]:
    """Return the true bodies that are visible; ``time`` is on the run's clock."""
    return [
        FrameBody(
            body.name,
            round(body.speed, _SPEED_DIGITS),
            [round(float(value), _PX_DIGITS) for value in body.box_px],
        )
        for body in (() if truth is None else truth.bodies(time))
        if body.role != "observer" and body.box_px is not None
    ]
