"""Facts about live motion capture for display."""

from __future__ import annotations

from app.contract.commands import LiveTruthOrder
from app.contract.live_truth import CaptureBody, LiveAlignment, LiveTruthStatus, ServerClock
from app.contract.values import filled
from app.engine.aligning import Aligned
from observer.intervals import half_95
from observer.number_format import format_number
from observer.rig.rig import ROLES, Role
from observer.truth.alignment.result import Alignment
from observer.truth.live.contract import LiveCaptureReport


def truth_facts(
    order: LiveTruthOrder,
    report: LiveCaptureReport,
    trouble: str | None,
    aligned: Aligned | None,
    why_not: str,
) -> LiveTruthStatus:
    """Return the facts as ``StateEvent.truth`` holds them.

    Args:
        trouble: a fault that the report does not contain.
        why_not: the sentence to show if nothing is aligned.
    """
    alignment = None if aligned is None else aligned.alignment
    clock = report.clock
    return LiveTruthStatus(
        spec=order.spec,
        observer=order.observer,
        ignore=order.ignore,
        state=report.state,
        trouble=trouble or report.trouble,
        notes=report.notes,
        bodies=[
            CaptureBody(name, _role(name, order, alignment), round(rate, 1))
            for name, rate in sorted(report.rate_hz.items())
        ],
        clock=None
        if clock is None
        else filled(
            ServerClock,
            clock,
            drift_ppm=None if clock.drift_ppm is None else round(clock.drift_ppm, 1),
            sigma_s=round(clock.sigma_s, 6),
        ),
        aligned=aligned is not None,
        sentence=why_not if aligned is None else _how(aligned),
        alignment=None if alignment is None else _figures(alignment),
    )


def _role(name: str, order: LiveTruthOrder, alignment: Alignment | None) -> Role | None:
    if name in order.ignore:
        return None
    if alignment is not None:
        return next((role for role in ROLES if role == alignment.roles.get(name)), None)
    return "observer" if name == order.observer else None


def _figures(alignment: Alignment) -> LiveAlignment:
    time = alignment.time
    residual = alignment.frame_residual_m
    return LiveAlignment(
        offset_s=round(time.offset_s, 5),
        sigma_s=round(time.sigma_s, 5),
        drift_ppm=round(time.drift_ppm, 1),
        correlation=round(time.correlation, 4),
        overlap_s=round(time.overlap_s, 1),
        residual_mps=round(time.residual_mps, 4),
        samples=time.samples,
        observer=alignment.observer,
        frame_residual_m=None if residual is None else round(residual, 4),
        matches={str(key): match.body for key, match in alignment.matches.items()},
        notes=alignment.notes,
    )


def _how(aligned: Aligned) -> str:
    alignment = aligned.alignment
    time, observer = alignment.time, alignment.observer
    seen = "the obstacles only" if observer is None else f"{observer} as the observer"
    figures = (
        f"delay {format_number(1000 * time.offset_s, 0)} ± {1000 * half_95(time.sigma_s):.0f} ms "
        f"(95 % interval), correlation {time.correlation:.2f}"
    )
    if aligned.carried:
        return (
            f"using the alignment from before the source was reopened, from {seen} ({figures}), "
            "until enough new motion has been seen"
        )
    return f"aligned over {time.overlap_s:.0f} s from {seen}: {figures}"
