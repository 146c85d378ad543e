"""Ground truth at any instant, interpolated between samples at frames."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np
import scipy

from observer.geometry import Pose
from observer.truth.contract import TrueBody
from observer.truth.motion_capture import SAME_INSTANT_S

# Samples further apart than this bound a gap, in which nothing is known.
_MAX_GAP_FRAMES = 3.0
# This close to a sample its value is used even at the edge of a gap.
_HOLD_FRAMES = 0.5
_Sample = TypeVar("_Sample")


@dataclass(frozen=True, eq=False)
class TruthSample:
    """Ground truth at one frame.

    Attributes:
        frame: the frame's number in its source. time: seconds on the source's clock.
        bodies: every body seen at that instant.
        camera_pose: ``T_world_camera``, None where unknown.
    """

    frame: int
    time: float
    bodies: tuple[TrueBody, ...]
    camera_pose: Pose | None = None


class SampledTruth:
    """Ground truth at any instant, from samples.

    Between consecutive frames values are interpolated linearly (a pose's rotation along the
    shortest arc). There is a gap where a body is absent from a frame or frames are more than three
    median intervals apart: in it, values are known only within half a frame of a sample.

    Attributes:
        samples: one for each frame, by ascending time.
    """

    def __init__(self, samples: tuple[TruthSample, ...]) -> None:
        self.samples = samples
        times = [sample.time for sample in samples]
        steps = np.diff(times)
        steps = steps[steps > SAME_INSTANT_S]
        interval = float(np.median(steps)) if len(steps) else 0.0
        cameras: dict[int, Pose] = {}
        bodies: dict[int, dict[int, TrueBody]] = {}
        for index, sample in enumerate(samples):
            if sample.camera_pose is not None:
                cameras[index] = sample.camera_pose
            for body in sample.bodies:
                bodies.setdefault(body.id, {})[index] = body
        self._camera = _Series(times, interval, cameras)
        self._series = [_Series(times, interval, bodies[id_]) for id_ in sorted(bodies)]

    def bodies(self, time: float) -> tuple[TrueBody, ...]:
        """Return every body known at ``time``, sorted by id; bodies in a gap are left out."""
        found = []
        for series in self._series:
            between = series.at(time)
            if between is not None:
                found.append(_body_between(*between))
        return tuple(found)

    def camera_pose(self, time: float) -> Pose | None:
        """Return ``T_world_camera``, or None where unknown."""
        between = self._camera.at(time)
        return None if between is None else _pose_between(*between)


class _Series(Generic[_Sample]):
    """Samples of a body or pose by ascending time.

    Args:
        times: of all frames. interval: their median one.
        values: by index of the frame, for those in which it was seen.
    """

    def __init__(
        self, times: Sequence[float], interval: float, values: Mapping[int, _Sample]
    ) -> None:
        self._times = times
        self._interval = interval
        self._values = values

    def at(self, time: float) -> tuple[_Sample, _Sample, float] | None:
        """Return the samples before and after ``time`` and the later one's weight, or None."""
        later = bisect_left(self._times, time)
        if later < len(self._times) and self._times[later] == time:
            return self._held(later)
        if 0 < later < len(self._times):
            before, after = self._values.get(later - 1), self._values.get(later)
            start, end = self._times[later - 1], self._times[later]
            close = end - start <= _MAX_GAP_FRAMES * self._interval
            if before is not None and after is not None and close:
                return before, after, (time - start) / (end - start)
        near = [k for k in (later - 1, later) if 0 <= k < len(self._times)]
        nearest = min(near, key=lambda k: abs(self._times[k] - time))
        if abs(self._times[nearest] - time) > _HOLD_FRAMES * self._interval:
            return None
        return self._held(nearest)

    def _held(self, index: int) -> tuple[_Sample, _Sample, float] | None:
        value = self._values.get(index)
        return None if value is None else (value, value, 0.0)


def _body_between(a: TrueBody, b: TrueBody, weight: float) -> TrueBody:
    if weight == 0:
        return a
    turn = math.remainder(b.yaw - a.yaw, 2 * math.pi)
    visible = None
    if a.visible is not None and b.visible is not None:
        visible = a.visible + weight * (b.visible - a.visible)
    box = None
    if a.box_px is not None and b.box_px is not None:
        u0, v0, u1, v1 = (p + weight * (q - p) for p, q in zip(a.box_px, b.box_px, strict=True))
        box = (u0, v0, u1, v1)
    # A command holds until the next one.
    return replace(
        a,
        position=a.position + weight * (b.position - a.position),
        velocity=a.velocity + weight * (b.velocity - a.velocity),
        yaw=a.yaw + weight * turn,
        visible=visible,
        box_px=box,
    )


def _pose_between(a: Pose, b: Pose, weight: float) -> Pose:
    if weight == 0:
        return a
    turn = scipy.spatial.transform.Rotation.from_matrix(a.rotation.T @ b.rotation).as_rotvec()
    return Pose(
        a.rotation @ scipy.spatial.transform.Rotation.from_rotvec(weight * turn).as_matrix(),
        a.translation + weight * (b.translation - a.translation),
    )
