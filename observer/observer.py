"""The observer: the whole processing of each pair of images, from rectification to result.

Moving obstacles are found by one of three methods: ``observer.methods.planar`` is the paper's,
``observer.methods.rigid`` uses 3D motion from stereo, ``observer.methods.monocular`` 3D motion from
the left camera alone; the parameter ``ego_motion.model`` chooses.

Names a trace receives (absent if processing did not get that far, or the method has none):

====================  =========================================================================
time                  t+dt, seconds on the source's clock
left, right           rectified images at t+dt, grey or BGR as the source delivers
previous_left, _right the same at t, grey
previous_time         t, seconds on the source's clock
features_px           (N, 2) feature points at t
matches               ``Matches`` between t and t+dt
ego_motion            ``EgoMotion``; its inliers are aligned with the matches
flow_px               (M, 2) features at t that could be tracked
flow_observed_px      (M, 2) where they are once the camera's own motion is removed
flow_residual_px      (M, 2) the difference
dynamic               (M,) which of them are dynamic
--------------------  planar only
decomposition         dict: translation_px, rotation_rad, shear, scale of the affine matrix
disparity             (H, W) of the pair at t, pixels, NaN = unknown
warped_left, _right   the images of t+dt transformed into the frame of t
warped_disparity      (H, W) of the transformed pair, computed around the dynamic features only
motions               ``PointMotions``: the dynamic features whose depth is known at both instants
points_previous       (K, 3) metres, dynamic points at t, camera frame of t
points_current        (K, 3) metres, the same points at t+dt, in the same frame
detections            the obstacles of this frame before they are assigned to tracks
--------------------  rigid only
evidence              ``PointEvidence``: how every tracked point moves, and how certain that is
unseen                ``Unseen``: where motion would go unnoticed
rows                  ``StereoRows``: where the points are in the right image; the inliers of
                      ``ego_motion`` are aligned with them
disparity_bias        ``DisparityBias``: estimated correction of all disparities
exposure_skew         ``ExposureSkew``: how much later the right camera exposes, if not given
--------------------  one camera only
rays                  ``RayPoints``: all tracked points, their lines of sight and depths
ray_evidence          ``RayEvidence``: which of them cannot be static
====================  =========================================================================
"""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

from observer.camera import StereoCalibration, StereoCamera, as_gray
from observer.geometry import Pose
from observer.kernels.building import make_ready
from observer.methods.contract import Method
from observer.methods.monocular.method import MonocularMethod
from observer.methods.planar.method import PlanarMethod
from observer.methods.rigid.method import RigidMethod
from observer.methods.rigid.stereo_drift import StereoDrift
from observer.mount import CameraMount
from observer.number_format import count_of
from observer.parameters import Parameters
from observer.trace import NoTrace, Trace
from observer.types import Observation, Obstacle, Status, StereoFrame, Unseen
from observer.vision.image_health import ImageHealth
from observer.vision.lifecycle import TrackIds
from observer.vision.rectification import Rectification
from observer.vision.view import View

_log = logging.getLogger(__name__)

_NO_TRACE = NoTrace()


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
        """Return all stages' times, and ``total`` since the timer was created."""
        return self._ms | {"total": 1e3 * (self._clock() - self._begin)}


class Observer:
    """Finds moving obstacles in a sequence of stereo frames.

    It owns no thread or file. The first one in a process loads the compiled kernels; if they are
    not compiled for this processor yet, it waits until they are, and logs that.

    Equal frames and parameters give bit-identical results; the clock is used for ``timings_ms``
    only.

    **Loss.** A frame whose pose cannot be estimated (too few matches, no background with depth, an
    impossible jump) reports no world quantities, and later frames are not compared with it but
    with the last good one. After ``ego_motion.recover_frames`` such frames, or when time runs
    backwards or another method is chosen, all tracks end and the current frame is the first of a
    new segment, with a new world frame.

    Attributes:
        camera: the rectified pair.
        parameters: in use for the next frame.

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
        mount: CameraMount | None = None,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        # Now, so that no frame has to wait for the compiler.
        make_ready(_log.warning)
        self._rectification = Rectification(calibration)
        self.camera = self._rectification.camera
        self.parameters = Parameters() if parameters is None else parameters
        self._revision = parameters_revision
        self._mount = mount
        self._clock = clock
        self._method: Method | None = None
        # Obstacle ids are not reused in a later segment.
        self._numbers = TrackIds()
        # Calibration errors of the pair persist across segments too.
        self._drift = StereoDrift(self.camera)
        self._health = ImageHealth(self.camera)
        self._newest: tuple[int, float] | None = None
        self._segment = 0
        self._frames_lost = 0

    def use(self, parameters: Parameters, revision: int) -> None:
        """Use these parameters from the next frame on; history and tracks stay.

        A change between the planar, rigid and monocular methods carries nothing over: the next
        frame then begins a new segment.
        """
        if _method_name(parameters) != _method_name(self.parameters):
            self.begin_segment()
        self.parameters = parameters
        self._revision = revision

    def begin_segment(self) -> None:
        """Forget all frames and tracks; the next frame begins a new segment."""
        if self._method is not None:
            self._segment += 1
        self._method = None
        self._newest = None
        self._frames_lost = 0

    def observe(self, frame: StereoFrame, trace: Trace = _NO_TRACE) -> Observation:
        """Find what moves between an earlier frame and this one.

        Args:
            frame: the newest pair. Times must increase: a frame with the same time as the last one
                is skipped and reported as ``lost``, an older one begins a new segment.
            trace: receives every intermediate image and number (see the module's table).

        Raises:
            CalibrationError: the images are not of the calibration's size.
        """
        p, timer = self.parameters, _StageTimer(self._clock)
        with timer("rectification"):
            view = self._rectified(frame, trace)
        if self._newest is not None and frame.time == self._newest[1]:
            note = (
                f"this frame has the same time as the last one ({frame.time:g} s) and was skipped"
            )
            return self._observation(frame, Status.LOST, (note,), None, (), timer)
        notes = self._noted_order(frame)
        if self._method is None:
            return self._first(frame, view, notes, timer)
        step = self._method.step(view, p, timer, trace)
        if step.T_world_camera is not None:
            self._frames_lost = 0
        elif step.waiting:
            # Not lost: the method has not seen enough yet to determine the pose.
            pass
        elif self._frames_lost >= p.ego_motion.recover_frames:
            self.begin_segment()
            notes = (
                *notes,
                *step.ego.reasons,
                "the ego-motion could not be recovered: a new segment starts",
            )
            return self._first(frame, view, notes, timer)
        else:
            self._frames_lost += 1
        with timer("health"):
            ills = self._health.look(view, p.stereo, step.stereo_share, step.rows)
        blind = () if step.unseen is None else step.unseen.reasons
        degraded = step.ego.status is Status.OK and (ills or blind)
        status = Status.DEGRADED if degraded else step.ego.status
        reasons = (*notes, *step.notes, *ills, *step.ego.reasons, *blind)
        pose = step.T_world_camera
        return self._observation(frame, status, reasons, pose, step.obstacles, timer, step.unseen)

    def _rectified(self, frame: StereoFrame, trace: Trace) -> View:
        left, right = self._rectification.apply(frame.left, frame.right)
        trace.keep("time", frame.time)
        trace.keep("left", left)
        trace.keep("right", right)
        gray = as_gray(left)
        if _method_name(self.parameters) == "monocular":
            # The right image must not influence the result.
            return View.of(frame, gray, gray)
        return View.of(frame, gray, as_gray(right))

    def _noted_order(self, frame: StereoFrame) -> tuple[str, ...]:
        """Describe the order of the frames; time that runs backwards begins a segment."""
        before, self._newest = self._newest, (frame.index, frame.time)
        if before is None:
            return ()
        index, newest = before
        if frame.time < newest:
            self.begin_segment()
            self._newest = (frame.index, frame.time)
            return (f"time jumped back from {newest:g} to {frame.time:g} s",)
        if frame.index > index + 1:
            missing = frame.index - index - 1
            return (f"{count_of(missing, 'frame')} missing before this one",)
        return ()

    def _first(
        self, frame: StereoFrame, view: View, notes: tuple[str, ...], timer: _StageTimer
    ) -> Observation:
        """Process the first frame of a segment, whose camera pose is the world's origin."""
        self._method = self._new_method(view)
        self._newest = (frame.index, frame.time)
        ills = self._health.look(view, self.parameters.stereo)
        notes = (*notes, *ills, "first frame: there is no earlier one to compare with")
        return self._observation(frame, Status.DEGRADED, notes, Pose.identity(), (), timer)

    def _new_method(self, view: View) -> Method:
        match _method_name(self.parameters):
            case "rigid":
                return RigidMethod(
                    self.camera, view, self.parameters, self._numbers, self._mount, self._drift
                )
            case "monocular":
                return MonocularMethod(
                    self.camera, view, self.parameters, self._numbers, self._mount
                )
            case _:
                return PlanarMethod(self.camera, view, self._numbers)

    def _observation(
        self,
        frame: StereoFrame,
        status: Status,
        reasons: tuple[str, ...],
        T_world_camera: Pose | None,
        obstacles: tuple[Obstacle, ...],
        timer: _StageTimer,
        unseen: Unseen | None = None,
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
            unseen=unseen,
        )


def _method_name(parameters: Parameters) -> Literal["planar", "rigid", "monocular"]:
    model = parameters.ego_motion.model
    return "planar" if model == "affine" or model == "homography" else model
