"""Targets of the default preset in the lab's benchmark scenarios.

The figures are for obstacles between 0.8 and 4 m from the camera: samples and episodes elsewhere
do not count here (they do in ``breakdown``). Lateral motion must be found from 0.2 m/s on, other
motion from 0.3 m/s on. False instances count wherever they are.

People have their own figures, from 0.4 m/s on and between 0.5 and 6 m, and count in no others.
Runs with people are also excluded from the others' figures of false instances.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from observer.evaluation.breakdown import NEAR_M, direction_of
from observer.evaluation.counts import Episode, Sample, Tally
from observer.evaluation.evaluate import (
    box_iou_median,
    coverage,
    delay_median,
    markdown_table,
    per_100,
    recall,
    rms,
    shown,
    unflagged_misses,
)

RANGE_M = (0.8, 4.0)
# Speeds from which motion must be found, by direction; slower motion need not be.
LATERAL_MPS = 0.2
OTHER_MPS = 0.3
PEOPLE_RANGE_M = (0.5, 6.0)
PEOPLE_MPS = 0.4


@dataclass(frozen=True)
class Cost:
    """Cost of ``observe``.

    Attributes:
        image_size: width, height of all images; None where they differ.
        median_ms: of the whole step. opencv_ratio: relative to the bare cost of its OpenCV calls.
    """

    image_size: tuple[int, int] | None
    median_ms: float
    opencv_ratio: float | None


@dataclass(frozen=True)
class Target:
    """A figure with its limits and its measured value.

    Attributes:
        least, most: limits, None where there is none.
        measured: None without data, or if half of the episodes or more never got a report.
        count: samples, episodes or frames it is based on; 0 if it was not measured.
    """

    figure: str
    least: float | None
    most: float | None
    measured: float | None
    count: int

    @property
    def wanted(self) -> str:
        """Limits as text."""
        if self.least is None:
            return f"<= {self.most:g}" if self.most else "0"
        return f">= {self.least:g}" if self.most is None else f"{self.least:g}-{self.most:g}"

    @property
    def reached(self) -> bool | None:
        """True if the figure lies within its limits; None if it was not measured."""
        if self.count == 0:
            return None
        if self.measured is None:
            return False
        return (self.least is None or self.measured >= self.least) and (
            self.most is None or self.measured <= self.most
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self) | {"reached": self.reached}


def targets(
    runs: Sequence[tuple[Tally, str | None]], cost: Cost | None = None
) -> tuple[Target, ...]:
    """Return the targets of one preset.

    Args:
        runs: each with its scenario's declaration, ``ideal`` or ``faulty``, None where unknown.
        cost: None if it was not measured, or not on a quiet machine.
    """
    return (
        *_robots(runs),
        *_people([t for t, _ in runs]),
        *([] if cost is None else _costs(cost)),
    )


def _robots(runs: Sequence[tuple[Tally, str | None]]) -> list[Target]:
    """Return the targets for all obstacles that are not known to be people."""
    tallies = [t for t, _ in runs]
    samples = [s for t in tallies for s in _in_range(t)]
    lateral = [s for s in samples if _is_lateral(s.radial) and s.speed_mps >= LATERAL_MPS]
    other = [s for s in samples if not _is_lateral(s.radial) and s.speed_mps >= OTHER_MPS]
    measured = [s for t in tallies if t.scored_for == "everything" for s in _in_range(t)]
    centres = [s.centre_error_m for s in measured if s.centre_error_m is not None]
    stated = [s for s in samples if s.mahalanobis2 is not None]
    episodes = [
        e for t in tallies for e in t.episodes if e.kind != "person" and _between(e.range_m)
    ]
    alone = [t for t in tallies if not t.people]
    static = [t for t in alone if not t.moved]
    return [
        Target(f"recall, {LATERAL_MPS:g} m/s lateral or {OTHER_MPS:g} m/s otherwise", 0.97, None,
               recall(lateral + other), len(lateral + other)),
        Target(f"recall, lateral from {LATERAL_MPS:g} m/s", 0.97, None, recall(lateral),
               len(lateral)),
        Target(f"recall, radial and diagonal from {OTHER_MPS:g} m/s", 0.97, None, recall(other),
               len(other)),
        _false("false per 100 frames, scenarios without people", 0.5, alone),
        _false("false per 100 frames, static scenarios", 0.0, static),
        *_errors("ideal", 0.02, 0.03, [t for t, declares in runs if declares == "ideal"]),
        *_errors("faulty", 0.05, 0.08, [t for t, declares in runs if declares == "faulty"]),
        Target("centre RMSE, m", None, 0.08, rms(centres), len(centres)),
        Target("identity switches", None, 0.0, _switches(samples), len(samples)),
        _delay("delay s, lateral, median", 0.5, [e for e in episodes if _is_lateral(e.radial)]),
        _delay(f"delay s, radial started within {NEAR_M:g} m, median", 0.7, [
            e for e in episodes if direction_of(e.radial) == "radial" and e.range_m <= NEAR_M
        ]),
        Target("coverage of velocity", 0.90, 0.98, coverage(stated), len(stated)),
    ]  # fmt: skip


def _people(tallies: Sequence[Tally]) -> list[Target]:
    """Return the targets for people, and for false and surplus instances in runs with people."""
    samples = [s for t in tallies for s in _fast_people(t)]
    measured = [s for t in tallies if t.scored_for == "everything" for s in _fast_people(t)]
    pairs = [s for s in measured if s.velocity_error_mps is not None]
    boxes = [s for s in samples if s.box_iou is not None]
    among = [t for t in tallies if t.people]
    frames = sum(t.frames for t in among)
    surplus = per_100(sum(t.surplus_boxes for t in among), frames)
    unflagged = unflagged_misses(samples) if samples else None
    place = f"people, {PEOPLE_MPS:g} m/s at {PEOPLE_RANGE_M[0]:g}-{PEOPLE_RANGE_M[1]:g} m"
    return [
        Target(f"{place}: recall", 0.95, None, recall(samples), len(samples)),
        Target(f"{place}: velocity RMSE, m/s", None, 0.10,
               rms(s.velocity_error_mps for s in pairs), len(pairs)),
        Target(f"{place}: box IoU, median", 0.6, None, box_iou_median(boxes), len(boxes)),
        Target(f"{place}: unflagged misses", None, 0.0, unflagged, len(samples)),
        Target("surplus boxes per 100 frames, scenarios with people", None, 0.5, surplus, frames),
        _false("false per 100 frames, scenarios with people", 0.5, among),
    ]  # fmt: skip


def targets_table(
    by_preset: Mapping[str, Sequence[Target]], title: str = "metric at 0.8-4 m"
) -> str:
    """Return a Markdown table: figure, target, then each preset's value and verdict."""
    header = [title, "target"]
    for name in by_preset:
        header += [name, "reached"]
    figures = {t.figure: t.wanted for each in by_preset.values() for t in each}
    rows = []
    for figure, wanted in figures.items():
        row = [figure, wanted]
        for each in by_preset.values():
            found = next((t for t in each if t.figure == figure), None)
            row += ["-", "-"] if found is None else [_measured(found), _yes_or_no(found)]
        rows.append(row)
    return markdown_table(header, rows)


def _measured(target: Target) -> str:
    return "never" if target.count and target.measured is None else shown(target.measured)


def _yes_or_no(target: Target) -> str:
    return {True: "yes", False: "**no**", None: "-"}[target.reached]


def _between(range_m: float) -> bool:
    return RANGE_M[0] <= range_m <= RANGE_M[1]


def _in_range(tally: Tally) -> list[Sample]:
    return [s for s in tally.samples if s.kind != "person" and _between(s.range_m)]


def _fast_people(tally: Tally) -> list[Sample]:
    least, most = PEOPLE_RANGE_M
    return [
        s
        for s in tally.samples
        if s.kind == "person" and s.speed_mps >= PEOPLE_MPS and least <= s.range_m <= most
    ]


def _is_lateral(radial: float) -> bool:
    return direction_of(radial) == "lateral"


def _false(figure: str, most: float, tallies: Sequence[Tally]) -> Target:
    frames = sum(t.frames for t in tallies)
    false = sum(len(t.false) for t in tallies)
    return Target(figure, None, most, per_100(false, frames), frames)


def _errors(kind: str, speed: float, velocity: float, tallies: Sequence[Tally]) -> list[Target]:
    pairs = [s for t in tallies if t.scored_for == "everything" for s in _in_range(t) if s.matched]
    speed_rms = rms(s.speed_error_mps for s in pairs)
    velocity_rms = rms(s.velocity_error_mps for s in pairs)
    return [
        Target(f"speed RMSE, {kind}, m/s", None, speed, speed_rms, len(pairs)),
        Target(f"velocity RMSE, {kind}, m/s", None, velocity, velocity_rms, len(pairs)),
    ]


def _switches(samples: Sequence[Sample]) -> int | None:
    return sum(s.switched for s in samples) if samples else None


def _delay(figure: str, most: float, episodes: Sequence[Episode]) -> Target:
    return Target(figure, None, most, delay_median(episodes), len(episodes))


def _costs(cost: Cost) -> list[Target]:
    most = {(512, 256): 8.0, (1242, 375): 25.0}.get(cost.image_size or (0, 0))
    rows = [] if most is None else [Target("observe ms, median", None, most, cost.median_ms, 1)]
    measured = int(cost.opencv_ratio is not None)
    return [
        *rows,
        Target("observe relative to OpenCV alone", None, 2.0, cost.opencv_ratio, measured),
    ]
