"""What recording takes from the loop: a server that plays pictures from the disk, with runs and
without."""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import mean
from typing import Any

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
from tools.benchmark.server_process import BenchmarkError, RunningServer, running_server

SCENARIO = "webcams"
RATE = 30.0
MODES = ("jpeg", "lossless")
# At the recorded pace, and with no time to spare, so that a cost cannot hide in waiting.
_PACES = (1.0, 4.0)
# Two seconds of pictures, then the same backwards: less of them, and they do not jump.
_PICTURES = 60
# A run ends with the recording that it plays, so that holds more than is observed in a turn, which
# takes longer by what the run needs to begin and to be asked of.
# Turns are short, because a noisy machine drifts within seconds.
_LONGEST_TURN_S = 5.0
_MARGIN_S = 3.0
_MOST_PER_S = 90.0
_LEAST_RATIO = 0.95
# Largest of the second half of all recorded turns, of that of the first half.
_MOST_GROWTH = 1.1


@dataclass(frozen=True)
class RecordingRates:
    """Of one pace and one way to keep images.

    Attributes:
        playback_rate: 1 is the cameras' own pace. images: as in a run's ``record``.
        without, recorded: unique frames per second, means of all turns.
        mb_per_s: into the file. dropped: messages that the disk did not keep up with.
    """

    playback_rate: float
    images: str
    without: float
    recorded: float
    mb_per_s: float
    dropped: int

    @property
    def ratio(self) -> float:
        """Recorded over without."""
        return self.recorded / self.without if self.without else 0.0


@dataclass(frozen=True)
class RecordingFigures:
    """What was measured.

    Attributes:
        memory_mb: of the engine, at the end of each recorded turn, in order; empty where the
            system does not tell.
        minutes: that all of it took.
    """

    image_size: tuple[int, int]
    rates: tuple[RecordingRates, ...]
    memory_mb: tuple[float, ...]
    minutes: float

    @property
    def targets(self) -> tuple[Target, ...]:
        """What is to be reached."""
        own = [rate for rate in self.rates if rate.playback_rate == _PACES[0]]
        rates = [
            Target(
                f"loop's rate while images are recorded as {rate.images}, of that without",
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
            "engine's memory in the later half of all turns, of that in the earlier half",
            None,
            _MOST_GROWTH,
            growth,
            len(memory),
        )
        return (*rates, flat)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
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
    """Of all turns of one pace."""

    without: list[float] = field(default_factory=list)
    recorded: dict[str, list[float]] = field(default_factory=dict)
    mb_per_s: dict[str, list[float]] = field(default_factory=dict)
    dropped: dict[str, int] = field(default_factory=dict)


def recording_figures(
    *, seconds: float = 15.0, pictures: int = _PICTURES, say: Callable[[str], None] = lambda _: None
) -> RecordingFigures:
    """Measure the loop of a running server with each way to record, and with none.

    Args:
        seconds: of the loop at each pace and in each way, over all turns.
        pictures: how many different ones are played.
        say: is told what is being measured.

    Raises:
        BenchmarkError: the server did not start, or a run did not begin.
    """
    world = World(load_scenario(SCENARIO))
    turns = max(1, round(seconds / _LONGEST_TURN_S))
    memory: list[float] = []
    began = time.monotonic()
    rates: list[RecordingRates] = []
    with tempfile.TemporaryDirectory(prefix="dynamic-observer-benchmark-") as folder:
        say("what cameras will show: being drawn")
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
    told = server.request("GET", "/api/status")["recording"]
    server.request("POST", f"/api/runs/{run['id']}/stop")
    if told is None or told["trouble"]:
        raise BenchmarkError(f"the run was not recorded: {told and told['trouble']}")
    megabytes = told["bytes"] / 1e6 / max(told["seconds"], 1e-3)
    notes.mb_per_s.setdefault(images, []).append(megabytes)
    notes.dropped[images] = notes.dropped.get(images, 0) + told["dropped"]
    # A long measurement would fill the disk.
    for file in server.data.glob("runs/*/recording.mcap"):
        file.unlink(missing_ok=True)


def _engine_memory_mb(server: RunningServer) -> float | None:
    """Resident, without what it maps of files, as of the recording that it plays."""
    pid = server.request("GET", "/api/status")["engine"]["pid"]
    try:
        # proc(5): pages in all, resident, of these shared with files.
        _, resident, shared, *_ = Path(f"/proc/{pid}/statm").read_text().split()
    except OSError:
        return None
    return (int(resident) - int(shared)) * os.sysconf("SC_PAGE_SIZE") / 1e6


def _record_pictures(world: World, path: Path, count: int, frames: int) -> tuple[int, int]:
    """Pictures of a scenario as a recording: the source that takes least to read.

    Args:
        count: how many different ones. frames: how many pairs in all.

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
