"""Measuring live capture with real streams and processes: short, only to see that it works."""

from __future__ import annotations

import itertools
import json
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli.results import tell_measured
from app.client.server_process import MeasurementError
from observer.evaluation import machine
from tools.benchmark.camera_streams import camera_streams, to_and_fro
from tools.benchmark.capture_report import capture_markdown
from tools.benchmark.live_capture import CaptureFigures, Loop, Spread, capture_figures


def test_pictures_play_back_and_forth_without_repeats() -> None:
    assert [to_and_fro(k, 4) for k in range(9)] == [0, 1, 2, 3, 2, 1, 0, 1, 2]
    assert [to_and_fro(k, 1) for k in range(3)] == [0, 0, 0]
    order = [to_and_fro(k, 60) for k in range(500)]
    assert all(abs(a - b) == 1 for a, b in itertools.pairwise(order))


def test_both_streams_serve_the_pictures_until_their_context_ends(tmp_path: Path) -> None:
    for side, value in (("left", 60), ("right", 180)):
        (tmp_path / side).mkdir()
        for k in range(2):
            image = np.full((48, 64, 3), value + 5 * k, np.uint8)
            assert cv2.imwrite(str(tmp_path / side / f"{k}.jpg"), image)
    with camera_streams(tmp_path, 50.0) as addresses:
        for address, value in zip(addresses, (60, 180), strict=True):
            with urllib.request.urlopen(address, timeout=5) as stream:
                assert stream.headers.get_content_type() == "multipart/x-mixed-replace"
                shown = [_part(stream) for _ in range(4)]
            assert {round(image.mean()) for image in shown} == {value, value + 5}
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(addresses[0].replace("left", "third"), timeout=5)
        refused.value.close()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(addresses[0], timeout=5)


def _part(stream: object) -> np.ndarray:
    length = 0
    while line := stream.readline().strip() or not length:  # type: ignore[attr-defined]
        if isinstance(line, bytes) and line.startswith(b"Content-Length"):
            length = int(line.split(b":")[1])
    data = stream.read(length)  # type: ignore[attr-defined]
    return np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))


def test_streams_that_cannot_be_served_are_reported(tmp_path: Path) -> None:
    with pytest.raises(MeasurementError, match="camera streams"), camera_streams(tmp_path, 30.0):
        pytest.fail("a folder without pictures serves nothing")


@pytest.mark.patient
def test_the_loop_is_measured_with_cameras_and_from_memory() -> None:
    said: list[str] = []
    figures = capture_figures(seconds=1.2, pictures=6, say=said.append)
    assert figures.image_size == (640, 480)
    for loop in (figures.live, figures.memory, figures.slow, figures.tending):
        assert loop.frames >= 2
        assert 0.0 < loop.rate < 31.0
        assert loop.read_cpu_ms.p10 <= loop.read_cpu_ms.median <= loop.read_cpu_ms.p95
    assert figures.slow.rate < 20.0
    assert figures.slow.work_ms.p10 >= 50.0
    assert figures.slow.cpu_ms.median < figures.live.cpu_ms.median
    # Memory needs neither decoding nor waiting; a camera's pair has to be handed over.
    assert figures.memory.read_wall_ms.median < figures.live.read_wall_ms.median
    assert figures.memory.latency_ms.median < 1.0 < figures.live.latency_ms.median
    assert figures.memory.read_cpu_ms.median < figures.live.read_cpu_ms.median
    assert figures.pairs >= figures.live.frames
    assert len(said) == 3
    assert json.loads(json.dumps(figures.as_dict(), allow_nan=False))["camera_rate"] == 30.0


def loop(busy: float, read_wall: float = 1.0) -> Loop:
    def spread(value: float) -> Spread:
        return Spread(value / 2, value, 2 * value, value)

    return Loop(
        40, 20.0, spread(1.0), spread(read_wall), spread(busy - 1.0), spread(busy), spread(7.0), 0
    )


def test_a_missed_target_is_marked() -> None:
    figures = CaptureFigures(
        (640, 480), 30.0, loop(22.0), loop(18.5), loop(50.0, 3.2), loop(50.0, 0.4), None, None, 9, 1
    )
    text = capture_markdown(figures)
    assert "| added to the loop, ms per frame | <= 3 | 3.500 | **no** |" in text
    assert "| read in a loop slower than the cameras, ms | <= 3 | 3.200 | **no** |" in text
    assert "| the same with the cameras served between stages | <= 3 | 0.400 | yes |" in text
    assert "| - | - | 9 | 1 |" in text
    assert figures.as_dict()["added_ms"] == pytest.approx(3.5)


def test_figures_are_printed_and_stored_with_the_machine_and_its_load(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    loads = iter((0.5, 1.25))
    monkeypatch.setattr(machine, "load", lambda: next(loads))
    folder = tmp_path / "new"
    tell_measured("it", lambda: 3, "is {}".format, lambda it: {"it": it}, folder, as_json=True)
    values = json.loads((folder / "benchmark.json").read_text())
    assert values == json.loads(capsys.readouterr().out)
    assert values == {"machine": machine.machine_facts(), "load": [0.5, 1.25], "it": {"it": 3}}
    first, _, load, _, last = (folder / "benchmark.md").read_text().splitlines()
    assert first.startswith("Machine: platform ")
    assert (load, last) == ("Load: 0.5 before, 1.2 after.", "is 3")
