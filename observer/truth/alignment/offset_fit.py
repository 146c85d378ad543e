"""Least squares for the offset of two clocks, on the curves themselves, with its sigma."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from observer.geometry import Float64Array
from observer.robust import MAD_TO_SIGMA
from observer.truth.alignment.curves import SpeedCurve

# Two crystals usually differ by less; without a bound the drift would fit noise.
_DRIFT_PRIOR_PPM = 100.0
# The drift rests on few starts and stops at either end: known drifts erred by this much more.
_DRIFT_ERRS_MORE = 1.4
# Sigmas of the gain (relative) and the bias (in sigmas of the speed) of the seen speeds.
_GAIN_PRIOR, _BIAS_PRIOR_SIGMAS = 0.1, 1.0
# Beyond this many sigmas a residual counts linearly, as the data contain outliers.
_ROBUST_SIGMAS = 2.0


class OffsetFit:
    """Least squares over offset (relative to the coarse one), drift, and gain and bias per pair."""

    def __init__(self, pairs: Sequence[tuple[SpeedCurve, SpeedCurve]], coarse: float) -> None:
        self._parts: list[tuple[Float64Array, Float64Array, Float64Array, SpeedCurve]] = []
        times = []
        for seen, true in pairs:
            # Require values at nearby offsets too, so that no sample drops in or out in the search.
            known = seen.known.copy()
            for shift in (-0.1, 0.0, 0.1):
                known &= np.isfinite(true.at(seen.times - coarse + shift))
            t = seen.times[known]
            self._parts.append((t - coarse, seen.values[known], seen.sigmas[known], true))
            times.append(t - coarse)
        every = np.concatenate(times)
        self.samples = len(every)
        self.span_s = float(np.ptp(every)) if len(every) else 0.0
        self.reference = float((every.min() + every.max()) / 2) if len(every) else 0.0
        self.overlap_s = max((_known_time(t) for t in times), default=0.0)
        # Noise of each pair, in its sigmas.
        self._noise = np.ones(len(self._parts))

    def solve(self, with_drift: bool) -> Float64Array:
        start = np.zeros(2 + 2 * len(self._parts))
        # Estimate the actual noise from the residuals, then fit again with it.
        for _ in range(3):
            free = [0, *([1] if with_drift else []), *range(2, len(start))]

            def cost(x: Float64Array, free: list[int] = free) -> Float64Array:
                full = np.zeros(len(start))
                full[free] = x
                return np.concatenate([*self._residuals(full), self._priors(full)])

            found = scipy.optimize.least_squares(
                cost, start[free], loss="soft_l1", f_scale=_ROBUST_SIGMAS,
                x_scale=[1e-2, *([1e-5] if with_drift else []), *[0.1] * (2 * len(self._parts))],
            )  # fmt: skip
            start[free] = found.x
            for k, error in enumerate(self._residuals(start)):
                if len(error) < 3:
                    continue
                spread = MAD_TO_SIGMA * float(np.median(np.abs(error)))
                # Correlated errors carry less information than their number of samples suggests.
                lags = _correlated_samples(self._parts[k][0])
                like = _correlation_time(np.clip(error, -3, 3), lags)
                self._noise[k] = max(self._noise[k] * spread * np.sqrt(like), 0.05)
        return start

    def _residuals(self, x: Float64Array) -> list[Float64Array]:
        parts = []
        for k, (times, values, sigmas, true) in enumerate(self._parts):
            drifted = times - x[0] - x[1] * (times - self.reference)
            expected = np.nan_to_num(true.at(drifted), nan=0.0)
            gain, bias = 1 + x[2 + 2 * k], x[3 + 2 * k] * float(np.median(sigmas))
            lost = np.isnan(true.at(drifted))
            error = np.where(lost, 0.0, (values - gain * expected - bias) / sigmas)
            parts.append(error / self._noise[k])
        return parts

    def _priors(self, x: Float64Array) -> Float64Array:
        gains, biases = x[2::2] / _GAIN_PRIOR, x[3::2] / _BIAS_PRIOR_SIGMAS
        return np.concatenate([gains, biases, [1e6 * x[1] / _DRIFT_PRIOR_PPM]])

    def sigmas(self, x: Float64Array, with_drift: bool) -> tuple[float, float]:
        """Return the sigmas of offset and drift, from the scatter of the residuals' gradients.

        This is the sandwich estimator of Newey and West (1987), since neighbouring residuals are
        correlated: smoothing, and errors from seeing a body's other side, last for many frames.
        """
        free = [0, *([1] if with_drift else []), *range(2, len(x))]
        residuals = self._residuals(x)
        columns = []
        for index in free:
            delta = np.zeros(len(x))
            step = (2e-2, 5e-6)[index] if index < 2 else 1e-3
            delta[index] = step
            ahead, behind = self._residuals(x + delta), self._residuals(x - delta)
            steps = zip(ahead, behind, strict=True)
            columns.append([(a - b) / (2 * step) for a, b in steps])
        prior = np.zeros(len(x))
        prior[2::2], prior[3::2] = _GAIN_PRIOR**-2, _BIAS_PRIOR_SIGMAS**-2
        prior[1] = (1e6 / _DRIFT_PRIOR_PPM) ** 2
        information = np.diag(prior[free])
        scatter = np.diag(prior[free])
        inflation = np.zeros_like(information)
        for k, r in enumerate(residuals):
            J = np.column_stack([column[k] for column in columns])
            weight = np.asarray(1 / np.sqrt(1 + (r / _ROBUST_SIGMAS) ** 2))
            information += J.T @ (weight[:, None] * J)
            g = J * (weight * r)[:, None]
            # Errors as slow as the speed itself look like an offset.
            lags = max(_correlated_samples(self._parts[k][0]), _first_zero(J[:, 0]))
            scatter += _long_run(g, lags)
            # With few events the scatter may be small by chance; then the noise level decides.
            power = float(np.mean((weight * r) ** 2))
            inflation += _correlation_time(weight * r, lags) * power * (J.T @ J)
        inverse = np.linalg.pinv(information)
        sandwich = inverse @ scatter @ inverse
        plain = inverse @ (inflation + np.diag(prior[free])) @ inverse
        variances = np.maximum(np.diag(sandwich), np.diag(plain))
        # Statistics cannot reveal the true instant within the reported frame.
        intervals = [float(np.median(np.diff(t))) for t, *_ in self._parts if len(t) > 1]
        floor = 0.02 * min(intervals, default=0.0)
        return (
            float(np.hypot(np.sqrt(variances[0]), floor)),
            _DRIFT_ERRS_MORE * float(np.sqrt(variances[1])) if with_drift else float("nan"),
        )

    def correlation(self, x: Float64Array) -> float:
        """Return the correlation of all curves, each about its own mean, robust to outliers."""
        covariance = power_seen = power_true = 0.0
        for (times, values, sigmas, curve), r in zip(self._parts, self._residuals(x), strict=True):
            true = curve.at(times - x[0] - x[1] * (times - self.reference))
            known = np.isfinite(true)
            if not known.any():
                continue
            weight = (1 / (1 + (r / _ROBUST_SIGMAS) ** 2) / sigmas**2)[known]
            a, b = values[known], true[known]
            a, b = a - np.average(a, weights=weight), b - np.average(b, weights=weight)
            covariance += float(weight @ (a * b))
            power_seen += float(weight @ (a * a))
            power_true += float(weight @ (b * b))
        return covariance / (float(np.sqrt(power_seen * power_true)) + 1e-12)

    def residual(self, x: Float64Array) -> float:
        """Return the RMS residual with gain and bias not fitted, for these are errors too."""
        times, values, _, curve = self._parts[0]
        error = values - curve.at(times - x[0] - x[1] * (times - self.reference))
        return float(np.sqrt(np.nanmean(error**2))) if np.isfinite(error).any() else float("nan")


def _known_time(times: Float64Array) -> float:
    if len(times) < 2:
        return 0.0
    steps = np.diff(times)
    return float(steps[steps <= 3.5 * np.median(steps)].sum())


def _correlated_samples(times: Float64Array) -> int:
    """Return the number of neighbours that may be correlated, those within a second."""
    if len(times) < 3:
        return 0
    return int(np.clip(round(1.0 / float(np.median(np.diff(times)))), 1, len(times) // 3))


def _first_zero(gradient: Float64Array) -> int:
    """Return the lag of the autocorrelation's first zero, samples, at most a quarter of all."""
    power = float(gradient @ gradient)
    limit = len(gradient) // 4
    if power <= 0:
        return 0
    for lag in range(1, limit):
        if gradient[lag:] @ gradient[:-lag] <= 0:
            return lag
    return limit


def _long_run(g: Float64Array, lags: int) -> Float64Array:
    """Return the covariance (P, P) of the sum of g (N, P), by Bartlett's window."""
    total = g.T @ g
    for lag in range(1, lags + 1):
        cross = g[lag:].T @ g[:-lag]
        total = total + (1 - lag / (lags + 1)) * (cross + cross.T)
    return np.asarray(total)


def _correlation_time(r: Float64Array, lags: int) -> float:
    """Return the ratio, at least 1, of a sum's variance to that of independent samples."""
    power = float(r @ r)
    if power <= 0 or lags < 1:
        return 1.0
    total = 1.0
    for lag in range(1, lags + 1):
        rho = float(r[lag:] @ r[:-lag]) / power
        # Beyond the first zero crossing there is only noise.
        if rho <= 0:
            break
        total += 2 * rho
    return total
