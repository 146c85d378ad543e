"""The method from top to bottom: what an observing robot does with each pair of images.

``Observer.observe`` compares the newest pair (t+dt, "current") with an earlier one (t,
"previous") in the steps of S. R. Sahoo and P. V. Manivannan, "A Hybrid Approach for Dynamic
Observer to Detect and Track Dynamic Obstacles".

Names a trace receives (absent where a frame did not come that far):

====================  =========================================================================
time                  t+dt, seconds on the source's clock
left, right           rectified images at t+dt, grey or BGR as the source delivers
previous_left, _right the same at t, grey
previous_time         t, seconds on the source's clock
features_px           (N, 2) feature points at t
matches               ``Matches`` between t and t+dt
ego_motion            ``EgoMotion``; its inliers are aligned with the matches
decomposition         dict: translation_px, rotation_rad, shear, scale of the affine matrix
disparity             (H, W) of the pair at t, pixels, NaN = unknown
warped_left, _right   the images of t+dt transformed into the frame of t
flow_px               (M, 2) features at t that could be followed
flow_observed_px      (M, 2) where they are in the transformed image
flow_residual_px      (M, 2) the difference
dynamic               (M,) which of them are dynamic
warped_disparity      (H, W) of the transformed pair, computed around the dynamic features only
motions               ``PointMotions`` of the K dynamic features with depth at both instants
points_previous       (K, 3) metres, dynamic points at t, camera frame of t
points_current        (K, 3) metres, the same points at t+dt, in the same frame
detections            the obstacles of this frame before they get an identity
====================  =========================================================================
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCalibration, StereoCamera, as_gray
from observer.geometry import Pose
from observer.parameters import Parameters
from observer.stages.clustering import detect_obstacles
from observer.stages.ego_motion import decompose_affine, estimate_ego_motion
from observer.stages.features import detect_features
from observer.stages.image_transformation import TransformedPair, transform_images
from observer.stages.matching import match_descriptors, track_features
from observer.stages.motion import measure_motion
from observer.stages.rectification import Rectification
from observer.stages.reporting import describe_obstacle
from observer.stages.residual_flow import residual_flow
from observer.stages.stereo import disparity_around, disparity_map, sample_disparity
from observer.stages.tracking import Tracker
from observer.types import (
    Detection,
    EgoMotion,
    Features,
    Image,
    Matches,
    NoTrace,
    Observation,
    Obstacle,
    PointMotions,
    ResidualFlow,
    Status,
    StereoFrame,
    Trace,
)

# As far back as ``frames.interval`` can reach.
_HISTORY = 10
_NO_TRACE = NoTrace()


@dataclass(frozen=True, eq=False)
class _View:
    """A rectified pair in grey, and from where it was taken."""

    time: float
    left: Image
    right: Image
    T_world_camera: Pose


class _StageTimer:
    """Milliseconds spent in each stage, by the injected clock; diagnostics only."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._begin = clock()
        self._ms: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        begin = self._clock()
        try:
            yield
        finally:
            self._ms[stage] = self._ms.get(stage, 0.0) + 1e3 * (self._clock() - begin)

    def finish(self) -> dict[str, float]:
        """All stages' times, and ``total`` since the timer was made."""
        return self._ms | {"total": 1e3 * (self._clock() - self._begin)}


class Observer:
    """Finds moving obstacles in a sequence of stereo frames.

    It holds no thread or file. Equal frames and parameters give equal results to the last digit;
    the clock serves ``timings_ms`` alone.

    **Loss.** A frame whose pose cannot be found (too few matches, no background with depth)
    reports no world quantities, and later frames are not compared with it but with the last good
    one. After ``ego_motion.recover_frames`` such frames, and when time runs backwards, all
    tracks end and the frame at hand is the first of a new segment, with a new world.

    Attributes:
        camera: the rectified pair.
        parameters: what is in force for the next frame.

    Raises:
        CalibrationError: the calibration cannot be rectified.
    """

    camera: StereoCamera
    parameters: Parameters

    def __init__(
        self,
        calibration: StereoCalibration,
        parameters: Parameters | None = None,
        *,
        parameters_revision: int = 0,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._rectification = Rectification(calibration)
        self.camera = self._rectification.camera
        self.parameters = Parameters() if parameters is None else parameters
        self._revision = parameters_revision
        self._clock = clock
        self._tracker = Tracker()
        self._history: deque[_View] = deque(maxlen=_HISTORY)
        self._newest: tuple[int, float] | None = None
        self._segment = 0
        self._frames_lost = 0

    def use(self, parameters: Parameters, revision: int) -> None:
        """Use these parameters from the next frame on; history and tracks stay."""
        self.parameters = parameters
        self._revision = revision

    def begin_segment(self) -> None:
        """Forget all frames and tracks; the next frame is the first of a new world."""
        self._history.clear()
        self._tracker.clear()
        self._newest = None
        self._frames_lost = 0
        self._segment += 1

    def observe(self, frame: StereoFrame, trace: Trace = _NO_TRACE) -> Observation:
        """Find what moves between an earlier frame and this one.

        Args:
            frame: the newest pair. Times must increase: a frame as old as the last one is
                answered with ``lost`` and left out, an older one begins a new segment.
            trace: receives every intermediate image and number (see the module's table).

        Raises:
            CalibrationError: the images are not of the calibration's size.
        """
        p, timer = self.parameters, _StageTimer(self._clock)
        with timer("rectification"):
            left, right = self._rectified(frame, trace)
        notes, previous = self._earlier(frame)
        if previous is None:
            return self._without_pair(frame, left, right, notes, timer)
        with timer("features"):
            features = detect_features(previous.left, p.features)
        with timer("matching"):
            matches = self._match(previous.left, left, features)
        with timer("stereo"):
            disparity = disparity_map(previous.left, previous.right, p.stereo)
            depth = sample_disparity(disparity, matches.previous)
        with timer("ego_motion"):
            ego = estimate_ego_motion(matches, depth, self.camera, p.ego_motion, frame.index)
        _keep_background(trace, previous, features, matches, disparity, ego)
        detections: tuple[Detection, ...] = ()
        if ego.homography is not None:
            with timer("image_transformation"):
                warped = transform_images(left, right, ego.homography)
            with timer("residual_flow"):
                flow = residual_flow(previous.left, warped.left, warped.valid, features.px, p.flow)
            with timer("stereo"):
                moved = flow.observed_px[flow.dynamic]
                warped_disparity = disparity_around(warped.left, warped.right, moved, p.stereo)
                before = sample_disparity(disparity, flow.px[flow.dynamic])
                after = sample_disparity(warped_disparity, moved)
            with timer("motion"):
                dt = frame.time - previous.time
                motions = measure_motion(flow, before, after, dt, ego, self.camera, p)
            with timer("clustering"):
                midpoint = previous.time + dt / 2
                detections = detect_obstacles(motions, midpoint, p.clustering, p.motion)
            _keep_motion(trace, warped, flow, warped_disparity, motions, detections)
        return self._report(frame, left, right, previous, ego, detections, notes, timer)

    def _rectified(self, frame: StereoFrame, trace: Trace) -> tuple[Image, Image]:
        left, right = self._rectification.apply(frame.left, frame.right)
        trace.keep("time", frame.time)
        trace.keep("left", left)
        trace.keep("right", right)
        return as_gray(left), as_gray(right)

    def _earlier(self, frame: StereoFrame) -> tuple[tuple[str, ...], _View | None]:
        """What to say of the order of the frames, and the view to compare this one with.

        There is no such view for the first frame of a segment and for a repeated one.
        """
        notes: tuple[str, ...] = ()
        if self._newest is not None:
            index, newest = self._newest
            if frame.time == newest:
                return (f"this frame is as old as the last one ({newest:g} s): left out",), None
            if frame.time < newest:
                self.begin_segment()
                notes = (f"time went back from {newest:g} to {frame.time:g} s",)
            elif frame.index > index + 1:
                missing = frame.index - index - 1
                notes = (f"{missing} frame{'s' if missing > 1 else ''} missing before this one",)
        if not self._history:
            return notes, None
        return notes, self._history[-min(self.parameters.frames.interval, len(self._history))]

    def _match(self, previous: Image, current: Image, features: Features) -> Matches:
        p = self.parameters
        if p.matching.method == "klt":
            return track_features(previous, current, features, p.matching, p.flow)
        found = detect_features(current, p.features)
        return match_descriptors(previous, current, features, found, p.matching)

    def _without_pair(
        self,
        frame: StereoFrame,
        left: Image,
        right: Image,
        notes: tuple[str, ...],
        timer: _StageTimer,
    ) -> Observation:
        """A repeated frame, or the first one of a segment."""
        if self._newest is not None and frame.time == self._newest[1]:
            return self._observation(frame, Status.LOST, notes, None, (), timer)
        here = Pose.identity()
        self._history.append(_View(frame.time, left, right, here))
        self._newest = (frame.index, frame.time)
        notes = (*notes, "first frame: there is none before it to compare with")
        return self._observation(frame, Status.DEGRADED, notes, here, (), timer)

    def _report(
        self,
        frame: StereoFrame,
        left: Image,
        right: Image,
        previous: _View,
        ego: EgoMotion,
        detections: tuple[Detection, ...],
        notes: tuple[str, ...],
        timer: _StageTimer,
    ) -> Observation:
        """Give detections an identity and a place in the world, and remember this frame."""
        notes = (*notes, *ego.reasons)
        T_world_camera = camera_velocity = None
        if ego.T_current_previous is not None:
            T_world_camera = previous.T_world_camera @ ego.T_current_previous.inverse()
            camera_velocity = -ego.T_current_previous.translation / (frame.time - previous.time)
            self._frames_lost = 0
            self._history.append(_View(frame.time, left, right, T_world_camera))
        elif self._frames_lost >= self.parameters.ego_motion.recover_frames:
            self.begin_segment()
            notes = (*notes, "the camera's motion stayed lost: a new segment begins")
            return self._without_pair(frame, left, right, notes, timer)
        else:
            self._frames_lost += 1
        self._newest = (frame.index, frame.time)
        with timer("tracking"):
            # Where the pose is unknown, identities go on from where the camera was last.
            T_track_camera = previous.T_world_camera if T_world_camera is None else T_world_camera
            tracks = self._tracker.update(
                detections, T_track_camera, frame.time, self.parameters.tracking
            )
            obstacles = tuple(
                describe_obstacle(
                    track, T_track_camera, T_world_camera, camera_velocity, frame.time
                )
                for track in tracks
            )
        return self._observation(frame, ego.status, notes, T_world_camera, obstacles, timer)

    def _observation(
        self,
        frame: StereoFrame,
        status: Status,
        reasons: tuple[str, ...],
        T_world_camera: Pose | None,
        obstacles: tuple[Obstacle, ...],
        timer: _StageTimer,
    ) -> Observation:
        return Observation(
            frame=frame.index,
            time=frame.time,
            received=frame.received,
            segment=self._segment,
            status=status,
            reasons=reasons,
            parameters_revision=self._revision,
            T_world_camera=T_world_camera,
            obstacles=obstacles,
            timings_ms=timer.finish(),
        )


def _keep_background(
    trace: Trace,
    previous: _View,
    features: Features,
    matches: Matches,
    disparity: NDArray[np.float32],
    ego: EgoMotion,
) -> None:
    trace.keep("previous_time", previous.time)
    trace.keep("previous_left", previous.left)
    trace.keep("previous_right", previous.right)
    trace.keep("features_px", features.px)
    trace.keep("matches", matches)
    trace.keep("disparity", disparity)
    trace.keep("ego_motion", ego)
    if ego.homography is not None:
        trace.keep("decomposition", asdict(decompose_affine(ego.homography)))


def _keep_motion(
    trace: Trace,
    warped: TransformedPair,
    flow: ResidualFlow,
    warped_disparity: NDArray[np.float32],
    motions: PointMotions,
    detections: tuple[Detection, ...],
) -> None:
    trace.keep("warped_left", warped.left)
    trace.keep("warped_right", warped.right)
    trace.keep("flow_px", flow.px)
    trace.keep("flow_observed_px", flow.observed_px)
    trace.keep("flow_residual_px", flow.residual_px)
    trace.keep("dynamic", flow.dynamic)
    trace.keep("warped_disparity", warped_disparity)
    trace.keep("motions", motions)
    trace.keep("points_previous", motions.points_previous)
    trace.keep("points_current", motions.points_current)
    trace.keep("detections", detections)
