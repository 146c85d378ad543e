"""``/metrics``: the figures of the status in the format of Prometheus."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial

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
    """Counters and gauges; like everything, they need the token, so give Prometheus a Bearer."""
    registry = CollectorRegistry(auto_describe=False)
    registry.register(_StatusCollector(server))
    return Response(generate_latest(registry), media_type=CONTENT_TYPE_PLAIN_0_0_4)


class _StatusCollector(Collector):
    """Collector that reads one status per scrape; nothing is counted twice."""

    def __init__(self, server: Server) -> None:
        self._server = server

    def collect(self) -> Iterator[Metric]:
        now = status(self._server)
        dense, latency = now.dense_stereo, now.latency_ms
        yield _counter(
            "frames_observed", "Frames processed since the server started.", now.frames_observed
        )
        yield _gauge(
            "frames_per_second",
            "Unique frames processed per second, recently.",
            now.rates.unique_frames_per_s,
        )
        yield _gauge(
            "dense_stereo_per_second",
            "Clouds or disparity views made per second, recently; 0 while nobody watches.",
            dense.per_s,
        )
        if dense.age_s is not None:
            yield _gauge(
                "dense_stereo_age_seconds",
                "Age of the newest one: time since its pair was received.",
                dense.age_s,
            )
        yield _counter(
            "engine_restarts", "How often the engine process was replaced.", now.engine.restarts
        )
        states = {each.value: float(now.engine.state == each.value) for each in EngineState}
        yield _gauge("engine_state", "1 for the current state.", states, "state")
        yield _counter("drops", "Number of dropped items, by kind.", vars(now.drops), "kind")
        yield _gauge("stage_ms", "Recent median time of each stage.", now.timings_ms, "stage")
        painted = {"median": latency.median, "p95": latency.p95}
        yield _gauge(
            "painted_latency_ms",
            "From reception to the page's acknowledgement after painting.",
            {quantile: ms for quantile, ms in painted.items() if ms is not None},
            "quantile",
        )
        yield _gauge("viewers", "Open pages.", now.viewers)
        yield from self._driving()

    def _driving(self) -> Iterator[Metric]:
        driving = self._server.driving
        yield _gauge(
            "drive_alive",
            "1 while the drive process is running.",
            float(driving.health.alive),
        )
        yield _counter(
            "drive_restarts", "How often the drive process was replaced.", driving.health.restarts
        )
        late = driving.loop_late_p99_ms
        if late is not None:
            yield _gauge("drive_late_p99_ms", "Recent lateness of the drive loop's ticks.", late)
        armed = {str(role): float(driving.is_driven(role)) for role in ROLES}
        yield _gauge("robot_armed", "1 while its motors are on.", armed, "role")


def _metric(
    kind: type[CounterMetricFamily | GaugeMetricFamily],
    name: str,
    help: str,
    values: float | Mapping[str, float],
    label: str | None = None,
) -> Metric:
    """Make one metric: a value, or several by their ``label``."""
    metric = kind(f"dynamic_observer_{name}", help, labels=[] if label is None else [label])
    if isinstance(values, Mapping):
        for key, value in values.items():
            metric.add_metric([key], value)
    else:
        metric.add_metric([], values)
    return metric


_counter = partial(_metric, CounterMetricFamily)
_gauge = partial(_metric, GaugeMetricFamily)
