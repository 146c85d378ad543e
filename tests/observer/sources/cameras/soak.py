"""A soak test run by hand: minutes of random cuts and stalls, then a check for leaks.

    python -m tests.observer.sources.cameras.soak --minutes 10

Two real streams pass through a proxy each, which stalls, cuts, resets, corrupts, refuses and
delays them at random. It prints the reading process's descriptors, threads, processes and
memory every half minute and at the end, and fails if any of them grew.
"""

from __future__ import annotations

import argparse
import os
import random
import sys
import threading
import time

import numpy as np
import psutil

from observer.sources.cameras.source import CameraSource
from observer.sources.cameras.spec import parse_urls
from observer.types import StereoFrame

from .fault_proxy import FaultProxy
from .video_server import VideoServer, url_of
from .watching import grabbers

_TELL_EACH_S = 30.0
_WARM_S = 20.0
_FLAT_MB_PER_H = 60.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--size", default="320x240")
    arguments = parser.parse_args()
    if not soak(arguments.minutes * 60.0, arguments.seed, arguments.size):
        sys.exit("something grew")


def soak(seconds: float, seed: int = 1, size: str = "320x240") -> bool:
    """Run it; return False if descriptors, threads, processes or memory grew."""
    process = psutil.Process()
    with (
        VideoServer(size) as left_server,
        VideoServer(size) as right_server,
        FaultProxy(left_server.port) as left,
        FaultProxy(right_server.port) as right,
    ):
        before = (_descriptors(process), threading.active_count())
        faults = _Faults([left, right], random.Random(seed))
        source = CameraSource(parse_urls(f"{url_of(left.port)},{url_of(right.port)}"))
        counts = {"pairs": 0, "troubles": 0}
        memory: list[tuple[float, float]] = []
        start, told = time.monotonic(), 0.0
        longest, latencies, late = 0.0, [], []
        worst = (0.0, "")
        last_received = start
        was_troubled = False
        while (now := time.monotonic()) - start < seconds:
            faults.step(now)
            item = source.read()
            longest = max(longest, time.monotonic() - now)
            if isinstance(item, StereoFrame):
                counts["pairs"] += 1
                latencies.append(time.monotonic() - item.received)
                last_received, was_troubled = item.received, False
            elif item.trouble is not None:
                if not was_troubled:
                    was_troubled = True
                    counts["troubles"] += 1
                    late.append(time.monotonic() - last_received)
                if now - last_received > worst[0]:
                    worst = (now - last_received, item.trouble)
            if now - start > _WARM_S and (not memory or now - memory[-1][0] > 1.0):
                memory.append((now, process.memory_info().rss / 1e6))
            if now - told > _TELL_EACH_S:
                told = now
                _tell(process, now - start, counts, source.report().reopened)
        report = source.report()
        source.close()
        left.heal()
        right.heal()
        left.cut()
        right.cut()
        time.sleep(1.0)
        after = (_descriptors(process), threading.active_count())
        processes = len(grabbers())
    times, sizes = np.array(memory).T if len(memory) > 2 else (np.arange(2.0), np.zeros(2))
    slope = float(np.polyfit(times, sizes, 1)[0]) * 3600.0
    _write(f"faults injected: {faults.count}")
    _write(f"pairs {report.pairs}, dropped {report.dropped}, reopened {report.reopened}")
    _write(f"longest read {longest * 1e3:.0f} ms")
    if latencies:
        _write(f"received to read, median {np.median(latencies) * 1e3:.1f} ms, "
               f"p99 {np.quantile(latencies, 0.99) * 1e3:.1f} ms")  # fmt: skip
    if late:
        _write(
            f"last received to trouble, median {np.median(late) * 1e3:.0f} ms, "
            f"p95 {np.quantile(late, 0.95) * 1e3:.0f} ms, worst {max(late) * 1e3:.0f} ms"
        )
    _write(f"longest without a pair {worst[0]:.1f} s, at its end: {worst[1]}")
    _write(f"descriptors before {before[0]}, after {after[0]}")
    _write(f"threads before {before[1]}, after {after[1]}; camera processes left {processes}")
    _write(f"memory {sizes[0]:.1f} to {sizes[-1]:.1f} MB, slope {slope:+.1f} MB/h")
    return after == before and processes == 0 and (seconds < 300.0 or slope < _FLAT_MB_PER_H)


class _Faults:
    """One fault at a time on one or both lines, healed after a while."""

    def __init__(self, lines: list[FaultProxy], chance: random.Random) -> None:
        self._lines = lines
        self._chance = chance
        self._next = time.monotonic() + 5.0
        self._healing = False
        self.count = 0

    def step(self, now: float) -> None:
        if now < self._next:
            return
        if self._healing:
            for line in self._lines:
                line.heal()
            self._next = now + self._chance.uniform(0.5, 4.0)
        else:
            self.count += 1
            for line in self._chance.sample(self._lines, self._chance.choice((1, 1, 2))):
                self._strike(line)
            self._next = now + self._chance.uniform(0.05, 2.0)
        self._healing = not self._healing

    def _strike(self, line: FaultProxy) -> None:
        match self._chance.choice(("stall", "cut", "reset", "refuse", "corrupt", "delay", "kill")):
            case "stall":
                line.stalled = True
            case "cut":
                line.cut()
            case "reset":
                line.cut(reset=True)
            case "refuse":
                line.refused = True
                line.cut()
            case "corrupt":
                line.corrupted = 0.01
            case "delay":
                line.delay_s = self._chance.uniform(0.01, 0.3)
            case "kill":
                victims = grabbers()
                if victims:
                    self._chance.choice(victims).kill()


def _descriptors(process: psutil.Process) -> int:
    # Of sockets count only listening ones: those of the test's own servers come and go.
    return sum(1 for each in process.net_connections() if each.status == "LISTEN") + sum(
        1 for fd in _links() if not fd.startswith("socket:")
    )


def _links() -> list[str]:
    links = []
    for fd in os.listdir("/proc/self/fd"):
        try:
            links.append(os.readlink(f"/proc/self/fd/{fd}"))
        except FileNotFoundError:
            continue
    return links


def _tell(process: psutil.Process, elapsed: float, counts: dict[str, int], reopened: int) -> None:
    _write(
        f"{elapsed:5.0f} s: {counts['pairs']} pairs, {counts['troubles']} troubles, "
        f"{reopened} reopened, {process.num_fds()} descriptors, {threading.active_count()} "
        f"threads, {len(grabbers())} camera processes, {process.memory_info().rss / 1e6:.1f} MB"
    )


def _write(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
