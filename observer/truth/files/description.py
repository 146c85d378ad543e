"""Description of a motion capture file, for the response to an upload."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.geometry import Float64Array
from observer.truth.motion_capture import Capture, Trajectory
from observer.truth.speeds import smoothed_velocity


def describe_capture(capture: Capture) -> dict[str, Any]:
    """Return plain data for JSON; unknown values are None.

    ``format``, ``rate_hz``, ``duration_s`` (of all bodies together), ``notes``, and ``bodies``:
    for each its ``name``, whether it ``has_orientation``, ``samples``, those ``seen``, ``gaps``,
    ``from_s`` and ``to_s`` on the system's clock, ``extent_m`` (3 numbers, along the room's axes)
    and ``highest_speed_mps`` (smoothed over 11 samples).
    """
    spans = [(b.times[0], b.times[-1]) for b in capture.bodies.values() if len(b.times)]
    duration = max(end for _, end in spans) - min(start for start, _ in spans) if spans else None
    return {
        "format": capture.format,
        "rate_hz": capture.rate_hz,
        "duration_s": None if duration is None else float(duration),
        "bodies": [_describe(body) for body in capture.bodies.values()],
        "notes": list(capture.notes),
    }


def _describe(body: Trajectory) -> dict[str, Any]:
    seen = body.positions[body.seen]
    known = len(body.times) > 0
    return {
        "name": body.name,
        "has_orientation": body.rotations is not None,
        "samples": len(body.times),
        "seen": len(seen),
        "gaps": body.gaps,
        "from_s": float(body.times[0]) if known else None,
        "to_s": float(body.times[-1]) if known else None,
        "extent_m": np.ptp(seen, axis=0).tolist() if len(seen) else None,
        "highest_speed_mps": _highest(smoothed_velocity(body.times, body.positions)),
    }


def _highest(velocity: Float64Array) -> float | None:
    speeds = np.linalg.norm(velocity, axis=1)
    known = speeds[np.isfinite(speeds)]
    return float(known.max()) if len(known) else None
