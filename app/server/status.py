"""The server's state as one object, for ``GET /api/status`` and the live socket."""

from __future__ import annotations

from dataclasses import replace

from app.contract.status import (
    CalibrationReference,
    CameraStatus,
    Drops,
    EngineStatus,
    MountStatus,
    Rates,
    RunReference,
    SourceStatus,
    Status,
)
from app.contract.values import filled, known, word
from app.server.server import Server
from app.server.source.camera_match import camera_match_warnings
from observer.opening import shown_spec
from observer.version import library_version


def status(server: Server) -> Status:
    """Return everything that the page shows about the server."""
    health = server.engine.health
    telemetry = server.telemetry
    dense = telemetry.dense(server.clock())
    state = server.source.state
    run, before = server.runs.current, server.source.before
    calibration = server.source.wanted.calibration
    return Status(
        engine=filled(
            EngineStatus,
            health,
            state=word(state.state),
            reason=state.reason or state.preparing,
            heartbeat_age_s=_rounded(health.heartbeat_age_s),
        ),
        source=None
        if state.source is None
        else filled(
            SourceStatus,
            state.source,
            name=server.source.name,
            before=None if before is None else shown_spec(before.source),
        ),
        playback=state.playback,
        camera=known(CameraStatus, state.camera),
        run=known(RunReference, run),
        reruns=server.runs.reruns.facts(),
        recording=state.recording,
        truth=state.truth,
        live=state.live,
        mount=known(MountStatus, state.mount),
        ageing=state.ageing,
        calibrating=server.calibrating.session.facts(),
        calibration=known(CalibrationReference, calibration),
        to_calibrate=server.source.to_calibrate,
        parameters_revision=server.parameters.current.revision,
        driving_revision=server.parameters.current.driving_revision,
        rates=Rates(round(telemetry.rate(server.clock()), 2)),
        dense_stereo=replace(dense, per_s=round(dense.per_s, 2)),
        frames_observed=telemetry.frames_observed,
        latency_ms=telemetry.latency,
        timings_ms=telemetry.timings_ms,
        ego_motion=None if server.source.latest is None else server.source.latest.ego_motion,
        drops=Drops(
            frames_skipped=telemetry.frame_skips,
            observations_lost=health.observations_lost,
            live_messages_dropped=telemetry.live_messages_dropped,
            writes_dropped=server.shared.writer.dropped,
        ),
        skipped=telemetry.skipped,
        viewers=server.viewers,
        has_truth=state.has_truth,
        warnings=warnings(server),
        version=library_version(),
    )


def observation_age_s(server: Server) -> float | None:
    """Return the time since reception of the newest observation's frame; None before the first."""
    latest = server.source.latest
    return None if latest is None else round(max(0.0, server.clock() - latest.received), 3)


def warnings(server: Server) -> list[str]:
    """Return the present problems, one sentence each."""
    return [*server.shared.warnings, *server.driving.warnings, *_trouble(server)]


def _trouble(server: Server) -> list[str]:
    ageing, recording = server.source.state.ageing, server.source.state.recording
    vergence = None if ageing is None else ageing.vergence
    troubles = (
        server.shared.writer.trouble,
        server.source.state.preparing,
        server.source.state.truth_note,
        server.telemetry.dense_trouble,
        None if ageing is None else ageing.rows.warning,
        None if recording is None else recording.trouble,
        None if vergence is None or vergence.status != "drifted" else vergence.sentence,
    )
    bound = camera_match_warnings(server.source.state, server.source.wanted.calibration)
    notes = server.source.state.calibration_notes
    failing = server.source.state.troubles
    return [*bound, *notes, *failing, *(trouble for trouble in troubles if trouble is not None)]


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
