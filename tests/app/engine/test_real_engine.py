"""The real engine under its supervisor: a folder, and the simulated lab."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from app.contract.commands import (
    OpenSource,
    PreviewCalibration,
    SetParameters,
    SetPlayback,
    WatchViews,
)
from app.contract.events import (
    EngineState,
    ObservationEvent,
    StateEvent,
)
from app.contract.views import CLOUD_NAME, VIEW_NAMES
from app.runtime.errors import ProcessRefused
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.parameters import preset

from .supervised import ALONE, PATIENCE_S, Watched, numbers

REAL = None


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
