"""Simulated timestamps and arrivals of a server."""

from __future__ import annotations

import numpy as np

from observer.geometry import Float64Array


def arrivals(
    seed: int,
    duration_s: float,
    *,
    rate_hz: float = 100.0,
    offset_s: float = 1.7e9,
    drift_ppm: float = 0.0,
    started: float = 1000.0,
    stamped_to_s: float = 0.0,
) -> tuple[Float64Array, Float64Array]:
    """Return timestamps and arrivals, (N,) seconds each, of a server fast by ``drift_ppm``.

    Delays as in a lab network: at least 0.4 ms, plus 0.9 ms on average (a sum of three terms,
    so that the minimum is rare), one message in fifty held for up to 30 ms, and two pauses of
    0.3 s in which all wait; nothing overtakes. Stamps may be truncated to ``stamped_to_s``.
    """
    rng = np.random.default_rng(seed)
    sent = started + np.arange(int(duration_s * rate_hz)) / rate_hz
    delays = 4e-4 + rng.gamma(3.0, 3e-4, len(sent))
    delays += np.where(rng.random(len(sent)) < 0.02, rng.uniform(0, 0.03, len(sent)), 0.0)
    for begin in rng.uniform(started, started + duration_s, 2):
        held = (sent >= begin) & (sent < begin + 0.3)
        delays[held] += begin + 0.3 - sent[held]
    received = np.maximum.accumulate(sent + delays)
    stamps = sent + offset_s + drift_ppm * 1e-6 * (sent - started)
    return np.floor(stamps / stamped_to_s) * stamped_to_s if stamped_to_s else stamps, received
