"""The supervisor with real processes: fake sources at the wire, and the real engine."""

from __future__ import annotations

import asyncio
import gc
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pytest

from app.contract.commands import (
    OpenSource,
    PreviewCalibration,
    SetParameters,
    SetPlayback,
    StopRun,
    WatchViews,
)
from app.contract.events import (
    EngineLostEvent,
    EngineStartedEvent,
    EngineState,
    HeartbeatEvent,
    ObservationEvent,
    StateEvent,
)
from app.contract.views import CLOUD_NAME, VIEW_NAMES
from app.engine.supervisor import EngineSupervisor
from app.runtime.errors import ProcessRefused, ProcessUnavailable
from app.runtime.supervisor import SupervisorLimits
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.parameters import preset

from ..starvation import others_at_work

HERE = Path(__file__).parent
FAKE = (sys.executable, str(HERE / "fake_engine.py"))
WORKS = (*FAKE, "works")
REAL = None
PATIENCE_S = 40.0
# Seconds: the promised time, plus some for a machine that runs other tests.
REPLACED_WITHIN_S = 2.0 + 0.5
# No standby engine for tests that do not need one: each process takes a second to start.
ALONE = SupervisorLimits(standby_delay_s=None)
LIMITS = SupervisorLimits(standby_delay_s=0.0)


class Watched:
    """A supervisor and the events it published, with their arrival times."""

    def __init__(
        self, command: tuple[str, ...] | None = WORKS, *, limits: SupervisorLimits = LIMITS
    ) -> None:
        given = {} if command is None else {"command": command}
        self.supervisor = EngineSupervisor(limits=limits, **given)
        self.events: list[tuple[float, Any]] = []
        self.supervisor.subscribe(lambda event: self.events.append((time.monotonic(), event)))

    async def __aenter__(self) -> Watched:
        await self.supervisor.start()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.supervisor.stop()

    def all(self, kind: type) -> list[Any]:
        return [event for _, event in self.events if isinstance(event, kind)]

    async def wait(self, kind: type, fits: Callable[[Any], bool] = lambda _: True) -> Any:
        """Return the first event of this kind that fits, past ones included."""
        return await self.until(
            lambda: next((e for e in self.all(kind) if fits(e)), None), kind.__name__
        )

    async def until(self, found: Callable[[], Any], what: str) -> Any:
        deadline = time.monotonic() + PATIENCE_S
        while (result := found()) is None or result is False:
            assert time.monotonic() < deadline, f"{what} did not come: {self.events[-10:]}"
            await asyncio.sleep(0.01)
        return result

    async def standby_ready(self) -> None:
        await self.until(
            lambda: self.supervisor._standby is not None and self.supervisor._standby.ready,
            "the stand-in",
        )


def numbers(source: str = "numbers", **more: Any) -> OpenSource:
    return OpenSource(source, None, {}, 1, **more)


def gone(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


async def test_it_starts_answers_observes_and_leaks_no_descriptors() -> None:
    # Collect garbage of earlier tests first, or its descriptors would be counted.
    gc.collect()
    before = len(os.listdir("/dev/fd"))
    async with Watched() as watched:
        supervisor = watched.supervisor
        assert [type(event) for _, event in watched.events[:2]] == [EngineStartedEvent, StateEvent]
        health = supervisor.health
        assert (health.generation, health.alive, health.restarts) == (1, True, 0)
        assert health.pid is not None
        assert health.heartbeat_age_s is not None
        assert health.heartbeat_age_s < 2
        value = await supervisor.request(numbers())
        assert value.state.state == "preview"
        assert watched.all(StateEvent)[-1].state is EngineState.PREVIEW
        await watched.wait(ObservationEvent, lambda e: e.sequence == 20)
        sequences = [e.sequence for e in watched.all(ObservationEvent)]
        assert sequences == list(range(len(sequences)))
        assert await supervisor.request(WatchViews(("plain",))) is None
        latest = await watched.until(supervisor.views["plain"].read, "a picture")
        assert latest.payload.startswith(b"\xff\xd8")
        assert supervisor.cloud.read() is None
        await watched.standby_ready()
    await supervisor.stop()
    assert len(os.listdir("/dev/fd")) == before


async def test_refusals_are_distinguished_from_unavailability() -> None:
    async with Watched(limits=ALONE) as watched:
        supervisor = watched.supervisor
        with pytest.raises(ProcessRefused, match="no run is in progress") as refused:
            await supervisor.request(StopRun())
        assert refused.value.refusal == "state"
        with pytest.raises(ProcessRefused, match="there is no such parameter") as refused:
            await supervisor.request(SetParameters({"a.b": 1}, 1))
        assert refused.value.refusal == "input"
    with pytest.raises(ProcessUnavailable, match="is shutting down"):
        await supervisor.request(StopRun())


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSEGV, signal.SIGSTOP])
async def test_a_dead_or_hung_engine_is_replaced_in_time(number: signal.Signals) -> None:
    async with Watched() as watched:
        supervisor = watched.supervisor
        await supervisor.request(numbers())
        await watched.standby_ready()
        first = supervisor.health.pid
        assert first is not None
        begin = time.monotonic()
        os.kill(first, number)
        await watched.wait(EngineStartedEvent, lambda e: e.generation == 2)
        at = {type(e): t for t, e in watched.events if t > begin}
        assert at[EngineStartedEvent] - begin < REPLACED_WITHIN_S
        lost = watched.all(EngineLostEvent)[0]
        assert lost.generation == 1
        expected = "did not respond" if number == signal.SIGSTOP else number.name
        assert expected in lost.reason
        order = [type(e) for _, e in watched.events if not isinstance(e, HeartbeatEvent)]
        assert order.index(EngineLostEvent) < len(order) - order[::-1].index(EngineStartedEvent)
        assert gone(first)
        health = supervisor.health
        assert health.restarts == 1
        assert health.pid != first
        # The next engine is idle and works like the first one.
        assert watched.all(StateEvent)[-1].state is EngineState.IDLE
        await supervisor.request(numbers())
        sequence = supervisor.views["plain"].read()
        await supervisor.request(WatchViews(("plain",)))
        await watched.until(
            lambda: supervisor.views["plain"].read(sequence.sequence if sequence else 0),
            "a picture of the next engine",
        )


async def test_a_hung_main_loop_is_replaced_although_its_threads_live() -> None:
    async with Watched() as watched:
        await watched.standby_ready()
        begin = time.monotonic()
        await watched.supervisor.request(numbers("hang"))
        await watched.wait(EngineLostEvent)
        assert "did not respond" in watched.all(EngineLostEvent)[0].reason
        await watched.wait(EngineStartedEvent, lambda e: e.generation == 2)
        assert time.monotonic() - begin < REPLACED_WITHIN_S + 0.5


@pytest.mark.patient
async def test_an_engine_starved_of_processor_time_is_not_replaced() -> None:
    longest = 0.0
    async with Watched(limits=ALONE) as watched:
        pid = watched.supervisor.health.pid
        assert pid is not None
        await watched.supervisor.request(numbers("busy"))
        await watched.wait(ObservationEvent)
        with others_at_work(pid):
            until = time.monotonic() + 8.0
            while time.monotonic() < until:
                longest = max(longest, watched.supervisor.health.heartbeat_age_s or 0.0)
                await asyncio.sleep(0.05)
            assert watched.all(EngineLostEvent) == []
        assert watched.supervisor.health.restarts == 0
    sys.stdout.write(f"silent for {longest:.1f} s at most\n")
    # Otherwise the machine was not busy enough, and nothing was tested.
    assert longest > SupervisorLimits().hang_s


async def test_a_request_to_a_dying_engine_fails_immediately() -> None:
    async with Watched(limits=ALONE) as watched:
        begin = time.monotonic()
        with pytest.raises(
            ProcessUnavailable, match="before it completed the request to open source"
        ):
            await watched.supervisor.request(numbers("exit"), timeout_s=30)
        assert time.monotonic() - begin < 10
        await watched.wait(EngineLostEvent)
        assert "exit code 7" in watched.all(EngineLostEvent)[0].reason


async def test_an_unanswered_request_times_out() -> None:
    limits = SupervisorLimits(hang_s=30, standby_delay_s=None)
    async with Watched(limits=limits) as watched:
        pid = watched.supervisor.health.pid
        assert pid is not None
        os.kill(pid, signal.SIGSTOP)
        with pytest.raises(ProcessUnavailable, match="not complete the request to stop run within"):
            await watched.supervisor.request(StopRun(), timeout_s=0.3)
        begin = time.monotonic()
    # Stopping the supervisor also ends an engine that is stopped by SIGSTOP.
    assert gone(pid)
    assert time.monotonic() - begin < 10


async def test_a_repeatable_request_is_answered_by_the_next_engine(tmp_path: Path) -> None:
    async with Watched() as watched:
        supervisor = watched.supervisor
        await watched.standby_ready()
        opened = await supervisor.request(numbers(str(tmp_path / "once")), repeatable=True)
        assert opened.state.state == "preview"
        assert supervisor.health.generation == 2
        # A source that ends every engine is tried twice, not forever.
        with pytest.raises(ProcessUnavailable, match="exited before it completed"):
            await supervisor.request(numbers("exit"), repeatable=True)
        assert supervisor.health.generation in (3, 4)
        # While there is no engine, the request waits for one.
        assert (await supervisor.request(numbers(), repeatable=True)).state.state == "preview"


async def test_an_engine_that_keeps_dying_is_restarted_with_backoff() -> None:
    limits = SupervisorLimits(standby_delay_s=0.0, backoff_s=0.2)
    async with Watched(limits=limits) as watched:

        def open_deadly(event: Any) -> None:
            if isinstance(event, EngineStartedEvent):
                deadly.append(asyncio.create_task(watched.supervisor.request(numbers("exit"))))

        await watched.standby_ready()
        deadly: list[asyncio.Task[Any]] = []
        unsubscribe = watched.supervisor.subscribe(open_deadly)
        open_deadly(EngineStartedEvent(1, 0))
        await watched.wait(EngineStartedEvent, lambda e: e.generation == 4)
        unsubscribe()
        await asyncio.gather(*deadly, return_exceptions=True)
        starts = [t for t, e in watched.events if isinstance(e, EngineStartedEvent)]
        losses = [t for t, e in watched.events if isinstance(e, EngineLostEvent)]
        pauses = [start - lost for start, lost in zip(starts[1:], losses, strict=False)]
        assert pauses[0] < REPLACED_WITHIN_S, "a single death is made good at once"
        assert pauses[1] >= 0.2
        assert pauses[2] >= 0.4


async def test_an_engine_that_never_starts_is_given_up_with_the_reason() -> None:
    dies = (sys.executable, "-c", "exit(3)")
    watched = Watched(dies, limits=SupervisorLimits(backoff_s=0.05))
    with pytest.raises(ProcessUnavailable, match="exit code 3, 3 times in a row"):
        await watched.supervisor.start()


async def test_a_silent_engine_is_given_up() -> None:
    silent = (sys.executable, "-c", "import time; time.sleep(3600)")
    watched = Watched(silent, limits=SupervisorLimits(start_s=0.4, backoff_s=0.05))
    with pytest.raises(ProcessUnavailable, match="did not respond"):
        await watched.supervisor.start()


async def test_a_missing_program_is_reported() -> None:
    supervisor = EngineSupervisor(
        command=("/nowhere/python",), limits=SupervisorLimits(backoff_s=0.05)
    )
    with pytest.raises(ProcessUnavailable, match=r"cannot be started: .*No such file"):
        await supervisor.start()


async def test_a_blocked_event_loop_is_not_mistaken_for_a_hung_engine() -> None:
    async with Watched(limits=ALONE) as watched:
        await watched.supervisor.request(numbers())
        pid = watched.supervisor.health.pid
        time.sleep(2.5)
        await asyncio.sleep(0.5)
        assert watched.supervisor.health.pid == pid
        assert watched.all(EngineLostEvent) == []
        # 50 frames/s for 2.5 s exceed the queue: the lost ones must be counted.

        def counted() -> bool:
            sequences = [e.sequence for e in watched.all(ObservationEvent)]
            missing = sequences[-1] + 1 - len(sequences)
            return missing == watched.supervisor.health.observations_lost

        await watched.until(counted, "the count of what was lost")


async def test_a_failing_listener_does_not_affect_others() -> None:
    async with Watched(limits=ALONE) as watched:

        def failing(_: Any) -> None:
            raise ValueError("on purpose")

        watched.supervisor.subscribe(failing)
        heard: list[Any] = []
        unsubscribe = watched.supervisor.subscribe(heard.append)
        await watched.until(lambda: len(heard) > 3, "events behind a failing listener")
        unsubscribe()
        count = len(heard)
        await asyncio.sleep(0.2)
        assert len(heard) == count


async def test_an_engine_that_cannot_be_looked_after_is_not_healthy_and_replaced_later(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with Watched(limits=ALONE) as watched:
        supervisor = watched.supervisor
        first = supervisor.health
        assert first.alive
        with monkeypatch.context() as patch:
            patch.setattr(supervisor, "_complaint", _fail)
            await watched.until(lambda: not supervisor.health.alive, "the doubt")
            assert supervisor.health.pid == first.pid
            assert first.pid is not None
            os.kill(first.pid, signal.SIGKILL)
            await asyncio.sleep(0.3)
            assert caplog.text.count("supervising the engine failed: on purpose") == 1
        await watched.wait(EngineLostEvent)
        await watched.wait(EngineStartedEvent, lambda event: event.generation == 2)
        await watched.until(lambda: supervisor.health.alive, "the next engine")
        assert supervisor._watching is not None
        # By whatever means supervision ends, the engine is then no longer called healthy.
        supervisor._watching.cancel()
        await watched.until(lambda: not supervisor.health.alive, "the doubt")


@pytest.mark.parametrize("broken", ["ChildProcess.start", "ProcessSupervisor._look_after_active"])
async def test_a_start_ends_even_if_supervision_fails(
    broken: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(f"app.runtime.supervisor.{broken}", _fail)
    watched = Watched(limits=SupervisorLimits(backoff_s=0.01))
    with pytest.raises(ProcessUnavailable, match=r"on purpose, 3 times in a row"):
        async with asyncio.timeout(PATIENCE_S):
            await watched.supervisor.start()
    assert not watched.supervisor.health.alive


async def test_the_loss_of_an_engine_that_cannot_be_ended_is_published(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async with Watched(limits=ALONE) as watched:
        child = watched.supervisor._active
        assert child is not None
        with monkeypatch.context() as patch:
            patch.setattr("app.runtime.child.ChildProcess.remove", _fail)
            child.kill()
            lost = await watched.wait(EngineLostEvent)
            assert lost.reason == "the engine cannot be ended: on purpose"
        await child.remove()
        await watched.wait(EngineStartedEvent, lambda event: event.generation == 2)
        # It was not forgotten.
        assert gone(child.pid)
        assert child not in watched.supervisor._lingering


async def test_an_engine_whose_messages_cannot_be_handled_is_replaced_with_the_cause_logged(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async with Watched(limits=ALONE) as watched:
        monkeypatch.setattr(watched.supervisor._active, "_on_event", _fail)
        await watched.wait(EngineLostEvent)
        await watched.wait(EngineStartedEvent, lambda event: event.generation == 2)
    assert "RuntimeError: on purpose" in caplog.text


async def test_the_pause_is_limited_after_any_number_of_failures() -> None:
    supervisor = EngineSupervisor(command=WORKS)
    try:
        supervisor._failures = 5000
        supervisor._count_failure(time.monotonic())
        assert 9.0 < supervisor._not_before - time.monotonic() <= 10.0
    finally:
        await supervisor.stop()


def _fail(*_: Any, **__: Any) -> Any:
    raise RuntimeError("on purpose")


@pytest.mark.parametrize(
    ("number", "stopped", "behaviour"),
    [
        (signal.SIGTERM, False, "works"),
        (signal.SIGTERM, True, "works"),
        (signal.SIGKILL, False, "works"),
        (signal.SIGKILL, False, "channel-only"),
        # A stopped process cannot run its own code: only the kernel can end it.
        pytest.param(
            signal.SIGKILL,
            True,
            "works",
            marks=pytest.mark.skipif(sys.platform != "linux", reason="needs PR_SET_PDEATHSIG"),
        ),
    ],
)
def test_engines_end_with_their_parent(
    number: signal.Signals, stopped: bool, behaviour: str
) -> None:
    parent = subprocess.Popen(
        [sys.executable, str(HERE / "serving_parent.py"), *FAKE, behaviour],
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(HERE.parents[2])},
    )
    try:
        assert parent.stdout is not None
        engines = [int(word) for word in parent.stdout.readline().split()]
        assert len(engines) == 2
        if stopped:
            for pid in engines:
                os.kill(pid, signal.SIGSTOP)
        parent.send_signal(number)
        code = parent.wait(20)
        assert code == (-signal.SIGKILL if number == signal.SIGKILL else 0)
        deadline = time.monotonic() + 5
        while not all(map(gone, engines)):
            assert time.monotonic() < deadline, "an engine outlived its parent"
            time.sleep(0.01)
    finally:
        parent.kill()
        parent.wait()
        assert parent.stdout is not None
        parent.stdout.close()


@pytest.fixture
def stereo_folder(tmp_path: Path) -> Path:
    """Ten frames of a textured wall that approaches, and a block that crosses in front of it."""
    width, height = 320, 200
    (tmp_path / "left").mkdir()
    (tmp_path / "right").mkdir()
    noise = np.random.default_rng(1).integers(0, 256, (120, 200), dtype=np.uint8)
    wall = cv2.resize(noise, (width + 200, height + 120), interpolation=cv2.INTER_CUBIC)
    for index in range(10):
        for name, shift in (("left", 0), ("right", 8)):
            view = wall[40 : 40 + height, 40 + shift : 40 + shift + width].copy()
            u = 60 + 6 * index - shift
            view[80:130, u : u + 50] = wall[10:60, 400:450]
            assert cv2.imwrite(str(tmp_path / name / f"{index:06d}.png"), view)
    (tmp_path / "times.txt").write_text("".join(f"{index / 20}\n" for index in range(10)))
    calibration = StereoCalibration.rectified(width, height, 200, 200, 160, 100, 0.1)
    (tmp_path / "calibration.yaml").write_text(calibration_text(calibration))
    return tmp_path


async def test_the_real_engine_plays_observes_and_draws_a_stereo_folder(
    stereo_folder: Path,
) -> None:
    async with Watched(REAL, limits=ALONE) as watched:
        supervisor = watched.supervisor
        await supervisor.request(WatchViews((*VIEW_NAMES, CLOUD_NAME)))
        parameters = preset("paper").flat()
        value = await supervisor.request(
            OpenSource(str(stereo_folder), None, parameters, 4, run_id="r", segment=2)
        )
        assert value.state.state == "running"
        event = await watched.wait(ObservationEvent, lambda e: e.line["segment"] == 3)
        events = watched.all(ObservationEvent)
        assert [e.line["frame"] for e in events] == list(range(len(events)))
        assert event.line["frame"] == 10
        assert event.run_id == "r"
        assert event.line["parameters_revision"] == 4
        for name in VIEW_NAMES:
            latest = await watched.until(supervisor.views[name].read, name)
            image = cv2.imdecode(np.frombuffer(latest.payload, np.uint8), cv2.IMREAD_COLOR)
            assert image is not None
            assert image.shape == (200, 320, 3)
            assert (latest.header["width"], latest.header["height"]) == (320, 200)
        cloud = await watched.until(supervisor.cloud.read, "a cloud")
        assert cloud.header["count"] > 1000
        assert len(cloud.payload) == 15 * cloud.header["count"]
        frame = await supervisor.request(SetParameters(parameters, 5))
        await watched.wait(
            ObservationEvent,
            lambda e: e.line["frame"] >= frame and e.line["parameters_revision"] == 5,
        )
        playback = await supervisor.request(SetPlayback(paused=True))
        assert playback.paused is True
        text = (stereo_folder / "calibration.yaml").read_text()
        preview = await supervisor.request(PreviewCalibration(text))
        assert preview.vertical_error_px == pytest.approx(0.0, abs=0.3)
        assert preview.jpeg.startswith(b"\xff\xd8")


async def test_the_real_engine_asks_for_a_missing_calibration(stereo_folder: Path) -> None:
    (stereo_folder / "calibration.yaml").unlink()

    async with Watched(REAL, limits=ALONE) as watched:
        with pytest.raises(ProcessRefused, match="calibration") as refused:
            await watched.supervisor.request(numbers(str(stereo_folder)))
        assert refused.value.refusal == "input"
        with pytest.raises(ProcessRefused, match="unknown kind of source"):
            await watched.supervisor.request(numbers("nonsense:1"))
        failed = watched.all(StateEvent)[-1]
        assert failed.state is EngineState.FAILED


async def test_the_real_engine_observes_the_simulated_lab_with_truth() -> None:
    async with Watched(REAL, limits=ALONE) as watched:
        await watched.supervisor.request(
            OpenSource("simulated:lab", None, preset("paper").flat(), 1), timeout_s=PATIENCE_S
        )
        event = await watched.wait(ObservationEvent, lambda e: e.line["frame"] == 5)
        assert watched.all(StateEvent)[-1].has_truth
        assert {body["role"] for body in event.truth} == {"observer", "obstacle"}
