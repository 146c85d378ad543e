"""Setting of a camera's controls, all read back; nothing is clamped silently."""

from __future__ import annotations

import errno
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

from observer.errors import SourceError
from observer.sources.cameras.device_files import MACHINE, why_not
from observer.sources.cameras.settings import AppliedSettings, Auto, CameraSettings
from observer.sources.cameras.v4l2 import layout
from observer.sources.cameras.v4l2.device import (
    Control,
    DeviceAccess,
    LinuxAccess,
    V4l2Device,
    is_gone,
)
from observer.sources.cameras.v4l2.modes import CameraMode, camera_modes
from observer.sources.cameras.v4l2.readback import Readback, in_words, rate_text, read_back

_POWER_LINE = {0: 0, 50: 1, 60: 2, "auto": 3}
# Relative difference of rates that count as equal: 29.97 for 30.
_RATE_TOLERANCE = 0.02


@dataclass(frozen=True)
class _Adjustable:
    """Setting with a value and usually an automatic mode that controls it.

    Attributes:
        name: in words. value: ids of the controls that hold it, the best first.
        automatic: id of the control that switches the automatic mode.
        on, off: values of that control, the best first; the first one in its menu is taken.
    """

    name: str
    value: tuple[int, ...]
    automatic: int
    on: tuple[int, ...] = (1,)
    off: tuple[int, ...] = (0,)


_EXPOSURE = _Adjustable(
    "exposure",
    (layout.EXPOSURE, layout.EXPOSURE_IN_DRIVER_UNITS),
    layout.AUTO_EXPOSURE,
    # Webcams have a fixed iris and therefore only this kind of automatic mode.
    on=(layout.EXPOSURE_APERTURE_PRIORITY, layout.EXPOSURE_AUTOMATIC),
    off=(layout.EXPOSURE_MANUAL, layout.EXPOSURE_SHUTTER_PRIORITY),
)
_GAIN = _Adjustable("gain", (layout.GAIN,), layout.AUTO_GAIN)
_WHITE_BALANCE = _Adjustable(
    "white balance", (layout.WHITE_BALANCE_TEMPERATURE,), layout.AUTO_WHITE_BALANCE
)
_FOCUS = _Adjustable("focus", (layout.FOCUS,), layout.AUTO_FOCUS)


def apply_settings(
    path: str | Path,
    settings: CameraSettings,
    *,
    root: Path = MACHINE,
    access: DeviceAccess | None = None,
) -> AppliedSettings:
    """Set a camera's controls, then read everything back.

    Size, rate and pixel format are set when the stream is opened; here they are only compared
    with what is in force, so call this once the stream is open. An automatic mode is switched off
    before its value is set. If a rate is asked for, automatic exposure may not lower it. The call
    talks to the camera over USB: it takes milliseconds, or seconds if the camera is broken.

    Args:
        path: as it is called on the machine, ``/dev/video0`` or a link to it.
        settings: those asked for.
        root: the machine's file system. access: its kernel; None for this one.

    Raises:
        SourceError: the device cannot be opened or went away.
    """
    file = root / str(path).lstrip("/")
    try:
        with V4l2Device(file, access or LinuxAccess()) as device:
            device.identity()
            refused = [sentence for sentence in _set_all(device, settings) if sentence]
            now = read_back(device)
            refused += _not_in_force(device, settings, now)
    except OSError as error:
        raise SourceError(why_not(file, error, root)) from error
    return AppliedSettings(in_words(now), tuple(refused))


def _set_all(device: V4l2Device, settings: CameraSettings) -> Iterator[str | None]:
    if settings.power_line_hz is not None:
        asked = settings.power_line_hz
        asking = f"power line {asked if asked == 'auto' else f'{asked} Hz' if asked else 'off'}"
        yield _tried(asking, partial(_set_power_line, device, asked, asking))
    # Exposure before gain: automatic exposure often controls the gain as well.
    for what, value in (
        (_EXPOSURE, settings.exposure),
        (_GAIN, settings.gain),
        (_WHITE_BALANCE, settings.white_balance),
        (_FOCUS, settings.focus),
    ):
        if value is not None:
            yield _tried(f"{what.name} {value}", partial(_adjust, device, what, value))
    if settings.rate is not None:
        asking = "constant frame rate despite automatic exposure"
        yield _tried(asking, partial(_hold_rate, device, asking))


def _tried(asking: str, attempt: Callable[[], str | None]) -> str | None:
    """Return the attempt's answer, or a sentence if the camera does not answer.

    Raises:
        OSError: the camera is gone.
    """
    try:
        return attempt()
    except OSError as error:
        if is_gone(error):
            raise
        return f"{asking}: {_no_answer(error)}"


def _adjust(device: V4l2Device, what: _Adjustable, asked: int | Auto) -> str | None:
    """Set one value or its automatic mode; return a sentence if that was refused."""
    automatic = device.control(what.automatic)
    if asked == "auto":
        if automatic is None:
            return f"{what.name} auto: this camera has no automatic {what.name}{_instead(what)}"
        return _switch(device, automatic, what.on, f"{what.name} auto")
    asking = f"{what.name} {asked}"
    control = next(filter(None, map(device.control, what.value)), None)
    if control is None:
        return f"{asking}: this camera has no {what.name} that can be set"
    # Before anything is changed: a refused value leaves the automatic mode as it was.
    if control.read_only or not control.takes(asked):
        return _set(device, control, asked, asking)
    if automatic is not None:
        trouble = _switch(device, automatic, what.off, f"{asking}, automatic {what.name} off")
        if trouble is not None:
            return trouble
    # Queried again, because the automatic mode sets or releases locks.
    return _set(device, device.control(control.id) or control, asked, asking)


def _instead(what: _Adjustable) -> str:
    return "; its automatic exposure may change the gain as well" if what is _GAIN else ""


def _switch(
    device: V4l2Device, automatic: Control, choices: Iterable[int], asking: str
) -> str | None:
    chosen = next((value for value in choices if automatic.takes(value)), None)
    if chosen is None:
        return f"{asking}: this camera only offers {automatic.range_text}"
    if not automatic.write_only and device.value(automatic.id) in choices:
        return None
    return _set(device, automatic, chosen, asking)


def _set(device: V4l2Device, control: Control, value: int, asking: str) -> str | None:
    """Set a control and check that it took the value; return a sentence if it did not."""
    if control.read_only:
        return f"{asking}: this camera reports it but does not let it be set"
    if not control.takes(value):
        return f"{asking}: this camera accepts {control.range_text}"
    if control.inactive:
        return (
            f"{asking}: an automatic function of this camera controls it and cannot be switched off"
        )
    if control.grabbed:
        return f"{asking}: it is currently locked by another program or an open stream; close it"
    try:
        device.set_value(control.id, value)
    except OSError as error:
        if is_gone(error):
            raise
        return f"{asking}: {_why_refused(error, control)}"
    if control.write_only:
        return None
    taken = device.value(control.id)
    return None if taken == value else f"{asking}: this camera set {taken} instead"


def _why_refused(error: OSError, control: Control) -> str:
    if error.errno == errno.ERANGE:
        return f"this camera accepts {control.range_text}"
    if error.errno == errno.EBUSY:
        return "this camera is in use by another program; close it"
    if error.errno in (errno.EACCES, errno.EPERM):
        return "this camera does not let it be set at the moment"
    if error.errno in (errno.EINVAL, errno.ENOTTY):
        return f"this camera rejects it, although it reports the range {control.range_text}"
    return _no_answer(error)


def _no_answer(error: OSError) -> str:
    return f"this camera did not answer ({error.strerror or error}); unplug it and plug it in again"


def _set_power_line(device: V4l2Device, asked: int | Auto, asking: str) -> str | None:
    control = device.control(layout.POWER_LINE_FREQUENCY)
    if control is None:
        return f"{asking}: this camera has no power-line flicker compensation"
    return _set(device, control, _POWER_LINE[asked], asking)


def _hold_rate(device: V4l2Device, asking: str) -> str | None:
    control = device.control(layout.EXPOSURE_MAY_LOWER_RATE)
    # An inactive control cannot lower the rate either.
    if control is None or control.inactive or device.value(control.id) == 0:
        return None
    return _set(device, control, 0, asking)


def _not_in_force(device: V4l2Device, settings: CameraSettings, now: Readback) -> Iterator[str]:
    """Yield sentences for the size, format and rate that were asked for and are not in force."""
    if now.size is None or now.pixel_format is None:
        return
    size = f"{now.size[0]}x{now.size[1]}"
    # Queried only if something differs: it takes hundreds of requests to the camera.
    modes = cache(partial(camera_modes, device))
    if settings.pixel_format not in (None, now.pixel_format):
        offered = ", ".join(dict.fromkeys(mode.pixel_format for mode in modes()))
        yield (
            f"format {settings.pixel_format}: this camera delivers {now.pixel_format}"
            f"{f'; it offers {offered}' if offered else ''}"
        )
    if settings.size not in (None, now.size):
        asked = f"{settings.size[0]}x{settings.size[1]}" if settings.size else ""
        offered = _sizes_offered(modes(), now.pixel_format)
        yield (
            f"size {asked}: this camera delivers {size}"
            f"{f'; in {now.pixel_format} it offers {offered}' if offered else ''}"
        )
    if settings.rate is not None and _other_rate(settings.rate, now.rate):
        offered = _rates_offered(modes(), now.pixel_format, now.size)
        yield (
            f"rate {rate_text(settings.rate)}/s: this camera delivers "
            f"{rate_text(now.rate or 0.0)}/s"
            f"{f'; at {size} in {now.pixel_format} it offers {offered}' if offered else ''}"
        )


def _other_rate(asked: float, now: float | None) -> bool:
    return now is not None and not math.isclose(asked, now, rel_tol=_RATE_TOLERANCE)


def _sizes_offered(modes: tuple[CameraMode, ...], pixel_format: str) -> str:
    return ", ".join(f"{m.width}x{m.height}" for m in modes if m.pixel_format == pixel_format)


def _rates_offered(modes: tuple[CameraMode, ...], pixel_format: str, size: tuple[int, int]) -> str:
    rates = next(
        (m.rates for m in modes if (m.pixel_format, m.width, m.height) == (pixel_format, *size)), ()
    )
    return ", ".join(f"{rate_text(rate)}/s" for rate in rates)
