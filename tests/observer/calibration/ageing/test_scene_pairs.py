"""Pairs kept for a refinement: few, spread over time, and copied."""

from __future__ import annotations

import numpy as np

from observer.calibration.ageing.watch import ScenePairs


def grey(value: int, width: int = 40) -> np.ndarray:
    return np.full((30, width), value, np.uint8)


def test_keeps_the_newest_pairs_at_the_given_spacing() -> None:
    kept = ScenePairs(count=3, spacing_s=2.0)
    for k in range(100):
        kept.offer(0.1 * k, grey(k), grey(k + 100))
    assert [int(left[0, 0]) for left, _ in kept.pairs] == [40, 60, 80]
    assert [int(right[0, 0]) for _, right in kept.pairs] == [140, 160, 180]


def test_pairs_are_stored_as_grey_copies() -> None:
    kept = ScenePairs()
    image = grey(10)
    colour = np.dstack([grey(0), grey(0), grey(200)])
    kept.offer(0.0, image, colour)
    image[:] = 99
    ((left, right),) = kept.pairs
    assert left[0, 0] == 10
    assert right.shape == (30, 40)


def test_size_change_or_time_going_back_starts_over() -> None:
    kept = ScenePairs(spacing_s=2.0)
    kept.offer(10.0, grey(1), grey(1))
    kept.offer(0.0, grey(2), grey(2))
    assert len(kept.pairs) == 2
    kept.offer(5.0, grey(3, 80), grey(3, 80))
    assert [left.shape for left, _ in kept.pairs] == [(30, 80)]
