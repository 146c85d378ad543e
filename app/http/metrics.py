"""``/metrics``: the figures of the status in the format of Prometheus."""

from __future__ import annotations

from collections.abc import Iterator

from fastapi import APIRouter
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_PLAIN_0_0_4, generate_latest
from prometheus_client.registry import Collector, CollectorRegistry
from starlette.responses import Response

from app.contract.events import EngineState
from app.http.api.common import TheServer
from app.server import Server
from app.server.status import status
from observer.rig.rig import ROLES

router = APIRouter(include_in_schema=False)


@router.get("/metrics")
async def metrics(server: TheServer) -> Response:
    """Counters and gauges; behind the token like everything, so give Prometheus a Bearer."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_StatusCollector(server))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_PLAIN_0_0_4)


class _StatusCollector(Collector):
    """Collector that reads one status per scrape; nothing is counted twice."""

    def __init__(self, server: Server) -> None:
        self._server = server

    def collect(self) -> Iterator[Metric]:
        now = status(self._server)
        engine, drops, latency = now.engine, now.drops, now.latency_ms
        yield CounterMetricFamily(
            "dynamic_observer_frames_observed",
            "Frames observed since the server's start.",
            value=now.frames_observed,
        )
        yield GaugeMetricFamily(
            "dynamic_observer_frames_per_second",
            "Unique frames observed per second, lately.",
            value=now.rates.unique_frames_per_s,
        )
        dense = now.dense_stereo
        yield GaugeMetricFamily(
            "dynamic_observer_dense_stereo_per_second",
            "Clouds or disparity views made per second, lately; 0 while nobody watches.",
            value=dense.per_s,
        )
        if dense.age_s is not None:
            yield GaugeMetricFamily(
                "dynamic_observer_dense_stereo_age_seconds",
                "Since the reception of the pair that the newest one was made of.",
                value=dense.age_s,
            )
        yield CounterMetricFamily(
            "dynamic_observer_engine_restarts",
            "How often the engine process was replaced.",
            value=engine.restarts,
        )
        state = GaugeMetricFamily(
            "dynamic_observer_engine_state", "1 for the state it is in.", labels=["state"]
        )
        for each in EngineState:
            state.add_metric([each.value], float(engine.state == each.value))
        yield state
        lost = CounterMetricFamily(
            "dynamic_observer_drops", "What was left out, by kind.", labels=["kind"]
        )
        for kind, count in vars(drops).items():
            lost.add_metric([kind], count)
        yield lost
        stages = GaugeMetricFamily(
            "dynamic_observer_stage_ms", "Median of each stage, lately.", labels=["stage"]
        )
        for stage, ms in now.timings_ms.items():
            stages.add_metric([stage], ms)
        yield stages
        painted = GaugeMetricFamily(
            "dynamic_observer_painted_latency_ms",
            "From reception to the page's acknowledgement after painting.",
            labels=["quantile"],
        )
        for quantile, value in (("median", latency.median), ("p95", latency.p95)):
            if value is not None:
                painted.add_metric([quantile], value)
        yield painted
        yield GaugeMetricFamily("dynamic_observer_viewers", "Open pages.", value=now.viewers)
        yield from self._driving()

    def _driving(self) -> Iterator[Metric]:
        driving = self._server.driving
        yield GaugeMetricFamily(
            "dynamic_observer_drive_alive",
            "1 while there is a process that drives the robots.",
            value=float(driving.alive),
        )
        yield CounterMetricFamily(
            "dynamic_observer_drive_restarts",
            "How often the drive process was replaced.",
            value=driving.restarts,
        )
        late = driving.loop_late_p99_ms
        if late is not None:
            yield GaugeMetricFamily(
                "dynamic_observer_drive_late_p99_ms",
                "By how much the drive loop's ticks are late, lately.",
                value=late,
            )
        armed = GaugeMetricFamily(
            "dynamic_observer_robot_armed", "1 while its motors are on.", labels=["role"]
        )
        for role in ROLES:
            armed.add_metric([role], float(driving.is_driven(role)))
        yield armed
