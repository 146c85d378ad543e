"""Loop inside a running server: alone, with viewers, and as seen in a browser."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from statistics import mean
from typing import Any

from app.client.server_process import MeasurementError, RunningServer, running_server
from observer.evaluation.targets import Target
from tools.benchmark.browser import PageFigures, page_figures
from tools.benchmark.viewers import Drained, scene_viewer, stalled_viewer, viewers

# Seconds that a new client waits before it counts as never served.
_PATIENCE_S = 45.0
_FAST = 4.0
_SETTLING_S = 1.0
# Turns with and without the cloud alternate, because a noisy machine drifts within seconds.
_TURNS = 3
# Same window as the status's rates.
_RATE_WINDOW_S = 2.0
# Least share of its rate that the loop keeps with all viewers, and that viewers keep beside one
# that reads nothing. Rates of short measurements differ by some per cent in any case.
LEAST_WITH_VIEWERS, _LEAST_BESIDE_STALLED = 0.9, 0.9


@dataclass(frozen=True)
class DriveLateness:
    """Lateness of the drive loop against its deadlines, every 20 ms.

    Attributes:
        late_p99_ms, late_max_ms: over its last 1500 ticks (30 s); None before the first tick.
        priority: its scheduling priority: realtime, raised or normal.
    """

    late_p99_ms: float | None
    late_max_ms: float | None
    priority: str

    @property
    def words(self) -> str:
        """Describe it for people."""
        if self.late_p99_ms is None or self.late_max_ms is None:
            return f"not reported, priority {self.priority}"
        return (
            f"p99 {self.late_p99_ms:.2f} ms, max {self.late_max_ms:.2f} ms, "
            f"priority {self.priority}"
        )


@dataclass(frozen=True)
class LoopRates:
    """Frames per second observed by the engine at one playback rate.

    Attributes:
        playback_rate: 1 is the source's recorded rate.
        alone, with_viewers: unique frames per second without and with the viewers.
        viewers: their number. messages: total they received, so that idle viewers cannot pass
            for served ones.
        drive: the drive loop at the end of the time with viewers; None without a drive process.
        recorded: the same at the end of an equal time with viewers and a run being recorded.
    """

    playback_rate: float
    alone: float
    with_viewers: float
    viewers: int
    scene_messages: int
    observation_messages: int
    image_messages: int
    failures: tuple[str, ...]
    drive: DriveLateness | None
    recorded: DriveLateness | None

    @property
    def ratio(self) -> float:
        """Return the rate with viewers over the rate alone."""
        return self.with_viewers / self.alone if self.alone else 0.0


@dataclass(frozen=True)
class DenseCloudRates:
    """Cost of the dense cloud for the loop, including everything that one 3D scene needs.

    Attributes:
        playback_rate: 1 is the source's recorded rate.
        without, watched: unique frames per second without and with one watching scene.
        clouds_per_s: rate while it is watched.
        age_s: mean time since reception of the pair behind the newest cloud.
        median_ms: time to make one cloud. coarseness: downscaling factor for matching.
        failures: failures of the watching client.
    """

    playback_rate: float
    without: float
    watched: float
    clouds_per_s: float
    age_s: float | None
    median_ms: float | None
    coarseness: int | None
    failures: tuple[str, ...]

    @property
    def ratio(self) -> float:
        """Return the rate while watched over the rate without."""
        return self.watched / self.without if self.without else 0.0


@dataclass(frozen=True)
class ServedRates:
    """Per second: frames observed, and messages that all reading viewers together received."""

    frames: float
    observations: float
    images: float


@dataclass(frozen=True)
class StalledRates:
    """Rates that viewers receive, without and beside one that reads nothing.

    Attributes:
        viewers: number of those that read. without: mean of before and after.
        failures: of all of them.
    """

    viewers: int
    without: ServedRates
    beside: ServedRates
    failures: tuple[str, ...]

    @property
    def ratio(self) -> float:
        """Return the least of the three rates beside it over those without it."""
        pairs = zip(asdict(self.beside).values(), asdict(self.without).values(), strict=True)
        return min(beside / without if without else 0.0 for beside, without in pairs)


@dataclass(frozen=True)
class ServedFigures:
    """All figures measured from outside; ``page`` is a sentence if it could not be measured."""

    rates: tuple[LoopRates, ...]
    stalled: StalledRates
    dense_cloud: DenseCloudRates
    page: PageFigures | str

    @property
    def targets(self) -> tuple[Target, ...]:
        """Return the targets."""
        rates = [
            Target(
                f"loop's rate with {each.viewers} viewers, played at {each.playback_rate:g} x, "
                f"relative to that alone",
                LEAST_WITH_VIEWERS,
                None,
                each.ratio,
                each.observation_messages,
            )
            for each in self.rates
        ]
        stalled = Target(
            f"what {self.stalled.viewers} viewers receive beside a stalled one, relative to that "
            "without it",
            _LEAST_BESIDE_STALLED,
            None,
            self.stalled.ratio,
            self.stalled.viewers,
        )
        return (*rates, stalled)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "targets": [target.as_dict() for target in self.targets],
            "stalled": asdict(self.stalled) | {"ratio": self.stalled.ratio},
            "loop": [asdict(each) | {"ratio": each.ratio} for each in self.rates],
            "dense_cloud": asdict(self.dense_cloud) | {"ratio": self.dense_cloud.ratio},
            "page": asdict(self.page) if isinstance(self.page, PageFigures) else self.page,
        }


def served_figures(
    source: str, *, seconds: float, viewer_count: int, say: Callable[[str], None]
) -> ServedFigures:
    """Start a server twice and measure it.

    Args:
        source: source to serve. seconds: length of each measurement.
        viewer_count: protocol clients in the measurement with viewers.
        say: receives a description of the current measurement, for people who wait.

    Raises:
        MeasurementError: the server did not start, or refused a request.
    """
    say("a page in Chromium, from the server's start")
    with running_server(source) as server:
        page = page_figures(server, source, seconds, _PATIENCE_S)
    with running_server(source) as server:
        server.wait_for_frames()
        rates = tuple(
            _loop_rates(server, playback_rate, seconds, viewer_count, say)
            # At its recorded rate the loop may have time to spare; at four times it has none, so
            # that it cannot hide a cost of the viewers.
            for playback_rate in (1.0, _FAST)
        )
        stalled = _stalled_rates(server, seconds, viewer_count, say)
        dense_cloud = _dense_cloud_rates(server, _FAST, seconds, say)
    return ServedFigures(rates, stalled, dense_cloud, page)


def _loop_rates(
    server: RunningServer,
    playback_rate: float,
    seconds: float,
    viewer_count: int,
    say: Callable[[str], None],
) -> LoopRates:
    server.request("POST", "/api/playback", {"rate": playback_rate, "loop": True})
    say(f"the loop alone, playing at {playback_rate:g} x")
    # The two halves of "alone" enclose the measurement with viewers, because a noisy machine
    # drifts.
    before = observed_rate(server, seconds / 2)
    say(f"the loop with {viewer_count} viewers, playing at {playback_rate:g} x")
    with viewers(server, viewer_count) as drained:
        with_viewers = observed_rate(server, seconds)
        drive = drive_lateness(server)
        say(f"the drive loop beside viewers and a recording, playing at {playback_rate:g} x")
        with _recorded_run(server):
            time.sleep(seconds)
            recorded = drive_lateness(server)
    # A run starts at the source's beginning, and keeps its playback.
    after = observed_rate(server, seconds / 2)
    return LoopRates(
        playback_rate,
        (before + after) / 2,
        with_viewers,
        viewer_count,
        drained.scene,
        drained.observations,
        drained.images,
        tuple(drained.failures),
        drive,
        recorded,
    )


def _stalled_rates(
    server: RunningServer, seconds: float, viewer_count: int, say: Callable[[str], None]
) -> StalledRates:
    # At this rate the loop has time to spare, so that it is the server that may hold viewers up.
    server.request("POST", "/api/playback", {"rate": 1.0, "loop": True})
    say(f"{viewer_count} viewers without and beside a stalled one")
    with viewers(server, viewer_count) as drained:
        before = _served_rates(server, drained, seconds / 2)
        with stalled_viewer(server) as stalled:
            beside = _served_rates(server, drained, seconds)
        after = _served_rates(server, drained, seconds / 2)
    without = ServedRates(
        (before.frames + after.frames) / 2,
        (before.observations + after.observations) / 2,
        (before.images + after.images) / 2,
    )
    failures = (*drained.failures, *stalled.failures)
    return StalledRates(viewer_count, without, beside, failures)


def _served_rates(server: RunningServer, drained: Drained, seconds: float) -> ServedRates:
    time.sleep(_SETTLING_S)
    first, first_at = _observed(server)
    observations, images = drained.observations, drained.images
    time.sleep(seconds)
    observations, images = drained.observations - observations, drained.images - images
    last, last_at = _observed(server)
    passed = last_at - first_at
    return ServedRates((last - first) / passed, observations / passed, images / passed)


@contextmanager
def _recorded_run(server: RunningServer) -> Iterator[None]:
    run = server.request("POST", "/api/runs", {"name": "measured", "record": "jpeg"})
    yield
    # A run over a recording ends with the recording.
    with suppress(MeasurementError):
        server.request("POST", f"/api/runs/{run['id']}/stop")


def drive_lateness(server: RunningServer) -> DriveLateness | None:
    """Return how late the drive loop is; None without a drive process."""
    loop = server.request("GET", "/api/robots")["loop"]
    if loop is None:
        return None
    return DriveLateness(loop["late_p99_ms"], loop["late_max_ms"], loop["priority"])


def _dense_cloud_rates(
    server: RunningServer, playback_rate: float, seconds: float, say: Callable[[str], None]
) -> DenseCloudRates:
    server.request("POST", "/api/playback", {"rate": playback_rate, "loop": True})
    say(f"the loop with and without the dense cloud, playing at {playback_rate:g} x")
    turn_s = max(seconds / _TURNS, _RATE_WINDOW_S)
    without, watched, dense, failures = [], [], [], []
    for _ in range(_TURNS):
        without.append(observed_rate(server, turn_s))
        with scene_viewer(server) as drained:
            watched.append(observed_rate(server, turn_s))
            dense.append(server.request("GET", "/api/status")["dense_stereo"])
        failures += drained.failures
    ages = [each["age_s"] for each in dense if each["age_s"] is not None]
    costs = [each["median_ms"] for each in dense if each["median_ms"] is not None]
    return DenseCloudRates(
        playback_rate,
        mean(without),
        mean(watched),
        mean(each["per_s"] for each in dense),
        mean(ages) if ages else None,
        mean(costs) if costs else None,
        dense[-1]["coarseness"],
        tuple(failures),
    )


def observed_rate(server: RunningServer, seconds: float) -> float:
    """Return unique frames per second over ``seconds``, from the engine's own count of
    observations.
    """
    time.sleep(_SETTLING_S)
    first, first_at = _observed(server)
    time.sleep(seconds)
    last, last_at = _observed(server)
    return (last - first) / (last_at - first_at)


def _observed(server: RunningServer) -> tuple[int, float]:
    status = server.request("GET", "/api/status")
    return int(status["frames_observed"]), time.monotonic()
