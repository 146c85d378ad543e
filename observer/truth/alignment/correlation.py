"""Correlation of curves with gaps, at all lags at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from observer.geometry import Float64Array
from observer.truth.alignment.curves import SpeedCurve
from observer.truth.alignment.observability import NotObservable

_MEDIAN_SAMPLES = 5
Spectrum = NDArray[np.complex128]

_STEP_S = 0.01
# Beyond this many steps (two hours at 10 ms) a coarser step is used.
_MAX_STEPS = 720_000
# A curve that varies by less than this many times its noise is constant.
_VARIES = 1.5


@dataclass(frozen=True, eq=False)
class Correlation:
    """Correlation by lag.

    Attributes:
        lags: (L,) seconds to be added to truth's times, increasing by ``step``.
        values: (L,) -1 to 1; 0 where nothing overlaps.
        overlap_s: (L,) time in which both curves are known, of the pair with the most.
        shorter_s: time in which the shorter curve is known.
        varied: True if in some pair the seen and the true speed vary by more than noise.
    """

    lags: Float64Array
    values: Float64Array
    overlap_s: Float64Array
    step: float
    shorter_s: float
    varied: bool


def correlation(pairs: Sequence[tuple[SpeedCurve, SpeedCurve]]) -> Correlation:
    """Return the weighted correlation of all pairs together, each about its own mean.

    Seen values count at their instants, weighted by sigma; truth is interpolated. Sums over the
    overlap come from six transforms (Padfield: Masked object registration in the Fourier
    domain, 2012).

    Raises:
        NotObservable: there is nothing to correlate.
    """
    usable = [(s, t) for s, t in pairs if s.known.sum() >= 5 and t.known.sum() >= 5]
    if not usable:
        raise NotObservable(
            "no speeds can be compared; the observer must see an obstacle move, or motion capture "
            "must see the observer move"
        )
    seen_start = min(s.times[s.known][0] for s, _ in usable)
    seen_end = max(s.times[s.known][-1] for s, _ in usable)
    true_start = min(t.times[t.known][0] for _, t in usable)
    true_end = max(t.times[t.known][-1] for _, t in usable)
    length = max(seen_end - seen_start, true_end - true_start)
    step = max(_STEP_S, length / _MAX_STEPS)
    n = int((seen_end - seen_start) / step) + 2
    m = int((true_end - true_start) / step) + 2
    # Imported late: that takes as long as reading a stored alignment, which does not need it.
    from scipy.signal import medfilt

    size = scipy.fft.next_fast_len(n + m)
    grid = true_start + step * np.arange(m)
    covariance = np.zeros(n + m - 1)
    power_seen, power_true, overlap = covariance.copy(), covariance.copy(), covariance.copy()
    varied = False
    shorter = 0.0
    for seen, true in usable:
        known = seen.known
        place = np.rint((seen.times[known] - seen_start) / step).astype(int)
        weight = seen.sigmas[known] ** -2.0
        # Single outliers would outweigh a start or stop; only the later least squares is robust.
        values = medfilt(seen.values[known], _MEDIAN_SAMPLES)
        centre = float(np.average(values, weights=weight))
        values = values - centre
        interval = float(np.median(np.diff(seen.times[known])))
        t = true.at(grid)
        mask = np.isfinite(t).astype(np.float64)
        t = np.nan_to_num(t - centre)
        ones = np.ones(len(place))
        spread = [
            np.bincount(place, weights=w, minlength=n)
            for w in (ones, weight, weight * values, weight * values**2)
        ]
        S = [scipy.fft.rfft(a, size) for a in spread]
        T = [np.conj(scipy.fft.rfft(a, size)) for a in (mask, t, t * t)]

        def sums(a: Spectrum, b: Spectrum) -> Float64Array:
            product = scipy.fft.irfft(a * b, size)
            # Lag k: seen sample i meets true sample i - k.
            return np.concatenate([product[size - (m - 1) :], product[:n]])

        count = sums(S[0], T[0])
        w = sums(S[1], T[0])
        ws, wss = sums(S[2], T[0]), sums(S[3], T[0])
        wt, wtt, wst = sums(S[1], T[1]), sums(S[1], T[2]), sums(S[2], T[1])
        inside = count > 4.5
        safe = np.where(inside, w, 1.0)
        covariance += np.where(inside, wst - ws * wt / safe, 0)
        power_seen += np.where(inside, wss - ws * ws / safe, 0)
        power_true += np.where(inside, wtt - wt * wt / safe, 0)
        overlap = np.maximum(overlap, np.where(inside, count * interval, 0))
        varied |= bool(informative([(seen, true)]))
        own = min(known.sum() * interval, float(mask.sum()) * step)
        shorter = max(shorter, own)
    floor = 1e-9 * max(float(power_seen.max()), float(power_true.max()), 1e-300)
    square = np.maximum(power_seen, floor) * np.maximum(power_true, floor)
    lags = seen_start - true_start + step * np.arange(-(m - 1), n)
    return Correlation(
        lags=lags,
        values=np.clip(covariance / np.sqrt(square), -1, 1),
        overlap_s=overlap,
        step=step,
        shorter_s=shorter,
        varied=varied,
    )


def informative(
    pairs: Sequence[tuple[SpeedCurve, SpeedCurve]], strength: float = _VARIES
) -> list[tuple[SpeedCurve, SpeedCurve]]:
    """Return the pairs whose curves both vary by twice ``strength`` times the seen one's noise."""
    return [
        (seen, true)
        for seen, true in pairs
        if _varies(seen, seen, strength) and _varies(true, seen, strength)
    ]


def _varies(curve: SpeedCurve, noise: SpeedCurve, strength: float) -> bool:
    """Return whether a curve varies by more than the noise of what is seen."""
    if curve.known.sum() < 5:
        return False
    # Single outliers do not count as variation.
    low, high = np.percentile(curve.values[curve.known], [2, 98])
    return bool(high - low > 2 * strength * float(np.median(noise.sigmas)))
