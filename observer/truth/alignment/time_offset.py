"""Offset between two clocks, found from the speeds that both recorded.

The correlation is computed at every lag at which the curves overlap enough. The best lag is then
refined by least squares on the curves themselves, which resolves less than one sample.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from observer.errors import NotObservable
from observer.geometry import Float64Array
from observer.intervals import half_95
from observer.number_format import format_number
from observer.truth.alignment.correlation import Correlation, correlation, informative
from observer.truth.alignment.curves import SpeedCurve
from observer.truth.alignment.offset_fit import OffsetFit

MIN_OVERLAP_S = 4.0
MIN_CORRELATION = 0.75
# Share of the shorter recording that must overlap if no search range is given.
_MIN_SHARE = 0.4
# The unexplained variance at the second best lag must exceed that at the best by this factor.
_AMBIGUITY = 1.5
_MIN_PROMINENCE = 0.05
# Another peak is a rival if its overlap is at least this share of the best one's.
_RIVAL_OVERLAP = 0.6
# Vision leaves this much unexplained by chance; less is no sign of a better lag.
_LEAST_UNEXPLAINED = 0.03
_CLOSE_STEPS = 100
# Two lags that leave less than this unexplained both fit perfectly.
_ROUNDING = 1e-3
# A curve varies clearly if it does so by more than twice this many times its noise.
_CLEARLY = 3.0
# Seconds: an offset less certain than this is useless.
MAX_SIGMA_S = 0.06
# Seconds: a drift only shows over an overlap this long.
_DRIFT_OVERLAP_S = 20.0


@dataclass(frozen=True)
class TimeOffset:
    """Relation of truth's clock to the source's.

    Attributes:
        offset_s: to be added to truth's times at ``reference_s``; sigma_s: one standard deviation.
        reference_s: on truth's clock, the middle of the overlap.
        drift_ppm: growth of the offset, microseconds per second; 0 if the overlap is too short
            to tell. drift_sigma_ppm: None if it was not estimated.
        correlation: -1 to 1, of the curves at this offset.
        runner_up: the highest correlation of any other peak, None if there is none.
        overlap_s: time in which both curves are known.
        residual_mps: RMS residual, in the curves' unit.
        samples: number compared.
    """

    offset_s: float
    sigma_s: float
    reference_s: float
    drift_ppm: float
    drift_sigma_ppm: float | None
    correlation: float
    runner_up: float | None
    overlap_s: float
    residual_mps: float
    samples: int

    @property
    def words(self) -> str:
        """Describe the offset and how well it is known, for people."""
        drift = ""
        if self.drift_sigma_ppm is not None:
            drift = f", drift {format_number(self.drift_ppm, 0, signed=True)} ppm"
        offset_ms = format_number(1e3 * self.offset_s, 1, signed=True)
        return (
            f"time offset {offset_ms} ± {1e3 * half_95(self.sigma_s):.1f} ms (95 % "
            f"interval{drift}), correlation {self.correlation:.2f} over {self.overlap_s:.0f} s"
        )

    def to_truth(self, times: Float64Array) -> Float64Array:
        """Return times (N,) s of the source's clock on truth's clock."""
        slope = 1 + 1e-6 * self.drift_ppm
        since = np.asarray(times, np.float64) - self.offset_s - self.reference_s
        return np.asarray(self.reference_s + since / slope)


def find_time_offset(
    pairs: Sequence[tuple[SpeedCurve, SpeedCurve]],
    *,
    search: tuple[float, float] | None = None,
    drift: bool = True,
) -> TimeOffset:
    """Find the offset at which pairs of curves on the same two clocks agree best.

    Args:
        pairs: seen by the observer, on the source's clock; true by motion capture, on its own.
        search: lowest and highest offset, seconds, if it is roughly known.
        drift: also estimate a drift if the overlap is long enough.

    Raises:
        NotObservable: one sentence that says why and what would help.
    """
    # A constant curve says nothing about the clocks, and its errors are not noise alone.
    pairs = informative(pairs) or pairs
    found = correlation(pairs)
    coarse, runner_up = best_lag(found, search)
    # Pairs that hardly vary help to choose a lag, but their errors would bias the offset.
    pairs = informative(pairs, _CLEARLY) or pairs
    return refined(pairs, coarse, runner_up, step=found.step, drift=drift)


def best_lag(found: Correlation, search: tuple[float, float] | None) -> tuple[float, float | None]:
    """Return the lag of the highest correlation, and the highest correlation of any other peak.

    Raises:
        NotObservable: no lag has enough overlap, or there is no clear peak.
    """
    allowed = _allowed_lags(found, search)
    if not found.varied:
        raise NotObservable(
            "the speed is constant within its noise, which fits any time offset; let the robot "
            "start, stop or turn once during the recording"
        )
    values = np.where(allowed, found.values, -1.0)
    best = _highest(values, found.overlap_s)
    if values[best] < MIN_CORRELATION:
        raise NotObservable(_too_little(float(values[best])))
    if best in (0, len(values) - 1) or not (allowed[best - 1] and allowed[best + 1]):
        raise NotObservable(
            "the best time offset lies at the edge of the overlap of the recordings; record the "
            "same motion for longer, including a start or a stop"
        )
    others = _other_peaks(values, best)
    if not len(others):
        return float(found.lags[best]), None
    _refuse_rival(found, values, best, others)
    return float(found.lags[best]), float(values[others].max())


def _allowed_lags(found: Correlation, search: tuple[float, float] | None) -> NDArray[np.bool_]:
    """(N,) whether each lag has enough overlap and lies in the search range.

    Raises:
        NotObservable: none does.
    """
    enough = MIN_OVERLAP_S
    if search is None:
        enough = max(enough, _MIN_SHARE * found.shorter_s)
    allowed = found.overlap_s >= enough
    if search is not None:
        allowed &= (found.lags >= search[0]) & (found.lags <= search[1])
    if not allowed.any():
        raise NotObservable(
            f"speeds are known on both sides for less than {enough:.1f} s, too short to determine "
            "the time offset; record the same motion for longer"
        )
    return np.asarray(allowed, dtype=np.bool_)


def _highest(values: Float64Array, overlap_s: Float64Array) -> int:
    """Return the index of the likeliest of the correlations (N,) with these overlaps (N,)."""
    # Log-likelihood against no relation at all: agreement counts by its duration.
    unexplained = np.maximum(1 - np.clip(values, 0, 1) ** 2, _LEAST_UNEXPLAINED)
    best = int(np.argmax(-overlap_s * np.log(unexplained)))
    # Weighting by overlap shifts the maximum slightly off the peak of the correlation.
    first = max(best - _CLOSE_STEPS, 0)
    return first + int(np.argmax(values[first : best + _CLOSE_STEPS + 1]))


def _other_peaks(values: Float64Array, best: int) -> NDArray[np.intp]:
    """Return the indices (M,) of the peaks of the correlations (N,) besides the best one."""
    # Imported late: that takes as long as reading a stored alignment, which does not need it.
    from scipy.signal import find_peaks

    others, _ = find_peaks(values, prominence=_MIN_PROMINENCE)
    # A flat top may be reported as a second peak.
    apart = [
        float(values[min(int(k), best) : max(int(k), best) + 1].min()) < float(values[k]) - 0.02
        for k in others
    ]
    return np.asarray(others[np.array(apart, dtype=bool)], dtype=np.intp)


def _refuse_rival(
    found: Correlation, values: Float64Array, best: int, others: NDArray[np.intp]
) -> None:
    """Refuse a best lag that another peak equals.

    Raises:
        NotObservable: names both lags.
    """
    # Equal agreement over a much shorter time is only a part of the motion that was repeated.
    rivals = others[found.overlap_s[others] >= _RIVAL_OVERLAP * found.overlap_s[best]]
    if not len(rivals):
        return
    peak, rival = float(values[best]), int(rivals[np.argmax(values[rivals])])
    left = max(1 - peak**2, _ROUNDING)
    if values[rival] > 0 and 1 - values[rival] ** 2 < _AMBIGUITY * left:
        here, there = (format_number(float(found.lags[k]), 2, signed=True) for k in (best, rival))
        raise NotObservable(
            f"the speeds agree almost equally well at time offsets {here} s and {there} s "
            f"(correlations {peak:.3f} and {values[rival]:.3f}), as for a periodic motion; record "
            "a start or a stop, or give the approximate offset"
        )


def refined(
    pairs: Sequence[tuple[SpeedCurve, SpeedCurve]],
    coarse: float,
    runner_up: float | None,
    *,
    step: float,
    drift: bool,
) -> TimeOffset:
    """Refine the offset near ``coarse`` by least squares on the curves, with its sigma.

    Raises:
        NotObservable: the offset remains too uncertain, or the fit diverges.
    """
    fit = OffsetFit(pairs, coarse)
    if fit.samples < 10:
        raise NotObservable(
            f"only {fit.samples} speeds are known on both sides, too few to determine the time "
            "offset; record the same motion for longer"
        )
    with_drift = drift and fit.span_s >= _DRIFT_OVERLAP_S
    solution = fit.solve(with_drift)
    offset = coarse + solution[0]
    sigma, drift_sigma = fit.sigmas(solution, with_drift)
    if abs(solution[0]) > max(0.3, 5 * step) or not sigma <= MAX_SIGMA_S:
        raise NotObservable(
            f"the time offset can only be determined to ± {1e3 * half_95(sigma):.0f} ms (95 % "
            "interval) because the speed changes too little; let the robot start and stop during "
            "the recording"
        )
    agreement = fit.correlation(solution)
    if agreement < MIN_CORRELATION:
        raise NotObservable(_too_little(agreement))
    return TimeOffset(
        offset_s=float(offset),
        sigma_s=float(sigma),
        reference_s=fit.reference,
        drift_ppm=float(1e6 * solution[1]) if with_drift else 0.0,
        drift_sigma_ppm=1e6 * drift_sigma if with_drift else None,
        correlation=agreement,
        runner_up=runner_up,
        overlap_s=fit.overlap_s,
        residual_mps=fit.residual(solution),
        samples=fit.samples,
    )


def _too_little(correlation: float) -> str:
    return (
        f"the speeds do not agree at any time offset (correlation {correlation:.2f}, at least "
        f"{MIN_CORRELATION} is needed); check that the body is the one that was seen, and let it "
        "start and stop during the recording"
    )
