"""Current settings of a camera, as it reports them, in words."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from observer.sources.cameras.v4l2 import layout
from observer.sources.cameras.v4l2.device import KNOWN_CONTROLS, Control, V4l2Device, is_gone

_T = TypeVar("_T")

# Difference from a whole rate that is not shown: 30000/1001 is written 29.97.
_SAME_RATE = 0.005


@dataclass(frozen=True)
class Readback:
    """Current settings of a camera; None for what it lacks or does not report.

    Attributes:
        size: width and height in pixels. pixel_format: four characters. rate: 1/s.
        values: control's id -> its value.
        controls: control's id -> what is known about it.
    """

    size: tuple[int, int] | None
    pixel_format: str | None
    rate: float | None
    values: Mapping[int, int]
    controls: Mapping[int, Control]

    @property
    def automatic_exposure(self) -> bool | None:
        """Return whether the camera chooses its exposure; None where it has no such choice."""
        mode = self.values.get(layout.AUTO_EXPOSURE)
        if mode is None:
            return None
        return mode in (layout.EXPOSURE_AUTOMATIC, layout.EXPOSURE_APERTURE_PRIORITY)


def read_back(device: V4l2Device) -> Readback:
    """Query everything that can be set on a camera; what it does not answer is left out.

    Raises:
        OSError: the camera is gone.
    """
    values: dict[int, int] = {}
    controls: dict[int, Control] = {}
    for number in KNOWN_CONTROLS:
        control = _or_none(partial(device.control, number))
        if control is None:
            continue
        controls[number] = control
        value = None if control.write_only else _or_none(partial(device.value, number))
        if value is not None:
            values[number] = value
    size, pixel_format = _or_none(device.size_and_format) or (None, None)
    return Readback(size, pixel_format, _or_none(device.rate), values, controls)


def in_words(now: Readback) -> dict[str, str]:
    """Return what is known: ``{"size": "640x480", "exposure": "156 (15.6 ms, locked)", ...}``."""
    words = {
        "size": f"{now.size[0]}x{now.size[1]}" if now.size else None,
        "pixel format": now.pixel_format,
        "rate": _rate_words(now),
        "exposure": _exposure_words(now),
        "gain": _gain_words(now),
        "white balance": _words(
            now, layout.AUTO_WHITE_BALANCE, layout.WHITE_BALANCE_TEMPERATURE, " K"
        ),
        "focus": _words(now, layout.AUTO_FOCUS, layout.FOCUS),
        "power line": _power_line_words(now),
    }
    return {name: text for name, text in words.items() if text is not None}


def rate_text(rate: float) -> str:
    """Return a rate without insignificant digits: ``30``, ``29.97``, ``7.5``."""
    whole = round(rate)
    return f"{whole}" if abs(rate - whole) < _SAME_RATE else f"{rate:.2f}".rstrip("0").rstrip(".")


def _rate_words(now: Readback) -> str | None:
    if now.rate is None:
        return None
    falls = now.automatic_exposure and now.values.get(layout.EXPOSURE_MAY_LOWER_RATE)
    return f"{rate_text(now.rate)}/s{' (drops in dim light)' if falls else ''}"


def _exposure_words(now: Readback) -> str | None:
    value = now.values.get(layout.EXPOSURE)
    if now.automatic_exposure:
        current = value is not None and now.controls[layout.EXPOSURE].volatile
        return f"automatic (now {_exposure_time(value)})" if current and value else "automatic"
    locked = "" if now.automatic_exposure is None else "locked"
    if value is None:
        plain = now.values.get(layout.EXPOSURE_IN_DRIVER_UNITS)
        return None if plain is None else _with_remarks(str(plain), [locked])
    remarks = [_exposure_time(value), locked]
    if now.rate is not None and value * layout.EXPOSURE_UNIT_S > 1 / now.rate:
        remarks.append("longer than a frame, so the rate drops")
    return _with_remarks(str(value), remarks)


def _exposure_time(value: int) -> str:
    return f"{value * layout.EXPOSURE_UNIT_S * 1000:.1f} ms"


def _gain_words(now: Readback) -> str | None:
    if layout.AUTO_GAIN in now.values or layout.GAIN not in now.values:
        return _words(now, layout.AUTO_GAIN, layout.GAIN)
    # Most webcams have no separate automatic gain: automatic exposure changes the gain, too.
    remark = {True: "automatic exposure may change it", False: "locked", None: ""}
    return _with_remarks(str(now.values[layout.GAIN]), [remark[now.automatic_exposure]])


def _words(now: Readback, automatic: int, control: int, unit: str = "") -> str | None:
    value = now.values.get(control)
    if now.values.get(automatic):
        current = value is not None and now.controls[control].volatile
        return f"automatic (now {value}{unit})" if current else "automatic"
    if value is None:
        return "not automatic" if automatic in now.values else None
    return _with_remarks(f"{value}{unit}", ["locked" if automatic in now.values else ""])


def _power_line_words(now: Readback) -> str | None:
    value = now.values.get(layout.POWER_LINE_FREQUENCY)
    if value is None:
        return None
    return {0: "off", 1: "50 Hz", 2: "60 Hz", 3: "automatic"}.get(value, str(value))


def _with_remarks(text: str, remarks: list[str]) -> str:
    said = ", ".join(filter(None, remarks))
    return f"{text} ({said})" if said else text


def _or_none(ask: Callable[[], _T]) -> _T | None:
    """Return the answer; None where the camera refuses it or does not give it."""
    try:
        return ask()
    except OSError as error:
        if is_gone(error):
            raise
        return None
