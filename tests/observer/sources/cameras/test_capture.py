"""How OpenCV is asked for a device, with a stand-in for the opened device."""

from __future__ import annotations

import time
from pathlib import Path
from typing import ClassVar, cast

import cv2
import numpy as np
import pytest

from observer.errors import SourceError
from observer.sources.cameras.capture import DeviceCapture, NetworkCapture
from observer.sources.cameras.settings import CameraSettings
from observer.types import Image


class StandIn:
    """The part of cv2.VideoCapture that DeviceCapture uses."""

    opened: ClassVar[list[tuple[object, ...]]] = []
    works: ClassVar[bool] = True

    def __init__(self, *arguments: object) -> None:
        self.opened.append(arguments)
        self.asked: list[tuple[int, float]] = []
        self.values: dict[int, float] = {}
        self.image: Image | None = np.zeros((4, 6, 3), np.uint8)

    def isOpened(self) -> bool:
        return self.works

    def set(self, key: int, value: float) -> bool:
        self.asked.append((key, value))
        return True

    def get(self, key: int) -> float:
        return self.values.get(key, 0.0)

    def grab(self) -> bool:
        return True

    def retrieve(self) -> tuple[bool, Image | None]:
        if self.image is None:
            raise cv2.error("no JPEG")
        return True, self.image


@pytest.fixture
def device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(cv2, "VideoCapture", StandIn)
    monkeypatch.setattr(StandIn, "opened", [])
    path = tmp_path / "video0"
    path.touch()
    return path


def opened(capture: DeviceCapture) -> StandIn:
    inner = capture._capture
    assert isinstance(inner, StandIn)
    return inner


def test_a_link_to_a_device_is_resolved_and_the_format_is_set_first(
    device: Path, tmp_path: Path
) -> None:
    link = tmp_path / "by-path"
    link.symlink_to(device)
    capture = DeviceCapture(
        str(link), CameraSettings(size=(640, 480), rate=30.0, pixel_format="MJPG")
    )
    assert StandIn.opened == [(str(device), cv2.CAP_V4L2)]
    assert opened(capture).asked == [
        (cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"MJPG")),
        (cv2.CAP_PROP_FRAME_WIDTH, 640),
        (cv2.CAP_PROP_FRAME_HEIGHT, 480),
        (cv2.CAP_PROP_FPS, 30.0),
    ]
    assert opened(DeviceCapture(str(link), CameraSettings())).asked == []


def test_buffer_stamps_are_used_until_one_is_of_another_clock(device: Path) -> None:
    capture = DeviceCapture(str(device), CameraSettings())
    exposed = time.monotonic() - 0.02
    opened(capture).values[cv2.CAP_PROP_POS_MSEC] = exposed * 1e3
    assert capture.stamp() == pytest.approx(exposed, abs=1e-6)
    opened(capture).values[cv2.CAP_PROP_POS_MSEC] = time.time() * 1e3
    assert capture.stamp() is None
    opened(capture).values[cv2.CAP_PROP_POS_MSEC] = time.monotonic() * 1e3
    assert capture.stamp() is None


def test_an_unusable_image_is_none(device: Path) -> None:
    capture = DeviceCapture(str(device), CameraSettings())
    image = capture.retrieve()
    assert image is not None
    assert image.shape == (4, 6, 3)
    opened(capture).image = np.zeros((4, 6, 1), np.uint8)
    image = capture.retrieve()
    assert image is not None
    assert image.shape == (4, 6)
    for useless in (None, np.zeros((4, 6), np.uint16), np.zeros((0, 6, 3), np.uint8)):
        opened(capture).image = cast("Image | None", useless)
        assert capture.retrieve() is None


def test_an_implausible_rate_is_unknown(device: Path) -> None:
    capture = DeviceCapture(str(device), CameraSettings())
    for said, rate in ((30.0, 30.0), (0.0, None), (-1.0, None), (90_000.0, None)):
        opened(capture).values[cv2.CAP_PROP_FPS] = said
        assert capture.rate == rate


def test_the_reason_why_a_device_cannot_be_opened_is_reported(
    device: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(SourceError, match="is not connected"):
        DeviceCapture(str(device) + "1", CameraSettings())
    monkeypatch.setattr(StandIn, "works", False)
    with pytest.raises(SourceError, match="it is open in another program or not a camera"):
        DeviceCapture(str(device), CameraSettings())


def test_the_reason_why_a_stream_cannot_be_opened_is_reported(free_port: int) -> None:
    with pytest.raises(SourceError, match="refuses the connection"):
        NetworkCapture(f"http://127.0.0.1:{free_port}/video")
    with pytest.raises(SourceError, match="cannot be found"):
        NetworkCapture("http://no-such-host.invalid/video")
