"""A run in the form the alignment needs: plain arrays, from the JSON lines of ``observe``."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from observer.errors import TruthError
from observer.geometry import Float64Array, Pose
from observer.jsonl import line_pose
from observer.truth.alignment.curves import SpeedCurve, turn_rate, window_for
from observer.truth.speeds import JUMP_STEPS, smoothed_velocity

# Seconds: a velocity dated this much before its frame is from two frames, not from a filter.
_MIDPOINT_S = 1e-3
# m/s: smallest sigma that a speed may have, and its sigma where none is given.
_MIN_SIGMA_MPS, _UNKNOWN_SIGMA_MPS = 0.02, 0.05
# Seconds: motion stays smooth over frames dropped by a live source for at most this long.
_DROPPED_S = 0.3
# m/s and rad/s: sigmas of the camera's own speed and turn rate, smoothed.
_OWN_SPEED_SIGMA_MPS, _OWN_TURN_SIGMA = 0.005, 0.005


@dataclass(frozen=True, order=True)
class TrackKey:
    """A track's segment, and its number, which is unique within the segment."""

    segment: int
    id: int

    def __str__(self) -> str:
        return f"{self.segment}:{self.id}"

    @staticmethod
    def parse(text: str) -> TrackKey:
        """Parse a key as ``str`` writes it.

        Raises:
            TruthError: it is not two whole numbers with a colon between them.
        """
        segment, _, id_ = text.partition(":")
        try:
            return TrackKey(int(segment), int(id_))
        except ValueError:
            raise TruthError(
                f"a track is given as SEGMENT:NUMBER, for example 0:3, not {text[:40]!r}"
            ) from None


@dataclass(frozen=True, eq=False)
class ObservedTrack:
    """An obstacle's track.

    Attributes:
        key: the track's.
        times: (N,) seconds on the source's clock, of the frames in which it was measured.
        positions: (N, 3) metres, the segment's world.
        velocity_times: (N,) seconds. speeds: (N,) m/s, at these. speed_stds: (N,) NaN if unknown.
    """

    key: TrackKey
    times: Float64Array
    positions: Float64Array
    velocity_times: Float64Array
    speeds: Float64Array
    speed_stds: Float64Array

    def speed_curve(self) -> SpeedCurve | None:
        """Return its speed without filter lag; None if the track is too short.

        Speeds dated before their frame are displacements between two frames and are used as they
        are. Others come from a filter and lag behind at starts and stops, so they are recomputed
        from the positions with a symmetric window.
        """
        known = np.isfinite(self.speeds)
        if known.sum() < 5:
            return None
        stds = np.where(np.isfinite(self.speed_stds), self.speed_stds, _UNKNOWN_SIGMA_MPS)
        sigmas = np.maximum(stds, _MIN_SIGMA_MPS)
        if np.median(self.times - self.velocity_times) > _MIDPOINT_S:
            times, values = self.velocity_times[known], self.speeds[known]
            # One time that goes back must not hide those between it and the latest one before.
            rising = times > np.maximum.accumulate(np.r_[-np.inf, times[:-1]])
            return SpeedCurve(times[rising], values[rising], sigmas[known][rising])
        speed = _speeds(self.times, self.positions)
        if np.isfinite(speed).sum() < 5:
            return None
        return SpeedCurve(self.times, speed, sigmas)


@dataclass(frozen=True, eq=False)
class ObservedRun:
    """A run as arrays.

    Attributes:
        times: (N,) seconds on the source's clock, one for each frame.
        segments: (N,) number of each frame's segment.
        poses: N ``T_world_camera``, None where unknown.
        tracks: by key, in the order in which they appeared.
    """

    times: Float64Array
    segments: Float64Array
    poses: tuple[Pose | None, ...]
    tracks: Mapping[TrackKey, ObservedTrack]

    @staticmethod
    def of_lines(lines: Iterable[Mapping[str, Any]]) -> ObservedRun:
        """Build a run from lines as ``observer.jsonl.observation_line`` makes them.

        Coasting and tentative obstacles are left out: they were not measured.

        Raises:
            TruthError: a line lacks a field or holds a bad one, or the clock restarted; the
                sentence names it.
        """
        times: list[float] = []
        segments: list[float] = []
        poses: list[Pose | None] = []
        rows: dict[TrackKey, list[tuple[float, ...]]] = defaultdict(list)
        for number, line in enumerate(lines, 1):
            try:
                time, segment = float(line["time"]), int(line["segment"])
                if not math.isfinite(time):
                    raise ValueError("time")
                counted = float(segment)
                placed = line_pose(line)
                for entry in line["obstacles"]:
                    if entry["state"] == "confirmed":
                        rows[TrackKey(segment, int(entry["id"]))].append(_row(time, entry))
            except (KeyError, TypeError, ValueError, OverflowError) as error:
                raise TruthError(
                    f"line {number} of the observations was not written by observe: "
                    f"{type(error).__name__} at {str(error)[:60]}"
                ) from None
            if times and time < times[-1] and counted != segments[-1]:
                raise TruthError(
                    f"the source's clock restarted during the run, after {times[-1]:g} s (line "
                    f"{number} of the observations), as it does when the source is reopened; only "
                    "a run on one clock can be aligned, so record it again without interruption"
                )
            times.append(time)
            segments.append(counted)
            poses.append(placed)
        return ObservedRun(
            np.array(times),
            np.array(segments),
            tuple(poses),
            {key: _track(key, np.array(found)) for key, found in rows.items()},
        )

    def camera_path(self, segment: int) -> tuple[Float64Array, Float64Array]:
        """Return times (M,) and ``T_world_camera`` (M, 4, 4) of a segment's frames with a pose."""
        found = [
            (time, pose.matrix)
            for time, number, pose in zip(self.times, self.segments, self.poses, strict=True)
            if pose is not None and number == segment
        ]
        times, poses = [time for time, _ in found], [pose for _, pose in found]
        return np.array(times), np.array(poses).reshape(-1, 4, 4)

    def segment_numbers(self) -> tuple[int, ...]:
        """Return the segments' numbers in order, each once."""
        return tuple(int(k) for k in dict.fromkeys(self.segments.tolist()))

    def segment_starts(self) -> tuple[tuple[int, float], ...]:
        """Return each segment's number and the time of its first frame."""
        return tuple(
            (number, float(self.times[self.segments == number][0]))
            for number in self.segment_numbers()
        )

    def own_curves(self) -> tuple[SpeedCurve | None, SpeedCurve | None]:
        """Return the camera's own speed and turn rate; None where too few poses are known."""
        times, speed, rate = [], [], []
        for segment in self.segment_numbers():
            t, T = self.camera_path(segment)
            t, once = np.unique(t, return_index=True)
            if len(t) < 7:
                continue
            T = T[once]
            turning = turn_rate(t, T[:, :3, :3], _OWN_TURN_SIGMA, _longest_step(t))
            if turning is None:
                continue
            times.append(t)
            speed.append(_speeds(t, T[:, :3, 3]))
            rate.append(turning.values)
        if not times:
            return None, None
        t = np.concatenate(times)
        return (
            SpeedCurve.of(t, np.concatenate(speed), _OWN_SPEED_SIGMA_MPS),
            SpeedCurve.of(t, np.concatenate(rate), _OWN_TURN_SIGMA),
        )


def _longest_step(times: Float64Array) -> float:
    """Return the longest step that is no gap, in median steps."""
    return max(JUMP_STEPS, _DROPPED_S / float(np.median(np.diff(times))))


def _speeds(times: Float64Array, positions: Float64Array) -> Float64Array:
    velocity = smoothed_velocity(
        times, positions, window=window_for(times), longest_step=_longest_step(times)
    )
    return np.asarray(np.linalg.norm(velocity, axis=1))


def _row(time: float, entry: Mapping[str, Any]) -> tuple[float, ...]:
    position = (math.nan,) * 3 if entry["position"] is None else entry["position"]
    std = entry.get("speed_std")
    x, y, z = (float(value) for value in position)
    velocity_time, speed = float(entry["velocity_time"]), float(entry["speed"])
    return time, x, y, z, velocity_time, speed, math.nan if std is None else float(std)


def _track(key: TrackKey, rows: Float64Array) -> ObservedTrack:
    _, once = np.unique(rows[:, 0], return_index=True)
    rows = rows[once]
    return ObservedTrack(key, rows[:, 0], rows[:, 1:4], rows[:, 4], rows[:, 5], rows[:, 6])
