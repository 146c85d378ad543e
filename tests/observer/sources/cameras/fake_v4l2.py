"""Fake video devices at the kernel interface: tables that answer requests in raw bytes.

Nothing here uses the layout under test: requests and offsets are written out as in the
64-bit kernel's header.
"""

from __future__ import annotations

import ctypes
import errno
import os
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

CAPTURE, METADATA, DEVICE_CAPS = 0x1, 0x00800000, 0x80000000
INTEGER, BOOLEAN, MENU, CLASS, INTEGER_MENU = 1, 2, 3, 6, 9
DISABLED, GRABBED, READ_ONLY, INACTIVE, VOLATILE = 0x1, 0x2, 0x4, 0x10, 0x80
NEXT = 0x80000000

AUTO_WHITE_BALANCE, AUTO_GAIN, GAIN = 0x98090C, 0x980912, 0x980913
POWER_LINE, WHITE_BALANCE, USER_CLASS = 0x980918, 0x98091A, 0x980001
AUTO_EXPOSURE, EXPOSURE, MAY_LOWER_RATE = 0x9A0901, 0x9A0902, 0x9A0903
FOCUS, AUTO_FOCUS = 0x9A090A, 0x9A090C


@dataclass
class FakeControl:
    """One control; ``moved`` maps a requested value to the one the device takes."""

    kind: int
    name: str
    low: int
    high: int
    step: int = 1
    value: int = 0
    flags: int = 0
    menu: dict[int, str | int] = field(default_factory=dict)
    moved: Callable[[int], int] = lambda value: value
    fails: int | None = None


@dataclass
class FakeCamera:
    """One node.

    Attributes:
        formats: four characters -> size -> intervals as (numerator, denominator); an interval
            list that is a pair of tuples of 3 is a range.
        governed: automatic control -> (values that turn it off, the control it governs).
        old_driver: no device_caps, no NEXT flag. repeats: lists its last control forever.
        fails: number of a request -> errno.
    """

    card: str = "HD Webcam"
    driver: str = "uvcvideo"
    bus: str = "usb-0000:00:14.0-1"
    capabilities: int = CAPTURE
    formats: dict[str, dict[tuple[int, int], list[tuple[int, int]]]] = field(default_factory=dict)
    stepwise: tuple[int, int, int, int, int, int] | None = None
    interval_range: tuple[tuple[int, int], tuple[int, int]] | None = None
    current: tuple[str, int, int] = ("MJPG", 640, 480)
    interval: tuple[int, int] = (1, 30)
    controls: dict[int, FakeControl] = field(default_factory=dict)
    governed: dict[int, tuple[tuple[int, ...], tuple[int, ...]]] = field(default_factory=dict)
    old_driver: bool = False
    repeats: bool = False
    fails: dict[int, int] = field(default_factory=dict)

    def flags_of(self, number: int) -> int:
        flags = self.controls[number].flags
        for automatic, (off, governed) in self.governed.items():
            if number in governed and self.controls[automatic].value not in off:
                flags |= INACTIVE
        return flags


def webcam(card: str = "HD Webcam", bus: str = "usb-0000:00:14.0-1") -> FakeCamera:
    """Return a typical webcam: exposure automatic by aperture priority, fixed focus, and no
    control named automatic gain."""
    return FakeCamera(
        card=card,
        bus=bus,
        formats={
            "MJPG": {(640, 480): [(1, 30), (1, 15)], (1280, 720): [(1, 30)]},
            "YUYV": {(1280, 720): [(1, 10)], (640, 480): [(1, 30), (1, 15)]},
        },
        controls={
            USER_CLASS: FakeControl(CLASS, "User Controls", 0, 0, flags=READ_ONLY),
            AUTO_WHITE_BALANCE: FakeControl(BOOLEAN, "White Balance, Automatic", 0, 1, value=1),
            GAIN: FakeControl(INTEGER, "Gain", 0, 100, value=10),
            POWER_LINE: FakeControl(
                MENU, "Power Line Frequency", 0, 2, value=2,
                menu={0: "Disabled", 1: "50 Hz", 2: "60 Hz"},
            ),
            WHITE_BALANCE: FakeControl(
                INTEGER, "White Balance Temperature", 2800, 6500, 10, value=4600
            ),
            AUTO_EXPOSURE: FakeControl(
                MENU, "Auto Exposure", 0, 3, value=3,
                menu={1: "Manual Mode", 3: "Aperture Priority Mode"},
            ),
            EXPOSURE: FakeControl(INTEGER, "Exposure Time, Absolute", 3, 2047, value=156),
            MAY_LOWER_RATE: FakeControl(BOOLEAN, "Exposure, Dynamic Framerate", 0, 1, value=1),
        },
        governed={
            AUTO_WHITE_BALANCE: ((0,), (WHITE_BALANCE,)),
            AUTO_EXPOSURE: ((1, 2), (EXPOSURE,)),
        },
    )  # fmt: skip


def metadata_node() -> FakeCamera:
    """Return the second node of a webcam."""
    return FakeCamera(capabilities=METADATA)


@dataclass
class FakeKernel:
    """Answers for cameras; ``at`` maps node names, as in ``video0``, to them."""

    at: dict[str, FakeCamera]
    denied: set[str] = field(default_factory=set)
    refused: dict[str, int] = field(default_factory=dict)
    opened: dict[int, FakeCamera] = field(default_factory=dict)
    next_descriptor: int = 1000
    was_set: list[tuple[int, int]] = field(default_factory=list)

    def open(self, path: Path) -> int:
        file = path.resolve(strict=True)
        if file.name in self.denied:
            raise OSError(errno.EACCES, os.strerror(errno.EACCES))
        if file.name in self.refused:
            code = self.refused[file.name]
            raise OSError(code, os.strerror(code))
        self.next_descriptor += 1
        self.opened[self.next_descriptor] = self.at[file.name]
        return self.next_descriptor

    def close(self, descriptor: int) -> None:
        del self.opened[descriptor]

    def may_use(self, path: Path) -> bool:
        return path.resolve().name not in self.denied

    def ioctl(self, descriptor: int, request: int, argument: ctypes.Structure) -> None:
        camera = self.opened[descriptor]
        code = camera.fails.get(request & 0xFF)
        answer = _ANSWERS.get(request)
        if code is not None or answer is None:
            raise _error(code or errno.ENOTTY)
        answer(self, camera, memoryview(argument).cast("B"))


def _error(code: int) -> OSError:
    return OSError(code, os.strerror(code))


def _text(value: str, length: int) -> bytes:
    return value.encode()[: length - 1].ljust(length, b"\0")


def _code(name: str) -> int:
    return int.from_bytes(name.encode(), "little")


def _item(items: list, index: int):  # type: ignore[no-untyped-def, type-arg]
    if index >= len(items):
        raise _error(errno.EINVAL)
    return items[index]


def _capability(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    whole = camera.capabilities | (0 if camera.old_driver else METADATA | DEVICE_CAPS)
    struct.pack_into(
        "=16s32s32sIII12x", bytes_, 0,
        _text(camera.driver, 16), _text(camera.card, 32), _text(camera.bus, 32),
        0x060100, whole, 0 if camera.old_driver else camera.capabilities,
    )  # fmt: skip


def _format_description(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    index, kind = struct.unpack_from("=II", bytes_)
    if kind != 1:
        raise _error(errno.EINVAL)
    name = _item(list(camera.formats), index)
    struct.pack_into("=III32sI", bytes_, 0, index, kind, 0, _text(f"as {name}", 32), _code(name))


def _size(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    index, code = struct.unpack_from("=II", bytes_)
    sizes = {_code(name): sizes for name, sizes in camera.formats.items()}[code]
    if camera.stepwise is not None:
        if index:
            raise _error(errno.EINVAL)
        struct.pack_into("=I6I", bytes_, 8, 3, *camera.stepwise)
        return
    struct.pack_into("=III", bytes_, 8, 1, *_item(list(sizes), index))


def _interval(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    index, code, width, height = struct.unpack_from("=IIII", bytes_)
    if camera.interval_range is not None:
        if index:
            raise _error(errno.EINVAL)
        shortest, longest = camera.interval_range
        struct.pack_into("=I6I", bytes_, 16, 2, *shortest, *longest, 1, 1)
        return
    sizes = {_code(name): sizes for name, sizes in camera.formats.items()}[code]
    struct.pack_into("=III", bytes_, 16, 1, *_item(sizes[width, height], index))


def _format(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    name, width, height = camera.current
    struct.pack_into("=III", bytes_, 8, width, height, _code(name))


def _parameters(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    struct.pack_into("=II", bytes_, 12, *camera.interval)


def _query_control(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    (number,) = struct.unpack_from("=I", bytes_)
    if number & NEXT:
        later = sorted(each for each in camera.controls if each > number & ~NEXT)
        if camera.repeats and not later:
            later = [max(camera.controls)]
        if camera.old_driver or not later:
            raise _error(errno.EINVAL)
        number = later[0]
    if number not in camera.controls:
        raise _error(errno.EINVAL)
    control = camera.controls[number]
    struct.pack_into(
        "=II32siiiiI8x", bytes_, 0, number, control.kind, _text(control.name, 32),
        control.low, control.high, control.step, control.low, camera.flags_of(number),
    )  # fmt: skip


def _query_menu(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    number, index = struct.unpack_from("=II", bytes_)
    menu = camera.controls[number].menu
    if index not in menu:
        raise _error(errno.EINVAL)
    item = menu[index]
    if isinstance(item, int):
        struct.pack_into("=q", bytes_, 8, item)
    else:
        struct.pack_into("=32s", bytes_, 8, _text(item, 32))


def _accessible(camera: FakeCamera, number: int) -> FakeControl:
    if number not in camera.controls:
        raise _error(errno.EINVAL)
    control = camera.controls[number]
    if control.fails is not None:
        raise _error(control.fails)
    return control


def _get_control(_: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    (number,) = struct.unpack_from("=I", bytes_)
    struct.pack_into("=i", bytes_, 4, _accessible(camera, number).value)


def _set_control(kernel: FakeKernel, camera: FakeCamera, bytes_: memoryview) -> None:
    number, value = struct.unpack_from("=Ii", bytes_)
    control = _accessible(camera, number)
    if camera.flags_of(number) & READ_ONLY:
        raise _error(errno.EACCES)
    if control.kind in (MENU, INTEGER_MENU) and value not in control.menu:
        raise _error(errno.EINVAL)
    kernel.was_set.append((number, value))
    # Like the kernel, silently clamp a value out of range.
    if not camera.flags_of(number) & INACTIVE:
        control.value = control.moved(max(control.low, min(control.high, value)))


_ANSWERS = {
    0x80685600: _capability,
    0xC0405602: _format_description,
    0xC0D05604: _format,
    0xC0CC5615: _parameters,
    0xC008561B: _get_control,
    0xC008561C: _set_control,
    0xC0445624: _query_control,
    0xC02C5625: _query_menu,
    0xC02C564A: _size,
    0xC034564B: _interval,
}
