"""What is told to people of live motion capture."""

from __future__ import annotations

from typing import Any

from app.engine.aligning import Aligned
from app.messages import LiveTruthOrder
from observer.truth.alignment.result import Alignment
from observer.truth.live.contract import LiveCaptureReport


def truth_facts(
    order: LiveTruthOrder,
    report: LiveCaptureReport | None,
    trouble: str | None,
    aligned: Aligned | None,
    why_not: str,
) -> dict[str, Any]:
    """As ``StateEvent.truth`` holds it.

    Args:
        trouble: besides what the report tells. why_not: the sentence where nothing is aligned.
    """
    alignment = None if aligned is None else aligned.alignment
    clock = None if report is None else report.clock
    return {
        "spec": order.spec,
        "observer": order.observer,
        "ignore": list(order.ignore),
        "state": "connecting" if report is None else report.state,
        "trouble": trouble or (None if report is None else report.trouble),
        "notes": [] if report is None else list(report.notes),
        "bodies": []
        if report is None
        else [
            {"name": name, "role": _role(name, order, alignment), "rate_hz": round(rate, 1)}
            for name, rate in sorted(report.rate_hz.items())
        ],
        "clock": None
        if clock is None
        else {
            "offset_s": clock.offset_s,
            "drift_ppm": None if clock.drift_ppm is None else round(clock.drift_ppm, 1),
            "sigma_s": round(clock.sigma_s, 6),
            "samples": clock.samples,
        },
        "aligned": aligned is not None,
        "sentence": why_not if aligned is None else _how(aligned),
        "alignment": None if alignment is None else _figures(alignment),
    }


def _role(name: str, order: LiveTruthOrder, alignment: Alignment | None) -> str | None:
    if name in order.ignore:
        return None
    if alignment is not None:
        return alignment.roles.get(name)
    return "observer" if name == order.observer else None


def _figures(alignment: Alignment) -> dict[str, Any]:
    time = alignment.time
    residual = alignment.frame_residual_m
    return {
        "offset_s": round(time.offset_s, 5),
        "sigma_s": round(time.sigma_s, 5),
        "drift_ppm": round(time.drift_ppm, 1),
        "correlation": round(time.correlation, 4),
        "overlap_s": round(time.overlap_s, 1),
        "residual_mps": round(time.residual_mps, 4),
        "samples": time.samples,
        "observer": alignment.observer,
        "frame_residual_m": None if residual is None else round(residual, 4),
        "matches": {str(key): match.body for key, match in alignment.matches.items()},
        "notes": list(alignment.notes),
    }


def _how(aligned: Aligned) -> str:
    alignment = aligned.alignment
    time, observer = alignment.time, alignment.observer
    seen = "the obstacles alone" if observer is None else f"{observer} as the observer"
    figures = (
        f"a delay of {1000 * time.offset_s:.0f} ms ± {1000 * time.sigma_s:.0f} ms, correlation "
        f"{time.correlation:.2f}"
    )
    if aligned.carried:
        return (
            f"aligned as before the source was opened anew, by {seen} ({figures}), until enough "
            f"has been seen again"
        )
    return f"aligned over {time.overlap_s:.0f} s by {seen}: {figures}"
