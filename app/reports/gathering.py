"""Data of a run for its report, taken from the recording as plain arrays."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from app.contract.robots import DRIVEN_STATES
from app.reports.pairing import pair_with_truth
from observer.errors import DynamicObserverError
from observer.evaluation.speed_errors import AT_REST, SeenMotion, TrueMotion
from observer.geometry import Float64Array, Pose
from observer.jsonl import ObservationLine, line_pose
from observer.recording.payloads import MatchedBody, MatchedTruth, RobotRow
from observer.recording.reader import Recording
from observer.recording.run_times import RunTimes
from observer.rig.rig import OBSTACLE
from observer.truth.alignment.aligned import AlignedTruth
from observer.truth.alignment.alignment import align
from observer.truth.alignment.observed import ObservedRun
from observer.truth.alignment.result import Alignment
from observer.truth.contract import Truth
from observer.truth.counting import MOVING_MPS, VISIBLE_SHARE


@dataclass(frozen=True, eq=False)
class Curve:
    """Curve of a chart: times on the run's clock, seconds, and m/s; NaN breaks it."""

    label: str
    times: Float64Array
    speeds: Float64Array


@dataclass(frozen=True, eq=False)
class Gathered:
    """Data of a run, gathered for its report. All times are on the run's clock.

    Attributes:
        span: first and last time of the run; None without a frame.
        lines: the observations.
        matched: true bodies beside them, in their world; empty without truth.
        true: each obstacle's true motion.
        seen: each track, as long as it was assigned to one body.
        unmatched: tracks that were assigned to no body, with an empty body name.
        commanded, encoder: of the obstacle, empty where nothing is known.
        truth_words: the source of the truth, or the reason for its lack: one sentence.
        alignment: of motion capture with this run, None where there is none.
    """

    span: tuple[float, float] | None
    lines: tuple[ObservationLine, ...]
    matched: tuple[MatchedTruth, ...]
    true: tuple[TrueMotion, ...]
    seen: tuple[SeenMotion, ...]
    unmatched: tuple[SeenMotion, ...]
    commanded: tuple[Curve, ...]
    encoder: tuple[Curve, ...]
    truth_words: str
    alignment: Alignment | None


def gather(
    recording: Recording,
    alignment: Alignment | None = None,
    lines: Iterable[ObservationLine] | None = None,
) -> Gathered:
    """Read everything but images.

    Args:
        alignment: found earlier and kept with the run; None to compute it where it is needed.
        lines: of the same frames, observed differently than in the run; None for the run's own.
    """
    times = RunTimes(recording.frames)
    matched = times.matched(recording.matched_truth()) if lines is None else ()
    observed = tuple(recording.lines() if lines is None else lines)
    lines = times.lines(observed)
    words = "Ground truth was recorded with the run."
    if not matched:
        truth, alignment, words = _truth(recording, times, observed, alignment)
        matched = () if truth is None else pair_with_truth(lines, truth)
    true = _true_motions(lines, matched)
    seen, unmatched = seen_motions(lines, matched)
    rows = times.robots(recording.robot_rows())
    driven = [
        row
        for row in rows
        if row.role == OBSTACLE and row.facts.get("state", DRIVEN_STATES[0]) in DRIVEN_STATES
    ]
    commanded = _robot_curve(rows if driven else (), "sent_speed", "commanded")
    if not commanded:
        # Nobody drove it: the zeros sent to it meanwhile are not commands.
        commanded = _commanded_of_truth(matched)
    return Gathered(
        span=times.span,
        lines=lines,
        matched=matched,
        true=true,
        seen=seen,
        unmatched=unmatched,
        commanded=commanded,
        encoder=_robot_curve(rows, "encoder_speed", "wheel encoders"),
        truth_words=words,
        alignment=alignment,
    )


def _truth(
    recording: Recording,
    times: RunTimes,
    lines: Sequence[ObservationLine],
    alignment: Alignment | None,
) -> tuple[Truth | None, Alignment | None, str]:
    """Return the truth on the run's clock; ``lines`` and ``alignment`` are on the source's."""
    recorded = recording.truth()
    if recorded is not None:
        return recorded, None, "Ground truth was recorded with the run."
    capture = recording.capture()
    if capture is None:
        return None, None, "The recording contains no ground truth to compare with."
    if alignment is None:
        try:
            alignment = align(ObservedRun.of_lines(lines), capture)
        except DynamicObserverError as error:
            return None, None, f"Motion capture was recorded, but it is not aligned yet: {error}."
    words = "Ground truth: motion capture received live, aligned with the run."
    return times.truth([(0, AlignedTruth(capture, alignment))]), alignment, words


def seen_motions(
    lines: Iterable[ObservationLine], matched: Iterable[MatchedTruth]
) -> tuple[tuple[SeenMotion, ...], tuple[SeenMotion, ...]]:
    """Return the tracks assigned to a body, and those assigned to none; times are the run's."""
    # Numbers of frames and tracks repeat where an engine was replaced; the run's times do not.
    bodies = {
        (payload.frame, payload.time, body.track_id): body.name
        for payload in matched
        for body in payload.bodies
        if body.track_id is not None
    }
    rows: dict[tuple[str, str], list[tuple[float, ...]]] = defaultdict(list)
    for line in lines:
        for entry in line["obstacles"]:
            if entry["state"] != "confirmed":
                continue
            std = entry["speed_std"]
            body = bodies.get((line["frame"], line["time"], entry["id"]), "")
            rows[f"{line['segment']}:{entry['id']}", body].append(
                (line["time"], entry["velocity_time"], entry["speed"],
                 np.nan if std is None else std)
            )  # fmt: skip
    motions = [
        SeenMotion(track, body, *np.array(found, dtype=np.float64).T)
        for (track, body), found in rows.items()
    ]
    return tuple(m for m in motions if m.body), tuple(m for m in motions if not m.body)


def _true_motions(
    lines: Iterable[ObservationLine], matched: Iterable[MatchedTruth]
) -> tuple[TrueMotion, ...]:
    poses = {(line["frame"], line["time"]): line_pose(line) for line in lines}
    samples = [payload for payload in matched if (payload.frame, payload.time) in poses]
    names = {b.name: None for p in samples for b in p.bodies if b.role == OBSTACLE}
    motions = []
    for name in names:
        rows: list[tuple[float, float, str, str, bool]] = []
        for payload in samples:
            if rows and payload.time <= rows[-1][0]:
                continue
            body = next((b for b in payload.bodies if b.name == name), None)
            speed = np.nan if body is None else body.speed
            direction, way = _directions(body, poses[payload.frame, payload.time])
            in_sight = body is not None and (body.visible is None or body.visible >= VISIBLE_SHARE)
            rows.append((payload.time, speed, direction, way, in_sight))
        times, speeds, directions, ways, seen = zip(*rows, strict=True)
        motion = TrueMotion(
            name, np.array(times), np.array(speeds), directions, ways, np.array(seen)
        )
        motions.append(motion)
    return tuple(motions)


def _directions(body: MatchedBody | None, pose: Pose | None) -> tuple[str, str]:
    """Return the directions seen from the camera and by the body's front; empty where unknown."""
    if body is None:
        return "", ""
    if body.speed <= MOVING_MPS:
        return AT_REST, AT_REST
    velocity = np.array(body.velocity)
    front = np.array([np.sin(body.yaw), 0.0, np.cos(body.yaw)])
    way = "forward" if velocity @ front >= 0 else "backward"
    if pose is None:
        return "", way
    sight = np.array(body.position) - pose.translation
    sight /= max(float(np.linalg.norm(sight)), 1e-9)
    along = float(velocity @ sight)
    if abs(along) >= np.linalg.norm(velocity) / np.sqrt(2):
        return ("away" if along > 0 else "towards"), way
    return ("right" if velocity @ pose.rotation[:, 0] > 0 else "left"), way


def _robot_curve(rows: Sequence[RobotRow], field: str, label: str) -> tuple[Curve, ...]:
    """Return the speeds of the obstacle's robot, absolute, where the source's clock is known."""
    found = [
        (row.time, getattr(row, field))
        for row in rows
        if row.role == OBSTACLE and row.time is not None and getattr(row, field) is not None
    ]
    if not found:
        return ()
    times, speeds = np.array(found, dtype=np.float64).T
    # Older recordings may hold times that went back.
    later = times > np.maximum.accumulate(np.r_[-np.inf, times[:-1]])
    return (Curve(label, times[later], np.abs(speeds[later])),)


def _commanded_of_truth(matched: Iterable[MatchedTruth]) -> tuple[Curve, ...]:
    """Return a scenario's own commands, where no robot was driven; one curve per body."""
    rows: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for payload in matched:
        for body in payload.bodies:
            if body.role == OBSTACLE and body.commanded_speed is not None:
                rows[body.name].append((payload.time, abs(body.commanded_speed)))
    return tuple(Curve(f"{name}, commanded", *np.array(found).T) for name, found in rows.items())
