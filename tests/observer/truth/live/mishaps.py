"""Faults between a motion-capture server and us, and a stream that suffers them."""

from __future__ import annotations

import heapq
import itertools
import random
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from observer.geometry import Pose

Poses = Callable[[float], Mapping[str, "Pose | None"]]


@dataclass
class Mishaps:
    """Planted faults; may be changed while a stream runs.

    Attributes:
        offset_s: the server's clock minus the host's at ``since``. drift_ppm: how much faster it
            runs. since: host's monotonic clock.
        delay_s: of every message. jitter_s: mean of what comes on top, exponentially distributed.
        drop: share of messages that are never sent. unseen: share of poses sent as all zeros.
        repeat: poses repeat exactly. millimetres: send mm instead of metres.
        tick_hz: stamps count at this rate instead of seconds; None: seconds.
    """

    offset_s: float = 0.0
    drift_ppm: float = 0.0
    since: float = field(default_factory=time.monotonic)
    delay_s: float = 0.0
    jitter_s: float = 0.0
    drop: float = 0.0
    unseen: float = 0.0
    repeat: bool = False
    millimetres: bool = False
    tick_hz: float | None = None

    def stamp(self, now: float) -> float:
        """Return what the server's clock shows, seconds or ticks."""
        seconds = now + self.offset_s + self.drift_ppm * 1e-6 * (now - self.since)
        return seconds if self.tick_hz is None else float(round(seconds * self.tick_hz))


@dataclass(frozen=True)
class Sent:
    """One body's pose in transit. numbers: x y z qx qy qz qw, metres."""

    name: str
    frame: int
    stamp: float
    numbers: tuple[float, ...]


class Stream:
    """Sends poses at a rate until it is stopped.

    Args:
        poses: bodies at the host's monotonic clock; None: not seen.
        send: is called with everything due at one instant.
    """

    def __init__(
        self,
        poses: Poses,
        send: Callable[[list[Sent]], None],
        mishaps: Mishaps,
        *,
        rate_hz: float = 100.0,
        noise_m: float = 5e-5,
        seed: int = 0,
    ) -> None:
        self._poses, self._send, self._mishaps = poses, send, mishaps
        self._interval, self._noise_m = 1 / rate_hz, noise_m
        self._random = random.Random(seed)
        self._ending = threading.Event()
        self._last: dict[str, tuple[float, ...]] = {}
        self.trouble: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="mocap stream", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop; raise any error the stream had."""
        self._ending.set()
        self._thread.join()
        if self.trouble is not None:
            raise self.trouble

    def _run(self) -> None:
        try:
            self._stream()
        except Exception as error:  # noqa: BLE001 (told to whoever stops us)
            self.trouble = error

    def _stream(self) -> None:
        order = itertools.count()
        waiting: list[tuple[float, int, list[Sent]]] = []
        latest_due = 0.0
        tick = time.monotonic()
        frame = 0
        while not self._ending.is_set():
            now = time.monotonic()
            if now >= tick:
                # Cameras expose on schedule, however late this machine sends.
                due, tick = tick, max(tick + self._interval, now - 1.0)
                frame += max(1, round((tick - due) / self._interval))
                if self._random.random() >= self._mishaps.drop:
                    jitter = self._mishaps.jitter_s
                    extra = self._random.expovariate(1 / jitter) if jitter else 0.0
                    # A single connection: nothing overtakes.
                    latest_due = max(latest_due, now + self._mishaps.delay_s + extra)
                    heapq.heappush(waiting, (latest_due, next(order), self._sample(due, frame)))
            while waiting and waiting[0][0] <= now:
                self._send(heapq.heappop(waiting)[2])
            until = min(tick, waiting[0][0]) if waiting else tick
            self._ending.wait(max(0.0, until - time.monotonic()))

    def _sample(self, now: float, frame: int) -> list[Sent]:
        stamp = self._mishaps.stamp(now)
        scale = 1000.0 if self._mishaps.millimetres else 1.0
        return [
            Sent(name, frame, stamp, self._numbers(name, pose, scale))
            for name, pose in self._poses(now).items()
        ]

    def _numbers(self, name: str, pose: Pose | None, scale: float) -> tuple[float, ...]:
        if self._mishaps.repeat and name in self._last:
            return self._last[name]
        if pose is None or self._random.random() < self._mishaps.unseen:
            return (0.0,) * 7
        w, x, y, z = pose.quaternion_wxyz
        position = [
            scale * (each + self._random.gauss(0, self._noise_m)) for each in pose.translation
        ]
        self._last[name] = (*position, x, y, z, w)
        return self._last[name]
