"""Live motion capture beside observations: alignment, gaps, recording, and nothing else."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from app.contract.commands import LiveTruthOrder, RecordOrder, SetTruth, StopRun
from app.contract.events import ObservationEvent, StateEvent
from app.contract.live_truth import CaptureBody
from app.engine.aligning import AlignmentThread
from app.engine.live_truth import LiveTruth, ObservedSource
from app.engine.motion_listening import CONNECTING
from observer.geometry import Pose
from observer.jsonl import ObservationLine
from observer.recording.reader import Recording
from observer.sources.contract import SourceInfo
from observer.truth.live.clock import ClockFit
from observer.truth.live.contract import LiveCaptureReport
from observer.truth.matching import TrueBodyEntry
from observer.truth.motion_capture import BodySample
from observer.types import Observation, Status

from ...observer.truth.alignment.conftest import MOUNT, Room, make_room
from ...observer.truth.live.mishaps import Mishaps, Stream
from ...observer.truth.live.vrpn_server import VrpnServer
from ...waiting import until
from .bench import Bench, opening

# Seconds: the host's clock when the source's showed 0, and the motion capture server's.
HOST, SERVER = 5000.0, 1.7e9
# Seconds: latency of motion capture, and from a frame's exposure to its reception.
DELAY, EXPOSED = 0.004, 0.015
INFO = SourceInfo("camera:0,1", "camera", 640, 480, 15.0, None, live=True)


class Listener:
    """Stands in for a connection: tests put in what it hears."""

    def __init__(self, spec: str) -> None:
        self.spec = spec
        self.recorder = None
        self.trouble = None
        self.frames: list[BodySample] = []
        self.aligning: list[BodySample] = []
        self.report = CONNECTING

    def hear(self, samples: list[BodySample], state: str = "receiving") -> None:
        self.frames += samples
        self.aligning += samples
        clock = ClockFit(HOST - SERVER + DELAY, 0.0, 1e-4, 500, SERVER, 20.0)
        rates = {sample.name: 100.0 for sample in samples}
        rates = {**self.report.rate_hz, **rates}
        self.report = LiveCaptureReport(
            state, None, (), rates, dict.fromkeys(rates, 1.0), 0, 0, 1, clock  # type: ignore[arg-type]
        )  # fmt: skip

    def for_frames(self) -> list[BodySample]:
        taken, self.frames = self.frames, []
        return taken

    def for_alignment(self) -> list[BodySample]:
        taken, self.aligning = self.aligning, []
        return taken

    def end(self) -> None:
        pass

    def is_alive(self) -> bool:
        return False

    def join(self, timeout_s: float) -> None:
        del timeout_s


class Lab:
    """A planted room, played faster than real time; motion capture is 0.12 s behind frames."""

    BEHIND = 0.12

    def __init__(self, truth: LiveTruth, listener: Callable[[], Listener]) -> None:
        self.room: Room = make_room(4, offset=0.0)
        self.truth = truth
        self._listener = listener
        self._heard = 0
        self._shift = 0.0
        self.samples = sorted(
            (
                BodySample(
                    name, SERVER + float(t) - self.BEHIND, HOST + float(t) - self.BEHIND + DELAY,
                    p if np.isfinite(p).all() else None, R if np.isfinite(R).all() else None,
                )
                for name, body in self.room.capture.bodies.items()
                for t, p, R in zip(body.times, body.positions, body.rotations, strict=True)
            ),
            key=lambda sample: sample.received,
        )  # fmt: skip

    def frame(
        self,
        index: int,
        hears: Callable[[float], bool] = lambda _: True,
        sees: Callable[[float], bool] = lambda _: True,
    ) -> list[TrueBodyEntry]:
        """Observe a frame, 0.15 s after its exposure.

        Args:
            hears: whether samples of that time arrive. sees: whether they have a position.
        """
        line = self.room.lines[index]
        seen_at = line["time"]
        new = []
        while self._heard < len(self.samples):
            sample = self.samples[self._heard]
            at = sample.received - HOST + self.BEHIND - DELAY
            if sample.received > HOST + seen_at + 0.15:
                break
            self._heard += 1
            if hears(at):
                kept = sample.position if sees(at) else None
                new.append(BodySample(sample.name, sample.time, sample.received, kept,
                                      sample.rotation if sees(at) else None))  # fmt: skip
        self._listener().hear(new)
        pose = Pose.from_quaternion(line["pose"]["orientation_wxyz"], line["pose"]["position"])
        received = HOST + seen_at + EXPOSED
        observation = Observation(
            index, seen_at, received, line["segment"], Status.OK, (), 1, pose, ()
        )
        return self.truth.add_frame(observation, cast(ObservationLine, line), received, None)


@pytest.fixture
def listeners() -> list[Listener]:
    return []


@pytest.fixture
def truth(listeners: list[Listener]) -> Iterator[LiveTruth]:
    def listener(spec: str) -> Any:
        listeners.append(Listener(spec))
        return listeners[-1]

    def aligner(listener: Any) -> AlignmentThread:
        return AlignmentThread(listener.for_alignment, lambda: listener.report.clock, rest_s=0.05)

    made = LiveTruth(listener, aligner)
    try:
        yield made
    finally:
        made.end()
        made.join(10.0)


def facts(truth: LiveTruth) -> Any:
    told = truth.facts()
    assert told is not None
    return told


def sigma(truth: LiveTruth) -> float:
    found: float = facts(truth).alignment.sigma_s
    return found


def test_motion_capture_speeds_accompany_observations(
    truth: LiveTruth, listeners: list[Listener]
) -> None:
    assert truth.facts() is None
    truth.use(LiveTruthOrder("vrpn:mocap"))
    assert facts(truth).sentence == "not aligned yet: no source is open"
    truth.observing(ObservedSource(INFO, MOUNT))
    assert facts(truth).sentence == "not aligned yet: connecting to motion capture"
    lab = Lab(truth, lambda: listeners[-1])
    for index in range(270):
        entries = lab.frame(index)
        assert entries == [] or facts(truth).aligned
    # The first alignment may rest on a few seconds only.
    until(lambda: facts(truth).aligned and sigma(truth) < 0.01, "aligned well")
    told = facts(truth)
    # Frames are exposed 15 ms before reception; motion capture is 120 ms and 4 ms late.
    expected = lab.BEHIND - DELAY + EXPOSED
    alignment = told.alignment
    assert alignment.offset_s == pytest.approx(expected, abs=3 * alignment.sigma_s)
    assert alignment.observer == "Amigo"
    assert told.sentence.startswith("aligned over ")
    assert told.bodies == [
        CaptureBody("Amigo", "observer", 100.0),
        CaptureBody("P3DX", "obstacle", 100.0),
    ]

    # Motion capture drops out: first it sends nothing, then it does not see the bodies.
    by_time: dict[float, list[TrueBodyEntry]] = {}
    measured = []
    for index in range(270, 340):
        seen_at = lab.room.lines[index]["time"]
        entries = lab.frame(
            index, hears=lambda t: not 18.9 < t < 19.9, sees=lambda t: not 20.9 < t < 21.6
        )
        by_time[seen_at] = entries
        for entry in entries:
            measured.append(entry["time"])
            assert seen_at - 0.1 <= entry["time"] <= seen_at + 1e-6
            if entry["name"] == "P3DX":
                assert entry["role"] == "obstacle"
                off = np.linalg.norm(entry["position"] - lab.room.centre(entry["time"]))
                assert off < 0.3
            if entry["name"] == "P3DX" and entry["time"] > 18.7:
                # Before that it turns on the spot, about an unmeasured centre.
                assert entry["speed"] == pytest.approx(lab.room.speed(entry["time"]), abs=0.06)
    names = {t: {entry["name"] for entry in entries} for t, entries in by_time.items()}
    both = {"Amigo", "P3DX"}
    assert sum(names[t] == both for t in names if 18.1 < t < 18.8) >= 5
    for begin, end in ((18.9, 19.9), (20.9, 21.6)):
        gap = [t for t in names if begin + 0.12 < t < end - 0.02]
        assert len(gap) > 6
        assert not any(names[t] for t in gap), "nothing is interpolated over a drop-out"
        # No speed is reported for an instant within the gap, neither before it nor after.
        assert not any(begin + 0.02 < t < end - 0.01 for t in measured)
        assert sum(names[t] == both for t in names if end + 0.2 < t < end + 0.9) >= 5

    # The run begins: the same camera is reopened, which begins a new world frame.
    truth.observing(None)
    assert facts(truth).aligned is False
    truth.observing(ObservedSource(INFO, MOUNT))
    again = Lab(truth, lambda: listeners[-1])
    again.samples = lab.samples
    again._heard = lab._heard
    told_again: list[list[TrueBodyEntry]] = []
    for index in range(340, len(lab.room.lines)):
        told_again.append(again.frame(index))
        # Frames come as fast as possible; the thread looks at them ten times a second.
        time.sleep(0.12 if index > 358 else 0.0)
        if told_again[-1]:
            break
    assert told_again[-1], "the observer is seen, so nothing must be waited for"
    assert "from before the source was reopened" in facts(truth).sentence
    place = next(e for e in told_again[-1] if e["name"] == "P3DX")
    assert np.linalg.norm(np.array(place["position"]) - lab.room.centre(place["time"])) < 0.4

    # Live motion capture does not apply to a recording.
    truth.observing(ObservedSource(SourceInfo("run.mcap", "recording", 640, 480, 15.0, 9), None))
    assert not truth.in_place
    assert again.frame(len(lab.room.lines) - 1) == []
    assert "run.mcap is a recording" in facts(truth).sentence
    truth.use(None)
    assert truth.facts() is None


def test_a_ground_truth_failure_is_reported_and_ends_nothing(
    truth: LiveTruth, listeners: list[Listener]
) -> None:
    truth.use(LiveTruthOrder("vrpn:mocap"))
    truth.observing(ObservedSource(INFO, None))
    lab = Lab(truth, lambda: listeners[-1])

    def break_() -> list[BodySample]:
        raise ZeroDivisionError("a body broke")

    listeners[-1].for_frames = break_  # type: ignore[method-assign]
    assert lab.frame(0) == []
    assert "ZeroDivisionError: a body broke" in facts(truth).trouble


# --- over the wire ---------------------------------------------------------------------------


def _moving(now: float) -> dict[str, Pose | None]:
    return {"Amigo": Pose.from_rotvec([0, 0, 0.1], [now % 1.0, 0.5, 0.1]), "P3DX": None}


@pytest.fixture
def server() -> Iterator[VrpnServer]:
    made = VrpnServer(["Amigo", "P3DX"])
    mishaps = Mishaps(offset_s=1e9, since=time.monotonic())
    stream = Stream(_moving, made.send, mishaps, rate_hz=100.0, noise_m=1e-4)
    yield made
    stream.stop()
    made.stop()


@pytest.fixture
def bench(numbered: Callable[..., Any]) -> Iterator[Bench]:
    made = Bench()
    made.sources["camera"] = numbered(10_000_000, live=True)
    with made:
        yield made


def test_a_run_records_live_motion_capture(
    bench: Bench, server: VrpnServer, tmp_path: Path
) -> None:
    order = LiveTruthOrder(f"vrpn:127.0.0.1:{server.port}", observer="Amigo")
    path = tmp_path / "run.mcap"
    record = RecordOrder(str(path), "none", "a run")
    bench.value(opening("camera", run_id="r", record=record, truth=order))

    def receiving(event: StateEvent) -> bool:
        told = event.truth
        return told is not None and told.state == "receiving" and len(told.bodies) == 2

    told = bench.wait(StateEvent, receiving).truth
    assert told.spec == order.spec
    assert told.bodies[0].name == "Amigo"
    assert told.bodies[0].role == "observer"
    assert not told.aligned
    assert bench.state.has_truth
    bench.wait(StateEvent, lambda e: e.truth is not None and e.truth.clock is not None)
    # Enough for a hundred samples of each on an idle machine.
    time.sleep(1.0)
    # Motion capture drops out during the run: nothing else changes.
    before = len(bench.all(ObservationEvent))
    server.drop_clients()
    bench.wait(ObservationEvent, lambda e: e.sequence > before + 20)
    bench.value(StopRun())
    with Recording(path) as recording:
        samples = list(recording.capture_samples())
    amigo = [s for s in samples if s.name == "Amigo"]
    assert len(amigo) > 50
    assert all(s.position is None for s in samples if s.name == "P3DX")
    rising = [s.time for s in amigo]
    assert rising == sorted(rising)

    # Changed without reopening the source, then with invalid values.
    value = bench.value(SetTruth(LiveTruthOrder(order.spec, ignore=("P3DX",))))
    assert value.ignore == ("P3DX",)
    reply = bench.answer(SetTruth(LiveTruthOrder("vicon:1")))
    assert reply.refusal == "input"
    assert bench.state.truth is not None
    assert bench.value(SetTruth(None)) is None
    assert bench.answer(opening("camera", truth=LiveTruthOrder("vrpn:"))).refusal == "input"
