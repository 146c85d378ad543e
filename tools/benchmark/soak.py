"""Soak: a server on one busy day after another, and what its processes hold every evening.

Each day somebody opens pages, drives a robot, records a run while parameters change, downloads its
report, plays a recording and leaves. Samples are taken when all have left and the cameras are
observed again, so that equal states are compared.
"""

from __future__ import annotations

import contextlib
import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from typing import Any

import psutil

from app.client.operator_socket import OperatorSocket
from app.client.server_api import ServerApi
from app.client.server_process import MeasurementError, RunningServer
from observer.errors import DynamicObserverError
from tools.benchmark.process_growth import ProcessUse, Slope, grows, slope, steady_use
from tools.benchmark.soak_lab import ROLE, Lab, running_lab
from tools.benchmark.viewers import viewers

# Caches, pools and the allocator's memory for each thread fill for half an hour: in a soak of
# 34 min on a busy machine nothing grew any more after the 28th minute.
_WARM_UP = 0.5
MOST_MB_PER_HOUR = 1.0
_VIEWERS, _PICTURES = 3, 60
_PROGRAMME = "square_obstacle"
# Downloaded for each day's first run.
FILES = ("report", "speeds?format=csv", "export?format=zip", "chart")
_CHANGES = itertools.cycle(
    ({"obstacles.coast_s": 0.8}, {"klt_tracking.window_px": 15}, {"guard.acceleration_mps2": 0.5})
)
_CHANGE_INTERVAL_S = 1.0
# Time until what the last viewers leave behind is released.
_SETTLING_S = 2.0
_CONNECTED_WITHIN_S = 3.0


@dataclass(frozen=True)
class Evening:
    """Sample at the end of a day.

    Attributes:
        hours: since the soak began. use: what each process holds, by its name.
        processes: number of the server's processes, itself included.
    """

    hours: float
    use: dict[str, ProcessUse]
    processes: int


@dataclass(frozen=True)
class Growth:
    """Growth of one process after the warm-up.

    Attributes:
        memory: slope in MiB per hour; None if the soak was too short.
        threads_grow, descriptors_grow: see ``process_growth.grows``.
    """

    process: str
    memory: Slope | None
    threads_grow: bool
    descriptors_grow: bool

    @property
    def held(self) -> bool | None:
        """Return whether nothing grew beyond its limit; None if the soak was too short to tell."""
        if self.threads_grow or self.descriptors_grow:
            return False
        return None if self.memory is None else self.memory.within(MOST_MB_PER_HOUR)


@dataclass(frozen=True)
class SoakFigures:
    """Figures of a soak.

    Attributes:
        evenings: all samples. warm_up: number of the first ones that are not judged.
        refusals: what the server refused, with counts: an obstacle in the way is not its fault,
            but a soak in which everything was refused shows nothing.
        log_mb, tracebacks: of the server's log.
    """

    evenings: tuple[Evening, ...]
    warm_up: int
    runs: int
    refusals: dict[str, int]
    log_mb: float
    tracebacks: int

    @property
    def growths(self) -> tuple[Growth, ...]:
        """Return the growth of each process."""
        judged = self.evenings[self.warm_up :]
        hours = [each.hours for each in judged]

        def growth(name: str) -> Growth:
            uses = [each.use[name] for each in judged]
            return Growth(
                name,
                slope(hours, [use.memory_mb for use in uses]),
                grows([use.threads for use in uses]),
                grows([use.descriptors for use in uses]),
            )

        return tuple(growth(name) for name in self.evenings[0].use)

    @property
    def processes_grow(self) -> bool:
        """Return whether the number of processes grew."""
        return grows([each.processes for each in self.evenings[self.warm_up :]])

    @property
    def failed(self) -> bool:
        """Return whether anything grew beyond its limit."""
        return self.processes_grow or any(each.held is False for each in self.growths)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "evenings": [asdict(each) for each in self.evenings],
            "warm_up": self.warm_up,
            "runs": self.runs,
            "refusals": self.refusals,
            "log_mb": self.log_mb,
            "tracebacks": self.tracebacks,
            "growth": [asdict(each) | {"held": each.held} for each in self.growths],
            "processes_grow": self.processes_grow,
            "failed": self.failed,
        }


def soak_figures(
    *,
    minutes: float,
    run_s: float,
    least_days: int = 1,
    files: Sequence[str] = FILES,
    pictures: int = _PICTURES,
    say: Callable[[str], None] = lambda _: None,
) -> SoakFigures:
    """Start a server and keep it busy.

    Args:
        minutes: duration. run_s: duration of each run, of which there are two a day; the rest of
            the day takes about half a minute. least_days: minimum number, however long they take.
        files: downloaded every day. pictures: number of different pairs that cameras show.
        say: receives one line a day.

    Raises:
        MeasurementError: the server did not start, refused what it must not refuse, or lost a
            process. OSError: the system has no ``/proc``.
    """
    with running_lab(pictures) as lab:
        server = lab.server
        day = _Day(lab, run_s, files)
        pids = _pids(server)
        evenings: list[Evening] = []
        began = time.monotonic()
        while len(evenings) < least_days or time.monotonic() < began + 60 * minutes:
            day.spend()
            if _pids(server) != pids:
                raise MeasurementError(f"a process was lost: {pids} are {_pids(server)} by now")
            evening = Evening(
                (time.monotonic() - began) / 3600, steady_use(pids), _process_count(server)
            )
            evenings.append(evening)
            say(evening_line(evening))
        log = (server.data / "server.log").read_text(errors="replace")
    return SoakFigures(
        tuple(evenings),
        int(_WARM_UP * len(evenings)),
        day.runs,
        day.refusals,
        len(log) / 1e6,
        log.count("Traceback (most recent call last)"),
    )


def evening_line(evening: Evening) -> str:
    """Describe a sample in one line."""
    summary = "; ".join(
        f"{name} {use.memory_mb:.1f} MB, {use.threads} threads, {use.descriptors} descriptors"
        for name, use in evening.use.items()
    )
    return f"{60 * evening.hours:.1f} min: {summary}; {evening.processes} processes"


def _pids(server: RunningServer) -> dict[str, int]:
    engine = server.request("GET", "/api/status")["engine"]["pid"]
    drive = server.request("GET", "/api/robots")["process"]["pid"]
    return {"web": server.pid, "engine": engine, "drive": drive}


def _process_count(server: RunningServer) -> int:
    return 1 + len(psutil.Process(server.pid).children(recursive=True))


@dataclass
class _Day:
    """Work of one day.

    Attributes:
        runs: recorded so far. refusals: see ``SoakFigures``.
    """

    lab: Lab
    run_s: float
    files: Sequence[str] = FILES
    runs: int = 0
    refusals: dict[str, int] = field(default_factory=dict)

    @property
    def server(self) -> RunningServer:
        return self.lab.server

    def spend(self) -> None:
        """Do all of it, and leave everything as it was found in the morning."""
        with viewers(self.server, _VIEWERS) as drained:
            run = self._record(drive=True)
            for file in self.files:
                self.lab.download(f"/api/runs/{run}/{file}")
            recording = self.server.data / "runs" / run / "recording.mcap"
            self.lab.play(str(recording))
            # A run over a recording ends with it.
            with contextlib.suppress(MeasurementError):
                self.server.request("DELETE", f"/api/runs/{self._record(drive=False)}")
            self.lab.play(self.lab.source)
        # Days of recordings would fill the disk.
        for path in self.server.data.rglob("recording.mcap"):
            path.unlink(missing_ok=True)
        if drained.failures or not (drained.scene and drained.observations and drained.images):
            raise MeasurementError(f"viewers were not served: {drained}")
        time.sleep(_SETTLING_S)

    def _record(self, *, drive: bool) -> str:
        """Record a run and return its id."""
        begin = {"name": "soak", "record": "jpeg"}
        run: str = self.server.request("POST", "/api/runs", begin)["id"]
        until = time.monotonic() + self.run_s
        with self._driven() if drive else contextlib.nullcontext():
            while time.monotonic() < until:
                # A page that is opened and closed again.
                with viewers(self.server, 1):
                    self.server.request("PATCH", "/api/parameters", next(_CHANGES))
                    time.sleep(_CHANGE_INTERVAL_S)
        self.server.request("POST", f"/api/runs/{run}/stop")
        self.runs += 1
        return run

    @contextmanager
    def _driven(self) -> Iterator[None]:
        """Drive the obstacle during the block, as far as it may be driven."""
        api = ServerApi(f"http://127.0.0.1:{self.server.port}", self.server.token)
        try:
            with OperatorSocket(api) as socket:
                with self._refusable():
                    self._wait_for_robot()
                    lease = socket.take(ROLE, takeover=True)
                    api.post("robots", ROLE, "arm", body={"lease": lease})
                    start = {"name": _PROGRAMME, "leases": {ROLE: lease}}
                    api.post("robots", "programme", body=start)
                yield
                socket.release()
        finally:
            api.close()

    def _wait_for_robot(self) -> None:
        """Wait until it is connected; a run begins with the source, and so with its robots."""
        until = time.monotonic() + _CONNECTED_WITHIN_S
        while time.monotonic() < until:
            robot = self.server.request("GET", "/api/robots")["robots"][ROLE]
            if robot is not None and robot["state"] == "disarmed":
                return
            time.sleep(0.1)

    @contextmanager
    def _refusable(self) -> Iterator[None]:
        try:
            yield
        except DynamicObserverError as error:
            self.refusals[str(error)] = self.refusals.get(str(error), 0) + 1


def sampled(evenings: Sequence[Evening], most: int) -> list[Evening]:
    """Return at most ``most`` samples, evenly spread, the first and the last among them."""
    if len(evenings) <= most:
        return list(evenings)
    step = (len(evenings) - 1) / (most - 1)
    return [evenings[round(k * step)] for k in range(most)]
