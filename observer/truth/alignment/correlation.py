"""Correlation of curves with gaps, at all lags at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from observer.errors import NotObservable
from observer.geometry import Float64Array
from observer.truth.alignment.curves import SpeedCurve

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
    lags = _Lags.of(usable)
    # One pair after the other, since those of a long recording take much memory.
    total = sum((_moments(seen, true, lags) for seen, true in usable), _Moments.none(lags.count))
    floor = 1e-9 * max(float(total.power_seen.max()), float(total.power_true.max()), 1e-300)
    scale = np.sqrt(np.maximum(total.power_seen, floor))
    scale *= np.sqrt(np.maximum(total.power_true, floor))
    return Correlation(
        lags=lags.seconds,
        values=np.clip(total.covariance / scale, -1, 1),
        overlap_s=total.overlap_s,
        step=lags.step,
        shorter_s=total.shorter_s,
        varied=bool(informative(usable)),
    )


@dataclass(frozen=True)
class _Lags:
    """Grids of equal step over all seen and all true times, and the lags between their samples.

    Attributes:
        seen_start, true_start: seconds. n, m: number of samples of the seen and the true grid.
    """

    seen_start: float
    true_start: float
    step: float
    n: int
    m: int

    @classmethod
    def of(cls, pairs: Sequence[tuple[SpeedCurve, SpeedCurve]]) -> _Lags:
        """Choose the step by the length of the curves."""
        seen_start = min(s.times[s.known][0] for s, _ in pairs)
        seen_end = max(s.times[s.known][-1] for s, _ in pairs)
        true_start = min(t.times[t.known][0] for _, t in pairs)
        true_end = max(t.times[t.known][-1] for _, t in pairs)
        length = max(seen_end - seen_start, true_end - true_start)
        step = max(_STEP_S, length / _MAX_STEPS)
        n = int((seen_end - seen_start) / step) + 2
        m = int((true_end - true_start) / step) + 2
        return cls(seen_start, true_start, step, n, m)

    @property
    def count(self) -> int:
        """Number of lags."""
        return self.n + self.m - 1

    @property
    def seconds(self) -> Float64Array:
        """(L,) to be added to truth's times."""
        steps = np.arange(-(self.m - 1), self.n)
        return np.asarray(self.seen_start - self.true_start + self.step * steps, np.float64)

    @property
    def true_times(self) -> Float64Array:
        """Instants (m,) of the true grid."""
        return np.asarray(self.true_start + self.step * np.arange(self.m), np.float64)

    def spectrum(self, values: NDArray[Any]) -> Spectrum:
        """Transform samples of either grid, for ``sums``."""
        return np.asarray(scipy.fft.rfft(values, self._size), np.complex128)

    def sums(self, seen: Spectrum, true: Spectrum) -> Float64Array:
        """Return the sum (L,) of products of seen and true samples at each lag."""
        product = scipy.fft.irfft(seen * np.conj(true), self._size)
        # Lag k: seen sample i meets true sample i - k.
        return np.concatenate([product[self._size - (self.m - 1) :], product[: self.n]])

    @property
    def _size(self) -> int:
        # Long enough that nothing wraps around.
        return int(scipy.fft.next_fast_len(self.n + self.m))


@dataclass(frozen=True, eq=False)
class _Moments:
    """Weighted second moments by lag (L,), each curve about its mean in the overlap.

    Those of several pairs are sums, but the times are those of the pair with the longest.
    """

    covariance: Float64Array
    power_seen: Float64Array
    power_true: Float64Array
    overlap_s: Float64Array
    shorter_s: float

    @classmethod
    def none(cls, lags: int) -> _Moments:
        """Return those of no pair."""
        return cls(np.zeros(lags), np.zeros(lags), np.zeros(lags), np.zeros(lags), 0.0)

    def __add__(self, other: _Moments) -> _Moments:
        return _Moments(
            covariance=self.covariance + other.covariance,
            power_seen=self.power_seen + other.power_seen,
            power_true=self.power_true + other.power_true,
            overlap_s=np.maximum(self.overlap_s, other.overlap_s),
            shorter_s=max(self.shorter_s, other.shorter_s),
        )


def _moments(seen: SpeedCurve, true: SpeedCurve, lags: _Lags) -> _Moments:
    """Return the moments of one pair."""
    # Imported late: that takes as long as reading a stored alignment, which does not need it.
    from scipy.signal import medfilt

    known = seen.known
    place = np.rint((seen.times[known] - lags.seen_start) / lags.step).astype(int)
    weight = seen.sigmas[known] ** -2.0
    # Single outliers would outweigh a start or stop; only the later least squares is robust.
    values = medfilt(seen.values[known], _MEDIAN_SAMPLES)
    centre = float(np.average(values, weights=weight))
    values = values - centre
    interval = float(np.median(np.diff(seen.times[known])))
    t = true.at(lags.true_times)
    mask = np.isfinite(t).astype(np.float64)
    t = np.nan_to_num(t - centre)

    S = [
        lags.spectrum(np.bincount(place, weights=each, minlength=lags.n))
        for each in (np.ones(len(place)), weight, weight * values, weight * values**2)
    ]
    T = [lags.spectrum(each) for each in (mask, t, t * t)]
    count, w = lags.sums(S[0], T[0]), lags.sums(S[1], T[0])
    ws, wss = lags.sums(S[2], T[0]), lags.sums(S[3], T[0])
    wt, wtt, wst = lags.sums(S[1], T[1]), lags.sums(S[1], T[2]), lags.sums(S[2], T[1])
    inside = count > 4.5
    safe = np.where(inside, w, 1.0)
    return _Moments(
        covariance=np.where(inside, wst - ws * wt / safe, 0),
        power_seen=np.where(inside, wss - ws * ws / safe, 0),
        power_true=np.where(inside, wtt - wt * wt / safe, 0),
        overlap_s=np.where(inside, count * interval, 0),
        shorter_s=min(known.sum() * interval, float(mask.sum()) * lags.step),
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
