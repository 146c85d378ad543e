"""The observer is prepared while the engine answers, which reports if that takes a while."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import pytest

from app.contract.events import EngineState, HeartbeatEvent, ObservationEvent, StateEvent
from app.engine.preparing import Preparing

from .bench import PATIENCE_S, Bench, Numbered, opening

NOTE = "compiling, which takes a while"


def test_a_source_waits_for_preparation_but_the_engine_does_not(numbered: Numbered) -> None:
    done = threading.Event()

    def compile_for_a_while(tell: Callable[[str], None]) -> None:
        tell(NOTE)
        assert done.wait(PATIENCE_S)

    preparing = Preparing(compile_for_a_while)
    preparing.start()
    with Bench(preparing=preparing) as bench:
        bench.sources["numbers"] = numbered(5)
        try:
            bench.wait(StateEvent, lambda s: s.state is EngineState.IDLE and s.preparing == NOTE)
            bench.ask(opening())
            time.sleep(0.5)
            assert not bench.all(ObservationEvent)
            assert len(bench.all(HeartbeatEvent)) >= 4
        finally:
            done.set()
        bench.wait(ObservationEvent)
        assert bench.state.preparing is None


def test_a_failed_preparation_is_only_logged(caplog: pytest.LogCaptureFixture) -> None:
    def fail(_: Callable[[str], None]) -> None:
        raise OSError("no space left on device")

    preparing = Preparing(fail)
    preparing.start()
    preparing.wait()
    assert preparing.note is None
    assert "no space left on device" in caplog.text
