"""The station's state as one plain dictionary: ``GET /api/status`` and the live socket's."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from app.server.service import Station
from app.server.source.camera_match import binding_warnings
from observer.version import library_version


def status(station: Station) -> dict[str, Any]:
    """Everything the page shows about the server; finite numbers, no arrays."""
    health = station.engine.health
    telemetry = station.telemetry
    dense = telemetry.dense(station.clock())
    state = station.state
    run = station.run
    calibration = station.wanted.calibration
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
        "calibrating": station.calibrating.facts(),
        "calibration": None
        if calibration is None
        else {"id": calibration.id, "name": calibration.name},
        "parameters_revision": station.parameters.current.revision,
        "guard_revision": station.parameters.current.guard_revision,
        "rates": {"unique_frames_per_s": round(telemetry.rate(station.clock()), 2)},
        "dense_stereo": asdict(dense) | {"per_s": round(dense.per_s, 2)},
        "frames_observed": telemetry.frames_observed,
        "latency_ms": asdict(telemetry.latency),
        "timings_ms": telemetry.timings_ms,
        "ego_motion": None if station.latest is None else station.latest.ego_motion,
        "drops": {
            "frames_skipped": telemetry.frame_skips,
            "observations_lost": health.observations_lost,
            "live_messages_dropped": telemetry.live_messages_dropped,
            "writes_dropped": station.writer.dropped,
        },
        "skipped": telemetry.skipped,
        "viewers": station.viewers,
        "has_truth": state.has_truth,
        "warnings": [*station.warnings, *station.driving.warnings, *_trouble(station)],
        "version": library_version(),
    }


def observation_age_s(station: Station) -> float | None:
    """Since the newest observation's frame was received; None before the first."""
    latest = station.latest
    return None if latest is None else round(max(0.0, station.clock() - latest.received), 3)


def _trouble(station: Station) -> list[str]:
    ageing = station.state.ageing or {}
    drift, vergence = ageing.get("rows") or {}, ageing.get("vergence") or {}
    troubles = (
        station.writer.trouble,
        station.telemetry.dense_trouble,
        drift.get("warning"),
        (station.state.recording or {}).get("trouble"),
        vergence.get("sentence") if vergence.get("status") == "drifted" else None,
    )
    bound = binding_warnings(station.state, station.wanted.calibration)
    return [*bound, *(trouble for trouble in troubles if trouble is not None)]


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
