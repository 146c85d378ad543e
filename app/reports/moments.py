"""Frames shown as pictures in a report, re-run with the full trace.

The rule: the frame with the most significant confirmed, moving obstacle; among equals the first.
For the picture of false points, the candidates are some frames spread over all those in which
something moving was seen; the one chosen is that in which the published method marks the most
points as moving that lie on no moving body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.reports.gathering import Gathered
from observer.camera import StereoCamera
from observer.geometry import BOX_CORNERS, Float64Array
from observer.jsonl import ObservationLine, ObstacleEntry, line_pose
from observer.observer import Observer
from observer.parameters import Parameters, preset
from observer.parameters.fields import PLANAR
from observer.recording.payloads import MatchedTruth
from observer.recording.replay import replay_revisions
from observer.recording.run_times import RunTimes
from observer.recording.source import RecordingSource
from observer.trace import FullTrace, NoTrace, TraceValues
from observer.truth.counting import MOVING_MPS
from observer.types import StereoFrame

# Long enough for tracks to be confirmed again.
_WARM_UP_FRAMES = 30
CANDIDATES = 8
# Pixels this close to a body's outline belong to it: a feature's window extends this far, to its
# corner.
_MARGIN_PX = 12.0
_MONOCULAR = "monocular"


@dataclass(frozen=True, eq=False)
class Moment:
    """Frame observed by one method.

    Attributes:
        position: of the frame in the recording, from 0.
        line: its observation in the run.
        trace: intermediate results of this method (see ``observer.observer``).
        model: the method.
        parameters: those it was observed with.
        camera: the rectified pair.
        bodies: (4,) pixel boxes of the true moving bodies, or, without truth, of those the run
            reported as moving.
        by_truth: the boxes are from truth.
    """

    position: int
    line: ObservationLine
    trace: TraceValues
    parameters: Parameters
    camera: StereoCamera
    bodies: tuple[Float64Array, ...]
    by_truth: bool

    @property
    def model(self) -> str:
        """Return the name of the method."""
        return str(self.parameters.ego_motion.model)

    @property
    def is_planar(self) -> bool:
        """Return true where images are transformed, as the paper does."""
        return self.model in PLANAR

    @property
    def is_monocular(self) -> bool:
        """Return true where the right camera's images were not observed."""
        return self.model == _MONOCULAR

    @property
    def has_flow(self) -> bool:
        """Return true where features of two frames were compared without the camera's motion."""
        return "flow_px" in self.trace

    @property
    def false_px(self) -> NDArray[np.float32]:
        """Return (N, 2) points marked as moving that lie on nothing that moves."""
        start, dynamic = self.trace.get("flow_px"), self.trace.get("dynamic")
        if start is None or dynamic is None:
            return np.zeros((0, 2), np.float32)
        px: NDArray[np.float32] = np.asarray(start, np.float32)[np.asarray(dynamic)]
        on_body = np.zeros(len(px), np.bool_)
        for u0, v0, u1, v1 in self.bodies:
            on_body |= (
                (px[:, 0] >= u0 - _MARGIN_PX) & (px[:, 0] <= u1 + _MARGIN_PX)
                & (px[:, 1] >= v0 - _MARGIN_PX) & (px[:, 1] <= v1 + _MARGIN_PX)
            )  # fmt: skip
        return px[~on_body]


def moving_px(moment: Moment) -> Float64Array:
    """Return (N, 2) pixels at t+dt of the feature points that move."""
    trace = moment.trace
    if "evidence" in trace:
        px, dynamic = trace["evidence"].px, trace["evidence"].dynamic
    elif "ray_evidence" in trace:
        px, dynamic = trace["rays"].px, trace["ray_evidence"].moving
    elif "flow_px" in trace:
        # Positions in the transformed image, mapped back to the image itself.
        px, dynamic = trace["ego_motion"].predict(trace["flow_observed_px"], None), trace["dynamic"]
    else:
        return np.zeros((0, 2))
    found: Float64Array = np.asarray(px, np.float64)[np.asarray(dynamic)]
    return found


def is_moving(entry: ObstacleEntry) -> bool:
    """Return true if an obstacle of a line was measured and moves."""
    return entry["state"] == "confirmed" and entry["motion"] == "moving"


def most_significant(line: ObservationLine) -> ObstacleEntry | None:
    """Return the obstacle of a line that moves with the highest significance."""
    moving = [entry for entry in line["obstacles"] if is_moving(entry)]
    return max(moving, key=lambda entry: entry["significance"], default=None)


class Moments:
    """Observer of single frames of a recording; nobody else may use the source meanwhile."""

    def __init__(self, source: RecordingSource, gathered: Gathered) -> None:
        self._source = source
        # Numbers of frames repeat where an engine was replaced; the run's times do not.
        self._frames = RunTimes(source.recording.frames).frames
        self._lines = {(line["frame"], line["time"]): line for line in gathered.lines}
        # Frames with something moving, and the significance of its motion.
        self._moving: list[tuple[int, float]] = []
        for position, frame in enumerate(self._frames):
            line = self._lines.get(frame)
            best = None if line is None or position == 0 else most_significant(line)
            if best is not None:
                self._moving.append((position, best["significance"]))
        self._truth = {(payload.frame, payload.time): payload for payload in gathered.matched}
        self._revisions = replay_revisions(source.recording)

    def most_significant(self) -> int | None:
        """Return the position in the recording; None where nothing moving was seen."""
        if not self._moving:
            return None
        return max(self._moving, key=lambda found: found[1])[0]

    def own(self, position: int) -> Moment | None:
        """Return the frame as the run observed it, re-run from a little before."""
        newest = max(at for at in self._revisions if at <= position)
        return self._observed(position, self._revisions[newest][0], _WARM_UP_FRAMES)

    def published(self, position: int) -> Moment | None:
        """Return the frame by the published method, from it and the one before."""
        return self._observed(position, preset("paper"), 1)

    def most_false(self) -> Moment | None:
        """Return the frame for the picture of false points, by the published method."""
        if not self._moving:
            return None
        last = len(self._moving) - 1
        chosen = np.unique(np.linspace(0, last, CANDIDATES).round().astype(int))
        found = [m for k in chosen if (m := self.published(self._moving[k][0])) is not None]
        return max(found, key=lambda m: len(m.false_px)) if found else None

    def _observed(self, position: int, parameters: Parameters, before: int) -> Moment | None:
        mount = self._source.recording.facts.camera_mount()
        observer = Observer(self._source.calibration, parameters, mount=mount)
        begin = max(position - before, 0)
        self._source.seek(begin)
        trace = FullTrace()
        for at in range(begin, position + 1):
            frame = self._source.read()
            if not isinstance(frame, StereoFrame):
                if at == position:
                    return None
                continue
            if self._source.begins is not None:
                observer.begin_segment()
            observer.observe(frame, trace if at == position else NoTrace())
        line = self._lines.get(self._frames[position])
        if line is None or "previous_left" not in trace:
            return None
        boxes, by_truth = self._moving_boxes(line, observer.camera)
        return Moment(position, line, trace, parameters, observer.camera, boxes, by_truth)

    def _moving_boxes(
        self, line: ObservationLine, camera: StereoCamera
    ) -> tuple[tuple[Float64Array, ...], bool]:
        payload = self._truth.get((line["frame"], line["time"]))
        if payload is not None and line["pose"] is not None:
            return _true_boxes(payload, line, camera), True
        reported = (o for o in line["obstacles"] if o["motion"] == "moving")
        return tuple(np.array(o["box_px"]) for o in reported), False


def _true_boxes(
    payload: MatchedTruth, line: ObservationLine, camera: StereoCamera
) -> tuple[Float64Array, ...]:
    T_world_camera = line_pose(line)
    assert T_world_camera is not None
    T_camera_world = T_world_camera.inverse()
    boxes = []
    for body in payload.bodies:
        if body.role == "observer" or body.speed <= MOVING_MPS:
            continue
        sin, cos = np.sin(body.yaw), np.cos(body.yaw)
        # Directions of length, width and height.
        axes = np.array([[sin, 0.0, cos], [cos, 0.0, -sin], [0.0, 1.0, 0.0]])
        corners = np.array(body.position) + (BOX_CORNERS * np.array(body.size) / 2) @ axes
        px, _ = camera.project(T_camera_world.apply(corners))
        if np.isfinite(px).all():
            boxes.append(np.concatenate([px.min(axis=0), px.max(axis=0)]))
    return tuple(boxes)
