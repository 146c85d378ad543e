"""The cost of recording, measured on a real server with real runs: short, to see that it works."""

from __future__ import annotations

import json

import pytest

from tools.benchmark.recording_cost import RecordingFigures, RecordingRates, recording_figures
from tools.benchmark.recording_report import recording_markdown


@pytest.mark.slow
@pytest.mark.patient
def test_the_loop_is_measured_with_each_recording_mode_and_without() -> None:
    said: list[str] = []
    figures = recording_figures(seconds=2.0, pictures=4, say=said.append)
    assert figures.image_size == (640, 480)
    assert [(each.playback_rate, each.images) for each in figures.rates] == [
        (1.0, "jpeg"), (1.0, "lossless"), (4.0, "jpeg"), (4.0, "lossless"),
    ]  # fmt: skip
    jpeg, lossless = figures.rates[:2]
    assert jpeg.without == lossless.without > 5.0
    assert jpeg.recorded > 5.0
    # Pairs of 640x480 in colour, hardly compressed, against JPEG.
    assert lossless.mb_per_s > 3 * jpeg.mb_per_s > 1.0
    assert len(figures.memory_mb) == 4
    assert all(50.0 < megabytes < 1000.0 for megabytes in figures.memory_mb)
    assert len(said) == 3


def test_a_missed_target_is_marked() -> None:
    rates = tuple(
        RecordingRates(pace, images, 30.0, recorded, 6.0, dropped)
        for pace, images, recorded, dropped in (
            (1.0, "jpeg", 30.0, 0), (1.0, "lossless", 27.0, 4), (4.0, "jpeg", 20.0, 0),
        )
    )  # fmt: skip
    figures = RecordingFigures((640, 480), rates, (200.0, 260.0, 270.0, 210.0), 1.5)
    text = recording_markdown(figures)
    assert "jpeg, relative to that without | >= 0.95 | 1.000 | yes |" in text
    assert "lossless, relative to that without | >= 0.95 | 0.900 | **no** |" in text
    assert "| 1 x | lossless | 30.0 | 27.0 | 0.90 | 6.0 | 4 |" in text
    assert "relative to the first half | <= 1.1 | 1.038 | yes |" in text
    grown = RecordingFigures((640, 480), rates, (200.0, 260.0, 390.0, 210.0), 1.5)
    assert "relative to the first half | <= 1.1 | 1.500 | **no** |" in recording_markdown(grown)
    untold = RecordingFigures((640, 480), rates, (), 1.5)
    assert "relative to the first half" in recording_markdown(untold)
    assert "200 MB first, 200 to 270 MB, 210 MB last" in text
    assert json.loads(json.dumps(figures.as_dict(), allow_nan=False))["rates"][1]["ratio"] == 0.9
