"""Cost of recording for the loop: a server plays images from the disk, with and without runs."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import mean
from typing import Any

from app.client.server_process import MeasurementError, RunningServer, running_server
from observer.calibration.formats.opencv_file import calibration_text
from observer.evaluation.targets import Target
from observer.recording.payloads import RunFacts
from observer.recording.writer import RecordingWriter
from observer.simulation.imaging import StereoImager
from observer.simulation.scenarios import load_scenario
from observer.simulation.world import World
from observer.sources.contract import SourceInfo
from observer.types import StereoFrame
from tools.benchmark.camera_streams import to_and_fro
from tools.benchmark.served import observed_rate

SCENARIO = "webcams"
RATE = 30.0
MODES = ("jpeg", "lossless")
# At the recorded rate, and with no time to spare, so that waiting cannot hide a cost.
_PACES = (1.0, 4.0)
# Two seconds of images, then the same backwards: fewer images, without a jump.
_PICTURES = 60
# A run ends with the recording that it plays, so the recording is longer than one turn plus the
# time to start and query the run. Turns are short, because a noisy machine drifts within seconds.
_LONGEST_TURN_S = 5.0
_MARGIN_S = 3.0
_MOST_PER_S = 90.0
_LEAST_RATIO = 0.95
# Limit of the ratio of the maxima in the second and the first half of all recorded turns.
_MOST_GROWTH = 1.1


@dataclass(frozen=True)
class RecordingRates:
    """Rates at one playback rate and one way to store images.

    Attributes:
        playback_rate: 1 is the cameras' own rate. images: as in a run's ``record``.
        without, recorded: unique frames per second, means of all turns.
        mb_per_s: written to the file. dropped: messages dropped because the disk was too slow.
    """

    playback_rate: float
    images: str
    without: float
    recorded: float
    mb_per_s: float
    dropped: int

    @property
    def ratio(self) -> float:
        """Return the recorded rate over the rate without recording."""
        return self.recorded / self.without if self.without else 0.0


@dataclass(frozen=True)
class RecordingFigures:
    """Figures of the measurement.

    Attributes:
        memory_mb: memory of the engine at the end of each recorded turn, in order; empty if the
            system does not report it.
        minutes: total duration.
    """

    image_size: tuple[int, int]
    rates: tuple[RecordingRates, ...]
    memory_mb: tuple[float, ...]
    minutes: float

    @property
    def targets(self) -> tuple[Target, ...]:
        """Return the targets."""
        own = [rate for rate in self.rates if rate.playback_rate == _PACES[0]]
        rates = [
            Target(
                f"loop's rate while recording images as {rate.images}, relative to that without",
                _LEAST_RATIO,
                None,
                rate.ratio,
                len(own),
            )
            for rate in own
        ]
        memory, half = self.memory_mb, len(self.memory_mb) // 2
        growth = max(memory[half:]) / max(memory[:half]) if half else None
        flat = Target(
            "engine's memory in the second half of all turns, relative to the first half",
            None,
            _MOST_GROWTH,
            growth,
            len(memory),
        )
        return (*rates, flat)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "image_size": self.image_size,
            "camera_rate": RATE,
            "rates": [asdict(rate) | {"ratio": rate.ratio} for rate in self.rates],
            "memory_mb": self.memory_mb,
            "minutes": self.minutes,
            "targets": [target.as_dict() for target in self.targets],
        }


@dataclass
class _Notes:
    """Notes of all turns at one rate."""

    without: list[float] = field(default_factory=list)
    recorded: dict[str, list[float]] = field(default_factory=dict)
    mb_per_s: dict[str, list[float]] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)


def recording_figures(
    *, seconds: float = 15.0, pictures: int = _PICTURES, say: Callable[[str], None] = lambda _: None
) -> RecordingFigures:
    """Measure the loop of a running server with each way to record, and without recording.

    Args:
        seconds: duration of the loop at each rate and in each way, over all turns.
        pictures: number of different images to play.
        say: receives a description of the current measurement.

    Raises:
        MeasurementError: the server did not start, or a run did not begin.
    """
    world = World(load_scenario(SCENARIO))
    turns = max(1, round(seconds / _LONGEST_TURN_S))
    memory: list[float] = []
    began = time.monotonic()
    rates: list[RecordingRates] = []
    with tempfile.TemporaryDirectory(prefix="dynamic-observer-benchmark-") as folder:
        say("rendering what the cameras will show")
        path = Path(folder) / "cameras.mcap"
        frames = round((seconds / turns + _MARGIN_S) * _MOST_PER_S)
        size = _record_pictures(world, path, pictures, frames)
        with running_server(str(path)) as server:
            server.wait_for_frames()
            for pace in _PACES:
                server.request("POST", "/api/playback", {"rate": pace, "loop": True})
                notes = _Notes()
                for turn in range(turns):
                    say(f"recording, playing at {pace:g} x, turn {turn + 1} of {turns}")
                    notes.without.append(observed_rate(server, seconds / turns))
                    for images in MODES:
                        _recorded_turn(server, images, seconds / turns, notes)
                        held = _engine_memory_mb(server)
                        memory += [] if held is None else [held]
                rates += [
                    RecordingRates(
                        pace,
                        images,
                        mean(notes.without),
                        mean(notes.recorded[images]),
                        mean(notes.mb_per_s[images]),
                        notes.dropped[images],
                    )
                    for images in MODES
                ]
    return RecordingFigures(
        size,
        tuple(rates),
        tuple(memory),
        (time.monotonic() - began) / 60.0,
    )


def _recorded_turn(server: RunningServer, images: str, seconds: float, notes: _Notes) -> None:
    run = server.request("POST", "/api/runs", {"name": "measured", "record": images})
    notes.recorded.setdefault(images, []).append(observed_rate(server, seconds))
    recording = server.request("GET", "/api/status")["recording"]
    server.request("POST", f"/api/runs/{run['id']}/stop")
    if recording is None or recording["trouble"]:
        raise MeasurementError(f"the run was not recorded: {recording and recording['trouble']}")
    megabytes = recording["bytes"] / 1e6 / max(recording["seconds"], 1e-3)
    notes.mb_per_s.setdefault(images, []).append(megabytes)
    notes.dropped[images] = notes.dropped.get(images, 0) + recording["dropped"]
    # A long measurement would fill the disk.
    for file in server.data.glob("runs/*/recording.mcap"):
        file.unlink(missing_ok=True)


def _engine_memory_mb(server: RunningServer) -> float | None:
    """Return the engine's resident memory, without mapped files such as the played recording."""
    pid = server.request("GET", "/api/status")["engine"]["pid"]
    try:
        # proc(5): total pages, resident pages, shared pages backed by files.
        _, resident, shared, *_ = Path(f"/proc/{pid}/statm").read_text().split()
    except OSError:
        return None
    return (int(resident) - int(shared)) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _record_pictures(world: World, path: Path, count: int, frames: int) -> tuple[int, int]:
    """Record images of a scenario: a recording is the cheapest source to read.

    Args:
        count: number of different pairs. frames: total number of pairs.

    Returns:
        Width and height.
    """
    imager = StereoImager(world)
    pairs = [imager.pair(k, k / RATE) for k in range(count)]
    height, width = pairs[0][0].shape[:2]
    facts = RunFacts(
        id="cameras",
        name="cameras",
        source=f"simulated:{SCENARIO}",
        info=asdict(SourceInfo(f"simulated:{SCENARIO}", "simulated", width, height, RATE, None)),
        calibration_yaml=calibration_text(world.true_calibration),
        images="lossless",
    )
    began = time.monotonic()
    writer = RecordingWriter(path, facts)
    try:
        for k in range(frames):
            left, right = pairs[to_and_fro(k, count)]
            now = k / RATE
            writer.frame(StereoFrame(k, now, left, right, received=began + now))
    finally:
        writer.finish()
    return width, height
