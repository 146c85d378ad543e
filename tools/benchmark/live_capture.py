"""Cost of live capture for the loop: the same images from two network cameras and from memory."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from app.client.server_process import MeasurementError
from observer.evaluation.targets import Target
from observer.observer import Observer
from observer.opening import open_source
from observer.parameters import preset
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World
from observer.sources.cameras.source import CameraSource
from observer.sources.contract import LiveReport
from observer.types import Image, StereoFrame
from tools.benchmark.camera_streams import SIDES, camera_streams, to_and_fro

SCENARIO = "webcams"
RATE = 30.0
# Time per frame, and per stage, of a loop that cannot keep up with the cameras.
SLOW_S = 0.05
_STAGE_S = 0.005
# Two seconds of images, then the same backwards.
_PICTURES = 60
_JPEG_QUALITY = 85
# Live and in-memory turns alternate, because a noisy machine drifts within seconds.
_TURNS = 4
# At the start of a turn, matching has no previous frame, and caches are cold.
_WARMING_FRAMES = 5
_MOST_MS = 3.0
_PATIENCE_S = 10.0


@dataclass(frozen=True)
class Spread:
    """Distribution of one time over all frames, milliseconds.

    Attributes:
        p10: of the frames least disturbed by a busy machine.
    """

    p10: float
    median: float
    p95: float
    mean: float


@dataclass(frozen=True)
class Loop:
    """Figures of a loop over frames.

    Attributes:
        frames: observed frames, without those of the first moments.
        rate: frames per second.
        read_cpu_ms: CPU time of the loop's thread in ``read`` per frame, including calls that
            returned no frame.
        read_wall_ms: from the arrival of the pair (both images grabbed), or from the call if that
            was later, until ``read`` returned it: the time in ``read`` without waiting for the
            cameras.
        work_ms: from receiving the pair to the end of observing.
        cpu_ms: CPU time of the loop's process, all threads, for reading and observing a frame.
            Unlike ``work_ms``, it hardly depends on the machine's other load.
        latency_ms: from grabbing both images until the loop received them.
        troubles: how often the source reported trouble in place of a frame.
    """

    frames: int
    rate: float
    read_cpu_ms: Spread
    read_wall_ms: Spread
    work_ms: Spread
    cpu_ms: Spread
    latency_ms: Spread
    troubles: int

    @property
    def busy_ms(self) -> float:
        """Return the median time per frame for which the loop's thread is busy."""
        return self.read_cpu_ms.median + self.work_ms.median


@dataclass(frozen=True)
class CaptureFigures:
    """Figures of the measurement.

    Attributes:
        live, memory: the loop with the default parameters, fed by cameras and from memory.
        slow: the loop with cameras, which sleeps for ``SLOW_S`` instead of observing.
        tending: the same, but the cameras are tended between stages of it (``CameraSource.tend``),
            to decode the next pair meanwhile.
        skew_median_ms, skew_p95_ms: None if too few pairs came.
        pairs, dropped: as in ``LiveReport``, of all live turns.
    """

    image_size: tuple[int, int]
    camera_rate: float
    live: Loop
    memory: Loop
    slow: Loop
    tending: Loop
    skew_median_ms: float | None
    skew_p95_ms: float | None
    pairs: int
    dropped: int

    @property
    def added_ms(self) -> float:
        """Return the added busy time of the loop per frame from cameras, median."""
        return self.live.busy_ms - self.memory.busy_ms

    @property
    def added_cpu_ms(self) -> float:
        """Return the added CPU time per frame from cameras, median."""
        return self.live.cpu_ms.median - self.memory.cpu_ms.median

    @property
    def targets(self) -> tuple[Target, ...]:
        return (
            Target("added to the loop, ms per frame", None, _MOST_MS, self.added_ms,
                   self.live.frames),
            Target("the same in CPU time", None, _MOST_MS, self.added_cpu_ms,
                   self.live.frames),
            Target("read in a loop slower than the cameras, ms", None, _MOST_MS,
                   self.slow.read_wall_ms.median, self.slow.frames),
            Target("the same with the cameras served between stages", None, _MOST_MS,
                   self.tending.read_wall_ms.median, self.tending.frames),
        )  # fmt: skip

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return asdict(self) | {
            "added_ms": self.added_ms,
            "added_cpu_ms": self.added_cpu_ms,
            "targets": [target.as_dict() for target in self.targets],
        }


def capture_figures(
    *, seconds: float = 20.0, pictures: int = _PICTURES, say: Callable[[str], None] = lambda _: None
) -> CaptureFigures:
    """Measure the loop with two network cameras, with memory in their place, and a slow loop.

    Args:
        seconds: duration of the loop with cameras, and of the one from memory; each slow loop takes
            a third of it.
        pictures: number of different images to serve.
        say: receives a description of the current measurement.

    Raises:
        MeasurementError: too few frames came for any figure.
        SourceError: the streams could not be opened.
    """
    world = World(load_scenario(SCENARIO))
    say("rendering what the cameras will show")
    encoded = encoded_pairs(world, pictures)
    decoded = [tuple(_decoded(data) for data in pair) for pair in encoded]
    live, memory, slow, tending = _Notes(), _Notes(), _Notes(), _Notes()
    reports: list[LiveReport] = []
    turns = _TURNS if seconds >= 2 * _TURNS else 1
    observer = Observer(world.true_calibration, preset("default"))

    def observe(frame: StereoFrame) -> None:
        observer.observe(frame)

    with tempfile.TemporaryDirectory(prefix="dynamic-observer-benchmark-") as folder:
        write_pairs(Path(folder), encoded)
        with camera_streams(Path(folder), RATE) as addresses:
            for turn in range(turns):
                say(f"the loop with cameras and from memory, turn {turn + 1} of {turns}")
                observer.begin_segment()
                with _cameras(addresses, reports) as source:
                    _loop(source, seconds / turns, observe, live)
                observer.begin_segment()
                _loop(_Memory(decoded, RATE), seconds / turns, observe, memory)
            say("a loop slower than the cameras")
            with _cameras(addresses, reports) as source:
                _loop(source, seconds / 3, lambda _: time.sleep(SLOW_S), slow)
                _loop(source, seconds / 3, lambda _: _slow_stages(source), tending)
    last = reports[-2]
    height, width = decoded[0][0].shape[:2]
    return CaptureFigures(
        image_size=(width, height),
        camera_rate=RATE,
        live=live.figures(),
        memory=memory.figures(),
        slow=slow.figures(),
        tending=tending.figures(),
        skew_median_ms=None if last.skew_median_s is None else 1e3 * last.skew_median_s,
        skew_p95_ms=None if last.skew_p95_s is None else 1e3 * last.skew_p95_s,
        pairs=sum(report.pairs for report in reports[:-1]),
        dropped=sum(report.dropped for report in reports[:-1]),
    )


class _Memory:
    """Decoded images at a camera's rate; waits for the next one.

    Args:
        pairs: (H, W, 3) each.
    """

    def __init__(self, pairs: Sequence[tuple[Image, ...]], rate: float) -> None:
        self._pairs = pairs
        self._rate = rate
        self._began = time.monotonic()
        self._number = -1

    def read(self) -> StereoFrame:
        # Returns the newest, as cameras do; missed images are lost.
        newest = int((time.monotonic() - self._began) * self._rate)
        self._number = max(self._number + 1, newest)
        due = self._began + self._number / self._rate
        time.sleep(max(0.0, due - time.monotonic()))
        left, right = self._pairs[to_and_fro(self._number, len(self._pairs))]
        return StereoFrame(
            index=self._number,
            time=due,
            left=left,
            right=right,
            received=max(due, time.monotonic()),
            right_time=due,
        )


@dataclass
class _Notes:
    """Times of each frame of a loop, seconds, over all its turns."""

    read_cpu: list[float] = field(default_factory=list)
    read_wall: list[float] = field(default_factory=list)
    work: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)
    latency: list[float] = field(default_factory=list)
    seconds: float = 0.0
    troubles: int = 0

    def figures(self) -> Loop:
        if len(self.work) < 2:
            raise MeasurementError(
                f"only {len(self.work)} frames came within {self.seconds:.1f} s; measure longer, "
                f"or on a less busy machine"
            )
        return Loop(
            frames=len(self.work),
            rate=len(self.work) / self.seconds,
            read_cpu_ms=_spread(self.read_cpu),
            read_wall_ms=_spread(self.read_wall),
            work_ms=_spread(self.work),
            cpu_ms=_spread(self.cpu),
            latency_ms=_spread(self.latency),
            troubles=self.troubles,
        )


def _loop(
    frames: CameraSource | _Memory,
    seconds: float,
    work: Callable[[StereoFrame], None],
    notes: _Notes,
) -> None:
    """Read and process as the engine does, one frame after the other, and record the times."""
    seen, cpu, spent_before = 0, 0.0, time.process_time()
    began = asked = time.monotonic()
    while asked - began < seconds or seen < _WARMING_FRAMES:
        cpu_before = time.thread_time()
        item = frames.read()
        had = time.monotonic()
        cpu += time.thread_time() - cpu_before
        if not isinstance(item, StereoFrame):
            # A busy machine delays an image now and then; a source recovers from that by itself.
            notes.troubles += item.trouble is not None
            if had - asked > _PATIENCE_S:
                raise MeasurementError(f"no pair came within {_PATIENCE_S:g} s: {item.trouble}")
            continue
        work(item)
        done, spent = time.monotonic(), time.process_time()
        seen += 1
        if seen == _WARMING_FRAMES:
            began = done
        elif seen > _WARMING_FRAMES:
            notes.read_cpu.append(cpu)
            notes.read_wall.append(had - max(asked, item.received))
            notes.work.append(done - had)
            notes.cpu.append(spent - spent_before)
            notes.latency.append(had - item.received)
        cpu, asked, spent_before = 0.0, done, spent
    notes.seconds += asked - began


def _slow_stages(source: CameraSource) -> None:
    """Take as long as ``SLOW_S``, and tend the cameras between the stages."""
    until = time.monotonic() + SLOW_S
    while (left := until - time.monotonic()) > 0:
        time.sleep(min(left, _STAGE_S))
        source.tend()


@contextmanager
def _cameras(addresses: tuple[str, str], reports: list[LiveReport]) -> Iterator[CameraSource]:
    """Open both streams as one source in the ordinary way; add its report at the end."""
    with closing(open_source(",".join(addresses)).source) as source:
        assert isinstance(source, CameraSource)
        yield source
        reports.append(source.report())


def encoded_pairs(world: World, count: int) -> list[tuple[bytes, ...]]:
    """Return JPEG files of left and right, at the cameras' rate."""
    imager = StereoImager(world)
    quality = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY]
    return [
        tuple(
            cv2.imencode(".jpg", image, quality)[1].tobytes()
            for image in imager.pair(k, k / RATE)
        )
        for k in range(count)
    ]  # fmt: skip


def _decoded(data: bytes) -> Image:
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), np.uint8)


def write_pairs(folder: Path, encoded: Sequence[tuple[bytes, ...]]) -> None:
    """Write them as ``camera_streams`` serves them, into an empty folder."""
    for side, pictures in zip(SIDES, zip(*encoded, strict=True), strict=True):
        (folder / side).mkdir()
        for k, picture in enumerate(pictures):
            (folder / side / f"{k:06d}.jpg").write_bytes(picture)


def _spread(seconds: Sequence[float]) -> Spread:
    ms = 1e3 * np.asarray(seconds)
    p10, median, p95 = np.percentile(ms, [10, 50, 95]).tolist()
    return Spread(p10, median, p95, float(ms.mean()))
