"""Errors of speed against ground truth, compared as in figure 17 of the paper.

The definitions:

* A **sample** is one speed reported by a track, at the instant to which it refers (the middle of
  its displacement, or its frame), with the true speed of its body at that instant. Coasting tracks
  give no samples.
* True speeds are **interpolated** linearly between consecutive ground-truth samples without a gap,
  and unknown elsewhere.
* A sample has the **direction** of its body's true motion at that instant: towards the camera or
  away from it if most of the velocity lies along the line of sight, else to the left or right; and
  its **way**: forward or backward relative to the body's front, as programmes count it.
* **Coverage** is the share of errors within the stated 95 % interval, of the samples that have
  one.
* The **share seen** is the share of the ground-truth instants with the body moving in sight at
  which a track was measured on it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.intervals import SIGMAS_95
from observer.truth.counting import MOVING_MPS

AT_REST = "at rest"
DIRECTIONS = ("towards", "away", "left", "right")
WAYS = ("forward", "backward")
# Ground-truth samples farther apart than this many median intervals have a gap between them.
_GAP_FRAMES = 3.0


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """Motion of a body through a run.

    Attributes:
        body: its name.
        times: (N,) seconds on the source's clock, increasing.
        speeds: (N,) m/s, NaN where unknown.
        directions, ways: N words each, of ``DIRECTIONS`` and ``WAYS``, or ``AT_REST``.
        in_sight: (N,) True where the camera could see at least half of it.
    """

    body: str
    times: Float64Array
    speeds: Float64Array
    directions: tuple[str, ...]
    ways: tuple[str, ...]
    in_sight: NDArray[np.bool_]

    def speeds_at(self, times: Float64Array) -> Float64Array:
        """Interpolate speeds (M,) m/s; NaN in gaps and outside the samples."""
        if len(self.times) == 0:
            return np.full(len(times), np.nan)
        later = np.clip(np.searchsorted(self.times, times), 1, max(len(self.times) - 1, 1))
        if len(self.times) == 1:
            return np.where(times == self.times[0], self.speeds[0], np.nan)
        start, end = self.times[later - 1], self.times[later]
        weight = (times - start) / (end - start)
        # A sample itself counts even where its neighbour is missing.
        before = np.where(weight == 1.0, 0.0, (1.0 - weight) * self.speeds[later - 1])
        after = np.where(weight == 0.0, 0.0, weight * self.speeds[later])
        exact = (weight == 0.0) | (weight == 1.0)
        usual = float(np.median(np.diff(self.times)))
        known = (weight >= 0) & (weight <= 1) & (exact | (end - start <= _GAP_FRAMES * usual))
        return np.where(known, before + after, np.nan)

    def nearest(self, times: Float64Array) -> NDArray[np.intp]:
        """Return the indices (M,) of the nearest ground-truth samples; there must be one."""
        later = np.clip(np.searchsorted(self.times, times), 0, len(self.times) - 1)
        before = np.maximum(later - 1, 0)
        closer = np.abs(self.times[before] - times) < np.abs(self.times[later] - times)
        return np.where(closer, before, later)


@dataclass(frozen=True, eq=False)
class SeenMotion:
    """Motion of a track while it was matched to one body.

    Attributes:
        track: segment and number, e.g. ``0:3``. body: its name.
        frame_times: (N,) of the frames in which it was measured.
        times: (N,) the instants to which the speeds refer.
        speeds, stds: (N,) m/s; unknown standard deviations are NaN.
    """

    track: str
    body: str
    frame_times: Float64Array
    times: Float64Array
    speeds: Float64Array
    stds: Float64Array


class IdentitySwitch(NamedTuple):
    """Instant at which a body continues under another track.

    Attributes:
        time: of the first frame with the other track. body: its name.
        before, after: the tracks.
    """

    time: float
    body: str
    before: str
    after: str


@dataclass(frozen=True)
class SpeedErrors:
    """Figures of a group of samples; None without data.

    Attributes:
        group: ``all``, ``body``, ``track``, ``direction`` or ``way``. label: its name.
        body: its name, None for several together.
        samples: count. bias_mps: mean error, seen minus true. rmse_mps, maximum_mps: of the errors.
        coverage: share of the ``covered_of`` samples with a standard deviation that lie within
            their 95 % interval.
        seen_share: see the module; None if the group has no instants.
    """

    group: str
    label: str
    body: str | None
    samples: int
    bias_mps: float | None
    rmse_mps: float | None
    maximum_mps: float | None
    coverage: float | None
    covered_of: int
    seen_share: float | None


@dataclass(frozen=True, eq=False)
class _Samples:
    """Known samples of a track, from which ``SpeedErrors`` are computed."""

    motion: SeenMotion
    errors: Float64Array
    stds: Float64Array
    directions: NDArray[np.str_]
    ways: NDArray[np.str_]


def speed_errors(seen: Sequence[SeenMotion], true: Sequence[TrueMotion]) -> tuple[SpeedErrors, ...]:
    """Return all groups with a sample or an instant: whole run, direction, way, body, track.

    Tracks of bodies without ground truth are left out.
    """
    by_name = {motion.body: motion for motion in true}
    all_samples = [_samples(each, by_name[each.body]) for each in seen if each.body in by_name]
    found = [_group("all", "whole run", None, all_samples, true)]
    for group, words in (("direction", (*DIRECTIONS, AT_REST)), ("way", WAYS)):
        for word in words:
            found.append(_group(group, word, None, all_samples, true, word))
    for motion in true:
        own = [s for s in all_samples if s.motion.body == motion.body]
        found.append(_group("body", motion.body, motion.body, own, [motion]))
        for each in own:
            found.append(_group("track", each.motion.track, motion.body, [each], ()))
    return tuple(e for e in found if e.group == "all" or e.samples or e.seen_share is not None)


def sample_errors(seen: SeenMotion, true: TrueMotion) -> Float64Array:
    """Return the errors (N,) of a track's speeds, m/s; NaN where the true speed is unknown."""
    return seen.speeds - true.speeds_at(seen.times)


def identity_switches(seen: Iterable[SeenMotion]) -> Iterator[IdentitySwitch]:
    """Yield the identity switches of each body, in order.

    A new segment, as after a rewind, begins new tracks for everything; that is no switch.
    """
    order: dict[str, list[tuple[float, str]]] = {}
    for each in seen:
        order.setdefault(each.body, []).extend((float(t), each.track) for t in each.frame_times)
    for body, rows in order.items():
        for (_, before), (time, after) in pairwise(sorted(rows)):
            if before != after and before.split(":")[0] == after.split(":")[0]:
                yield IdentitySwitch(time, body, before, after)


def identity_changes(seen: Sequence[SeenMotion]) -> dict[str, int]:
    """Count, by body, how often another track of the same segment took over."""
    counts = Counter(switch.body for switch in identity_switches(seen))
    return {each.body: counts[each.body] for each in seen}


def _samples(seen: SeenMotion, true: TrueMotion) -> _Samples:
    errors = sample_errors(seen, true)
    known = np.isfinite(errors)
    nearest = true.nearest(seen.times[known]) if known.any() else np.zeros(0, np.intp)
    return _Samples(
        seen,
        errors[known],
        seen.stds[known],
        np.array(true.directions, dtype=np.str_)[nearest],
        np.array(true.ways, dtype=np.str_)[nearest],
    )


def _group(
    group: str,
    label: str,
    body: str | None,
    samples: Sequence[_Samples],
    true: Sequence[TrueMotion],
    word: str | None = None,
) -> SpeedErrors:
    chosen = [np.ones(len(s.errors), np.bool_) for s in samples]
    if word is not None:
        chosen = [(s.directions if group == "direction" else s.ways) == word for s in samples]
    empty = np.zeros(0)
    errors = np.concatenate([empty, *(s.errors[c] for s, c in zip(samples, chosen, strict=True))])
    stds = np.concatenate([empty, *(s.stds[c] for s, c in zip(samples, chosen, strict=True))])
    stated = np.isfinite(stds)
    covered = np.abs(errors[stated]) <= SIGMAS_95 * stds[stated]
    count = len(errors)
    return SpeedErrors(
        group=group,
        label=label,
        body=body,
        samples=count,
        bias_mps=float(errors.mean()) if count else None,
        rmse_mps=float(np.sqrt(np.mean(errors**2))) if count else None,
        maximum_mps=float(np.abs(errors).max()) if count else None,
        coverage=float(covered.mean()) if len(covered) else None,
        covered_of=len(covered),
        seen_share=_seen_share(group, word, samples, true),
    )


def _seen_share(
    group: str, word: str | None, samples: Sequence[_Samples], true: Sequence[TrueMotion]
) -> float | None:
    counted = found = 0
    for motion in true:
        wanted = motion.in_sight & (np.nan_to_num(motion.speeds) > MOVING_MPS)
        if word is not None:
            words = motion.directions if group == "direction" else motion.ways
            wanted &= np.array(words, dtype=np.str_) == word
        times = [s.motion.frame_times for s in samples if s.motion.body == motion.body]
        counted += int(wanted.sum())
        found += int(np.isin(motion.times[wanted], np.concatenate([np.zeros(0), *times])).sum())
    return found / counted if counted else None
