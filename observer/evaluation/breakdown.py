"""Accuracy by range, true speed, direction of motion, kind of obstacle and of scenario.

**Direction** is the angle between the true velocity and the line of sight, measured by the share
of the velocity that lies along that line (its cosine): *lateral* below 0.35 (more than about 70
degrees), *radial* from 0.85 on (less than about 32 degrees), *diagonal* between. Classes include
their lower limit but not their upper one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from typing import Literal

from observer.evaluation.choices import LAB, Scale
from observer.evaluation.counts import Episode, Sample, Tally
from observer.evaluation.evaluate import (
    box_iou_median,
    coverage,
    delay_median,
    markdown_table,
    recall,
    rms,
    shown,
    unflagged_misses,
)
from observer.truth.contract import Kind

LATERAL_BELOW = 0.35
RADIAL_FROM = 0.85
# Metres: the target for the delay of radial motion covers episodes that begin within this range.
NEAR_M = 3.0

Direction = Literal["lateral", "diagonal", "radial"]
DIRECTIONS: tuple[Direction, ...] = ("lateral", "diagonal", "radial")


@dataclass(frozen=True)
class Group:
    """Figures of one class; names and None as in ``Evaluation``.

    Attributes:
        count: samples, i.e. moving obstacles in sight, summed over frames. matched: those found.
    """

    label: str
    count: int
    matched: int
    recall: float | None
    speed_rmse_mps: float | None
    velocity_rmse_mps: float | None
    centre_rmse_m: float | None
    coverage: float | None
    box_iou_median: float | None
    unflagged_misses: int


@dataclass(frozen=True)
class DelayGroup:
    """Delay of the first report of one class of episodes, classified by how they began."""

    label: str
    episodes: int
    missed: int
    median_s: float | None


@dataclass(frozen=True)
class Breakdown:
    """Accuracy of one preset by class, in the order in which they are shown."""

    by_range: tuple[Group, ...]
    by_speed: tuple[Group, ...]
    by_direction: tuple[Group, ...]
    by_body: tuple[Group, ...]
    by_kind: tuple[Group, ...]
    delays: tuple[DelayGroup, ...]


# Attribute of the breakdown, and its title.
GROUPINGS: Mapping[str, str] = {
    "by_range": "range",
    "by_speed": "true speed",
    "by_direction": "direction",
    "by_body": "obstacles",
    "by_kind": "scenarios",
}

_BODIES: Mapping[Kind | None, str] = {"robot": "robots", "person": "people", None: "unknown"}


def direction_of(radial: float) -> Direction:
    """Return the class of a motion by its share along the line of sight, 0 to 1."""
    if radial < LATERAL_BELOW:
        return "lateral"
    return "radial" if radial >= RADIAL_FROM else "diagonal"


def break_down(
    tallies: Iterable[Tally],
    scale: Scale = LAB,
    kinds: Mapping[str, Sequence[Tally]] | None = None,
) -> Breakdown:
    """Return the figures of several runs together, by class.

    Args:
        kinds: the same runs by the kind of their scenarios, e.g. ``{"ideal": [...]}``.
    """
    runs = list(tallies)
    scored = _scored(runs)
    episodes = [e for t in runs for e in t.episodes]
    by_direction = {d: [e for e in episodes if direction_of(e.radial) == d] for d in DIRECTIONS}
    by_direction_and_place = by_direction | {
        f"radial, started within {NEAR_M:g} m": [
            e for e in by_direction["radial"] if e.range_m <= NEAR_M
        ]
    }
    return Breakdown(
        by_range=_by_limits(scored, lambda s: s.range_m, scale.range_limits_m, "m"),
        by_speed=_by_limits(scored, lambda s: s.speed_mps, scale.speed_limits_mps, "m/s"),
        by_direction=tuple(
            _group(d, [each for each in scored if direction_of(each[0].radial) == d])
            for d in DIRECTIONS
        ),
        by_body=tuple(
            _group(label, [each for each in scored if each[0].kind == kind])
            for kind, label in _BODIES.items()
            if any(sample.kind == kind for sample, _ in scored)
        ),
        by_kind=tuple(_group(kind, _scored(each)) for kind, each in (kinds or {}).items()),
        delays=tuple(_delays(label, each) for label, each in by_direction_and_place.items()),
    )


def breakdown_tables(breakdowns: Mapping[str, Breakdown]) -> str:
    """Return a Markdown table for each grouping, with a row per preset within each class.

    Args:
        breakdowns: by preset; if the only name is empty, there is no preset column.
    """
    named = any(breakdowns)
    parts = []
    for attribute, title in GROUPINGS.items():
        rows = _by_class({p: getattr(b, attribute) for p, b in breakdowns.items()}, named)
        if rows:
            parts += [markdown_table([title, *(["preset"] if named else []), *_COLUMNS], rows)]
    rows = _by_class({p: b.delays for p, b in breakdowns.items()}, named)
    header = ["initial direction", *(["preset"] if named else [])]
    parts += [markdown_table([*header, "episodes", "missed", "delay s, median"], rows)]
    return "\n".join(parts)


_COLUMNS = (
    "n", "recall", "speed RMSE m/s", "velocity RMSE m/s", "centre RMSE m", "coverage", "box IoU",
    "unflagged misses",
)  # fmt: skip


def _by_class(
    groups: Mapping[str, Sequence[Group] | Sequence[DelayGroup]], named: bool
) -> list[list[str]]:
    labels = dict.fromkeys(g.label for each in groups.values() for g in each)
    return [
        [g.label, *([preset] if named else []), *_cells(g)]
        for label in labels
        for preset, each in groups.items()
        for g in each
        if g.label == label
    ]


def _cells(group: Group | DelayGroup) -> list[str]:
    if isinstance(group, DelayGroup):
        return [shown(group.episodes), shown(group.missed), shown(group.median_s)]
    return [
        shown(value)
        for value in (
            group.count, group.recall, group.speed_rmse_mps, group.velocity_rmse_mps,
            group.centre_rmse_m, group.coverage, group.box_iou_median, group.unflagged_misses,
        )
    ]  # fmt: skip


def _scored(tallies: Iterable[Tally]) -> list[tuple[Sample, bool]]:
    """Return all samples, each with whether its position and speed errors count."""
    return [(s, t.scored_for == "everything") for t in tallies for s in t.samples]


def _by_limits(
    scored: Sequence[tuple[Sample, bool]],
    value: Callable[[Sample], float],
    limits: Sequence[float],
    unit: str,
) -> tuple[Group, ...]:
    return tuple(
        _group(_label(low, high, unit), [each for each in scored if low <= value(each[0]) < high])
        for low, high in pairwise(limits)
    )


def _label(low: float, high: float, unit: str) -> str:
    if high == inf:
        return f"> {low:g} {unit}"
    return f"< {high:g} {unit}" if low == 0 else f"{low:g}-{high:g} {unit}"


def _group(label: str, scored: Sequence[tuple[Sample, bool]]) -> Group:
    samples = [s for s, _ in scored]
    measured = [s for s, whole in scored if whole]
    return Group(
        label=label,
        count=len(samples),
        matched=sum(s.matched for s in samples),
        recall=recall(samples),
        speed_rmse_mps=rms(s.speed_error_mps for s in measured),
        velocity_rmse_mps=rms(s.velocity_error_mps for s in measured),
        centre_rmse_m=rms(s.centre_error_m for s in measured),
        coverage=coverage(samples),
        box_iou_median=box_iou_median(samples),
        unflagged_misses=unflagged_misses(samples),
    )


def _delays(label: str, episodes: Sequence[Episode]) -> DelayGroup:
    missed = sum(e.first_seen is None for e in episodes)
    return DelayGroup(label, len(episodes), missed, delay_median(episodes))
