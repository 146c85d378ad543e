"""The server's state as one plain dictionary: ``GET /api/status`` and the live socket's."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from app.server.server import Server
from app.server.source.camera_match import camera_match_warnings
from observer.version import library_version


def status(server: Server) -> dict[str, Any]:
    """Everything the page shows about the server; finite numbers, no arrays."""
    health = server.engine.health
    telemetry = server.telemetry
    dense = telemetry.dense(server.clock())
    state = server.source.state
    run = server.runs.current
    calibration = server.source.wanted.calibration
    return {
        "engine": {
            "state": state.state.value,
            "reason": state.reason,
            "pid": health.pid,
            "generation": health.generation,
            "restarts": health.restarts,
            "heartbeat_age_s": _rounded(health.heartbeat_age_s),
        },
        "source": state.source,
        "playback": state.playback,
        "camera": state.camera,
        "run": None
        if run is None
        else {"id": run.id, "name": run.name, "started_at": run.started_at},
        "recording": state.recording,
        "truth": state.truth,
        "live": state.live,
        "mount": state.mount,
        "ageing": state.ageing,
        "calibrating": server.calibrating.session.facts(),
        "calibration": None
        if calibration is None
        else {"id": calibration.id, "name": calibration.name},
        "parameters_revision": server.parameters.current.revision,
        "guard_revision": server.parameters.current.guard_revision,
        "rates": {"unique_frames_per_s": round(telemetry.rate(server.clock()), 2)},
        "dense_stereo": asdict(dense) | {"per_s": round(dense.per_s, 2)},
        "frames_observed": telemetry.frames_observed,
        "latency_ms": asdict(telemetry.latency),
        "timings_ms": telemetry.timings_ms,
        "ego_motion": None if server.source.latest is None else server.source.latest.ego_motion,
        "drops": {
            "frames_skipped": telemetry.frame_skips,
            "observations_lost": health.observations_lost,
            "live_messages_dropped": telemetry.live_messages_dropped,
            "writes_dropped": server.shared.writer.dropped,
        },
        "skipped": telemetry.skipped,
        "viewers": server.viewers,
        "has_truth": state.has_truth,
        "warnings": [*server.shared.warnings, *server.driving.warnings, *_trouble(server)],
        "version": library_version(),
    }


def observation_age_s(server: Server) -> float | None:
    """Since the newest observation's frame was received; None before the first."""
    latest = server.source.latest
    return None if latest is None else round(max(0.0, server.clock() - latest.received), 3)


def _trouble(server: Server) -> list[str]:
    ageing = server.source.state.ageing or {}
    drift, vergence = ageing.get("rows") or {}, ageing.get("vergence") or {}
    troubles = (
        server.shared.writer.trouble,
        server.telemetry.dense_trouble,
        drift.get("warning"),
        (server.source.state.recording or {}).get("trouble"),
        vergence.get("sentence") if vergence.get("status") == "drifted" else None,
    )
    bound = camera_match_warnings(server.source.state, server.source.wanted.calibration)
    return [*bound, *(trouble for trouble in troubles if trouble is not None)]


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
