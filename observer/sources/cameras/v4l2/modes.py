"""Images that a camera can deliver: pixel formats, sizes and rates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from observer.sources.cameras.v4l2 import layout
from observer.sources.cameras.v4l2.device import V4l2Device, rate_of

# Offered where a driver reports a range instead of single sizes and rates.
_USUAL_SIZES = (
    (320, 240), (640, 360), (640, 480), (800, 600), (1280, 480), (1280, 720), (1280, 960),
    (1920, 1080), (2560, 720), (2560, 960), (3840, 1080), (3840, 2160),
)  # fmt: skip
_USUAL_RATES = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 50.0, 60.0, 90.0, 100.0, 120.0)


@dataclass(frozen=True)
class CameraMode:
    """One size in one pixel format.

    Attributes:
        pixel_format: four characters, as in ``MJPG``.
        width, height: pixels.
        rates: frames per second, the highest first; empty where the driver reports none.
    """

    pixel_format: str
    width: int
    height: int
    rates: tuple[float, ...]


def camera_modes(device: V4l2Device) -> tuple[CameraMode, ...]:
    """Return all modes, by pixel format in the driver's order, then by size.

    Raises:
        OSError: the device does not answer.
    """
    modes: list[CameraMode] = []
    for code in device.formats():
        sizes = {size for answer in device.sizes(code) for size in _sizes(answer)}
        modes += [
            CameraMode(layout.fourcc_text(code), width, height, _rates(device, code, width, height))
            for width, height in sorted(sizes, key=lambda size: (size[0] * size[1], size))
        ]
    return tuple(modes)


def _sizes(answer: layout.FrameSize) -> Iterator[tuple[int, int]]:
    if answer.type == layout.DISCRETE:
        yield answer.discrete.width, answer.discrete.height
        return
    span = answer.stepwise
    for width, height in (*_USUAL_SIZES, (span.max_width, span.max_height)):
        if _in_range(width, span.min_width, span.max_width, span.step_width) and _in_range(
            height, span.min_height, span.max_height, span.step_height
        ):
            yield width, height


def _in_range(value: int, low: int, high: int, step: int) -> bool:
    return low <= value <= high and (step <= 1 or (value - low) % step == 0)


def _rates(device: V4l2Device, code: int, width: int, height: int) -> tuple[float, ...]:
    rates: set[float] = set()
    for answer in device.intervals(code, width, height):
        if answer.type == layout.DISCRETE:
            rates.update(filter(None, [rate_of(answer.discrete)]))
            continue
        # The shortest interval is the highest rate.
        high, low = rate_of(answer.stepwise.min), rate_of(answer.stepwise.max)
        if high is not None and low is not None:
            rates.update(rate for rate in _USUAL_RATES if low <= rate <= high)
            rates.add(high)
    return tuple(sorted(rates, reverse=True))
