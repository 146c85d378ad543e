"""The measurement from outside, on a real server: short, only to see that it works."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import asdict

import psutil
import pytest

from app.client.server_process import MeasurementError, RunningServer, running_server
from tools.benchmark import served
from tools.benchmark.served import (
    DenseCloudRates,
    DriveLateness,
    LoopRates,
    ServedFigures,
    ServedRates,
    StalledRates,
    _dense_cloud_rates,
    _loop_rates,
    _stalled_rates,
)
from tools.benchmark.served_report import drive_line, served_markdown

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module", autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    """Replaces the check after every test: the server outlives tests and starts children."""
    yield
    _, alive = psutil.wait_procs(psutil.Process().children(recursive=True), 3.0)
    left = [each.cmdline() for each in alive]
    assert not [each for each in left if "app.engine" in each or "app.drive" in each], left


@pytest.fixture(scope="module")
def server(_nothing_left_behind: None) -> Iterator[RunningServer]:
    """One server for all: starting it takes longer than the measurements."""
    with running_server("simulated:lab") as server:
        server.wait_for_frames()
        yield server


@pytest.mark.patient
def test_a_source_that_cannot_be_opened_is_reported_with_the_reason() -> None:
    # Before the others, whose server plays at full speed for as long as it lives.
    with running_server("simulated:moon") as server:
        until = time.monotonic() + 30
        while not server.request("GET", "/api/status")["engine"]["reason"]:
            assert time.monotonic() < until, "the engine gave no reason"
            time.sleep(0.05)
        with pytest.raises(MeasurementError, match="moon"):
            server.wait_for_frames(0.0)


@pytest.mark.patient
def test_a_served_loop_is_measured_alone_and_with_real_viewers(
    server: RunningServer,
) -> None:
    said: list[str] = []
    rates = _loop_rates(server, 1.0, 1.0, 2, said.append)
    with pytest.raises(MeasurementError, match="PUT /api/source was answered with status 422"):
        server.request("PUT", "/api/source", {"source": "simulated:moon"})
    assert rates.alone > 0
    assert rates.with_viewers > 0
    assert rates.failures == ()
    assert min(rates.scene_messages, rates.observation_messages, rates.image_messages) > 0
    assert len(said) == 3
    assert rates.recorded is not None
    drive = rates.drive
    assert drive is not None
    assert drive.late_p99_ms is not None
    assert drive.late_max_ms is not None
    assert 0 <= drive.late_p99_ms <= drive.late_max_ms
    assert drive.priority in ("realtime", "raised", "normal")
    assert asdict(rates)["drive"]["late_max_ms"] == drive.late_max_ms


def test_the_drive_loops_lateness_is_one_line_of_the_report() -> None:
    def rates(
        playback_rate: float, drive: DriveLateness | None, recorded: DriveLateness | None
    ) -> LoopRates:
        return LoopRates(playback_rate, 30.0, 29.0, 3, 1, 1, 1, (), drive, recorded)

    figures = ServedFigures(
        (
            rates(
                1.0,
                DriveLateness(0.312, 4.5, "realtime"),
                DriveLateness(0.5, 6.0, "realtime"),
            ),
            rates(2.0, DriveLateness(None, None, "normal"), None),
        ),
        StalledRates(20, ServedRates(30, 600, 600), ServedRates(30, 588, 480), ()),
        DenseCloudRates(4.0, 30.0, 29.0, 2.0, 0.5, 100.0, 1, ()),
        "no page in this test",
    )
    assert drive_line(figures) == (
        "The drive loop's lateness with viewers, over its last 30 s: at 1 x p99 0.31 ms, "
        "max 4.50 ms, priority realtime, while a run is recorded p99 0.50 ms, max 6.00 ms, "
        "priority realtime; at 2 x not reported, priority normal, while a run is recorded there "
        "was no drive process."
    )
    text = served_markdown(figures)
    assert (
        "loop's rate with 3 viewers, played at 1 x, relative to that alone | >= 0.9 | 0.967 | yes |"
        in text
    )
    assert "20 viewers receive beside a stalled one, relative to that without it" in text
    assert "| >= 0.9 | 0.800 | **no** |" in text
    assert "| observations | 600.0 | 588.0 |" in text
    assert figures.as_dict()["loop"][0]["drive"] == {
        "late_p99_ms": 0.312, "late_max_ms": 4.5, "priority": "realtime",
    }  # fmt: skip


@pytest.mark.patient
def test_viewers_are_measured_beside_a_stalled_one(server: RunningServer) -> None:
    rates = _stalled_rates(server, 1.0, 2, lambda _: None)
    assert rates.failures == ()
    for each in (rates.without, rates.beside):
        # Two viewers receive each frame, if they keep up.
        assert 0 < each.observations < 3 * each.frames
        assert each.images > 0
    assert rates.ratio <= rates.beside.frames / rates.without.frames


@pytest.mark.patient
def test_the_dense_cloud_is_measured_while_it_is_computed(
    server: RunningServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(served, "_TURNS", 1)
    rates = _dense_cloud_rates(server, 1.0, 2.0, lambda _: None)
    assert rates.without > 0
    assert rates.ratio == pytest.approx(rates.watched / rates.without)
    assert rates.clouds_per_s > 1.0, "a busy machine makes few, but not none"
    assert rates.age_s is not None
    assert rates.coarseness == 1
    assert rates.failures == ()
