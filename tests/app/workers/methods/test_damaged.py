"""Results of frames where a part of the recording, or a line, is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from app.workers.methods.frames import run_frames
from observer.calibration.formats.opencv_file import calibration_text
from observer.opening import open_source
from observer.recording.payloads import RunFacts
from observer.recording.reader import Recording
from observer.recording.writer import RecordingWriter
from observer.types import StereoFrame


@pytest.mark.parametrize(
    ("written", "expected"),
    [
        ("f0 l0 f1 l1 f2 l2", [0, 1, 2]),
        # The chunk with a frame is damaged, that with its line is not.
        ("f0 l0 l1 f2 l2 f3 l3", [0, 2, 3]),
        ("l0 f1 l1 f2 l2", [1, 2]),
        ("f0 l0 f1 l1 l2", [0, 1]),
        # A killed engine leaves a frame without its line; the next one counts from 0 again.
        ("f0 l0 f1 l1 f2 f0 l0 f1 l1 f2 l2", [0, 1, None, 0, 1, 2]),
        ("f0 l0 l1 f2 l2 f3 f0 l0", [0, 2, None, 0]),
        # A frame is lost whose number comes again after the engine was replaced.
        ("f0 l0 l1 f2 l2 f3 l3 f0 l0 f1 l1 f2 l2 f3 l3", [0, 2, 3, 0, 1, 2, 3]),
        # The last frame before the engine was replaced is lost, and others of its number follow.
        ("f0 l0 f1 l1 l2 f0 l0 f1 l1 f2 l2", [0, 1, 0, 1, 2]),
        ("f0 l0 l1 f0 l0 f1 l1 f0 l0 f1 l1", [0, 0, 1, 0, 1]),
        # The first frames of the second engine are lost.
        ("f0 l0 f1 l1 f2 l2 l0 l1 f2 l2", [0, 1, 2, 2]),
    ],
)
def test_each_frame_has_its_own_line(
    tmp_path: Path, written: str, expected: list[int | None]
) -> None:
    source = open_source("simulated:drive").source
    assert source.calibration is not None
    info, yaml = source.info, calibration_text(source.calibration)
    source.close()
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(
        path,
        RunFacts(
            id="run", name="a run", source=info.spec, info={}, calibration_yaml=yaml, images="none"
        ),
    )
    image = np.zeros((info.height, info.width), np.uint8)
    for k, part in enumerate(written.split()):
        number, received = int(part[1:]), 100.0 + k / 10
        if part.startswith("f"):
            writer.frame(StereoFrame(number, number / 10, image, image, received))
            continue
        line = {
            "frame": number, "time": number / 10, "segment": 0, "status": "ok", "reasons": [],
            "parameters_revision": 1, "obstacles": [], "unseen": None,
            "timings_ms": {"total": float(number)}, "pose": None,
        }  # fmt: skip
        writer.observation(line, received)
    writer.finish()
    with Recording(path) as recording:
        entries = run_frames(recording, None).frames
    assert [each.observed_ms for each in entries] == expected
    assert [each.frame for each in entries if each.observed_ms is not None] == [
        number for number in expected if number is not None
    ]
