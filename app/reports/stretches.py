"""Part of a run's gathered data between two instants."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.reports.gathering import Curve, Gathered
from observer.evaluation.speed_errors import SeenMotion, TrueMotion


def during(gathered: Gathered, begin: float, end: float) -> Gathered:
    """Return the data between two instants of the run's clock."""
    span = gathered.span
    return replace(
        gathered,
        span=None if span is None else (max(begin, span[0]), min(end, span[1])),
        lines=tuple(line for line in gathered.lines if begin <= line["time"] <= end),
        matched=tuple(each for each in gathered.matched if begin <= each.time <= end),
        true=tuple(_true(each, begin, end) for each in gathered.true),
        seen=tuple(part for each in gathered.seen if (part := _seen(each, begin, end))),
        unmatched=tuple(part for each in gathered.unmatched if (part := _seen(each, begin, end))),
        commanded=tuple(_curve(each, begin, end) for each in gathered.commanded),
        encoder=tuple(_curve(each, begin, end) for each in gathered.encoder),
    )


def _true(motion: TrueMotion, begin: float, end: float) -> TrueMotion:
    some = np.flatnonzero((motion.times >= begin) & (motion.times <= end))
    return TrueMotion(
        motion.body,
        motion.times[some],
        motion.speeds[some],
        tuple(motion.directions[k] for k in some),
        tuple(motion.ways[k] for k in some),
        motion.in_sight[some],
    )


def _seen(motion: SeenMotion, begin: float, end: float) -> SeenMotion | None:
    some = (motion.frame_times >= begin) & (motion.frame_times <= end)
    if not some.any():
        return None
    arrays = (motion.frame_times, motion.times, motion.speeds, motion.stds)
    return SeenMotion(motion.track, motion.body, *(each[some] for each in arrays))


def _curve(curve: Curve, begin: float, end: float) -> Curve:
    some = (curve.times >= begin) & (curve.times <= end)
    return Curve(curve.label, curve.times[some], curve.speeds[some])
