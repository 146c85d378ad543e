"""One opened video device: queries and answers in Python types.

The kernel is reached only through ``DeviceAccess``, so that tests can put a device of their own
in its place.
"""

from __future__ import annotations

import ctypes
import errno
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Protocol, Self, TypeVar

from observer.sources.cameras.v4l2 import layout

_Answer = TypeVar("_Answer", bound=ctypes.Structure)

# More than any device has; some drivers never report the end of a list.
_MOST_ITEMS = 512
# All controls that are set here; queried one by one where a driver does not enumerate them.
KNOWN_CONTROLS = (
    layout.AUTO_WHITE_BALANCE,
    layout.EXPOSURE_IN_DRIVER_UNITS,
    layout.AUTO_GAIN,
    layout.GAIN,
    layout.POWER_LINE_FREQUENCY,
    layout.WHITE_BALANCE_TEMPERATURE,
    layout.AUTO_EXPOSURE,
    layout.EXPOSURE,
    layout.EXPOSURE_MAY_LOWER_RATE,
    layout.FOCUS,
    layout.AUTO_FOCUS,
)
_KINDS = {
    layout.TYPE_INTEGER: "integer",
    layout.TYPE_BOOLEAN: "boolean",
    layout.TYPE_MENU: "menu",
    layout.TYPE_BUTTON: "button",
    layout.TYPE_INTEGER64: "integer64",
    layout.TYPE_STRING: "text",
    layout.TYPE_BITMASK: "bits",
    layout.TYPE_INTEGER_MENU: "integer menu",
}


class DeviceAccess(Protocol):
    """Device files of the kernel. All methods may raise OSError."""

    def open(self, path: Path) -> int:
        """Return a descriptor for queries and settings."""
        ...

    def close(self, descriptor: int) -> None: ...

    def ioctl(self, descriptor: int, request: int, argument: ctypes.Structure) -> None:
        """Send a request; the answer is written into ``argument``."""
        ...

    def may_use(self, path: Path) -> bool:
        """Return whether this process may read and write the file, found without opening it."""
        ...


class LinuxAccess:
    """``DeviceAccess`` on this machine."""

    def open(self, path: Path) -> int:
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def close(self, descriptor: int) -> None:
        os.close(descriptor)

    def ioctl(self, descriptor: int, request: int, argument: ctypes.Structure) -> None:
        import fcntl  # not on every system that can read recordings

        while True:
            try:
                fcntl.ioctl(descriptor, request, argument, True)
            except InterruptedError:
                continue
            return

    def may_use(self, path: Path) -> bool:
        return os.access(path, os.R_OK | os.W_OK)


@dataclass(frozen=True)
class Identity:
    """Identity that a device reports.

    Attributes:
        driver, card, bus: names, as in ``uvcvideo``, ``HD Webcam``, ``usb-0000:00:14.0-2``.
        capabilities: bits of this node (``layout.CAN_CAPTURE`` ...).
    """

    driver: str
    card: str
    bus: str
    capabilities: int


@dataclass(frozen=True)
class Control:
    """One control of a camera.

    Attributes:
        id: the kernel's number. name: the driver's name for it.
        kind: ``integer``, ``boolean``, ``menu``, ``integer menu``, ``button``, ``bits`` ...
        minimum, maximum, step, default: in the control's own unit.
        inactive: an automatic mode controls it at present.
        grabbed: locked while images flow. read_only, write_only: as named.
        volatile: the camera changes it by itself.
        menu: value -> its name, for menus.
    """

    id: int
    name: str
    kind: str
    minimum: int
    maximum: int
    step: int
    default: int
    inactive: bool = False
    grabbed: bool = False
    read_only: bool = False
    write_only: bool = False
    volatile: bool = False
    menu: Mapping[int, str] = field(default_factory=dict)

    @property
    def range_text(self) -> str:
        """Range for people: ``3 to 2047``, ``0 to 250 in steps of 5``."""
        if self.kind in ("menu", "integer menu"):
            return ", ".join(f"{value} ({name})" for value, name in self.menu.items())
        if self.kind == "boolean":
            return "on or off"
        steps = f" in steps of {self.step}" if self.step > 1 else ""
        return f"{self.minimum} to {self.maximum}{steps}"

    def takes(self, value: int) -> bool:
        """Return whether the value is in its range and on its step."""
        if self.kind in ("menu", "integer menu"):
            return value in self.menu
        if not self.minimum <= value <= self.maximum:
            return False
        return self.step <= 1 or (value - self.minimum) % self.step == 0


class V4l2Device:
    """One device file, open. Every method may raise OSError: cameras get unplugged.

    Args:
        path: the file to open, as in ``/dev/video0``.
        access: the kernel.
    """

    def __init__(self, path: Path, access: DeviceAccess) -> None:
        self._access = access
        self._descriptor: int | None = access.open(path)
        self._buffer_type: int | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the descriptor; safe to call twice."""
        if self._descriptor is not None:
            descriptor, self._descriptor = self._descriptor, None
            self._access.close(descriptor)

    def identity(self) -> Identity:
        """Query its identity and what this node can do."""
        answer = layout.Capability()
        self._ask(layout.QUERY_CAPABILITY, answer)
        # Old drivers lack the flag; their node and device have the same capabilities.
        own = answer.capabilities & layout.HAS_DEVICE_CAPABILITIES
        return Identity(
            driver=layout.text_of(answer.driver),
            card=layout.text_of(answer.card),
            bus=layout.text_of(answer.bus_info),
            capabilities=answer.device_caps if own else answer.capabilities,
        )

    @property
    def buffer_type(self) -> int:
        """Buffer type that format queries must name."""
        if self._buffer_type is None:
            capabilities = self.identity().capabilities
            self._buffer_type = (
                layout.BUFFER_CAPTURE
                if capabilities & layout.CAN_CAPTURE
                else layout.BUFFER_CAPTURE_MULTIPLANAR
            )
        return self._buffer_type

    def size_and_format(self) -> tuple[tuple[int, int], str]:
        """Query the current image: (width, height) in pixels and its format's four characters."""
        answer = layout.Format(type=self.buffer_type)
        self._ask(layout.GET_FORMAT, answer)
        image = answer.fmt.pix
        return (image.width, image.height), layout.fourcc_text(image.pixelformat)

    def rate(self) -> float | None:
        """Query the current frames per second; None where the driver does not know."""
        answer = layout.StreamParameters(type=self.buffer_type)
        if not self._answers(layout.GET_PARAMETERS, answer):
            return None
        return rate_of(answer.parm.capture.timeperframe)

    def formats(self) -> Iterator[int]:
        """Yield the codes of the pixel formats."""
        asked = partial(layout.FormatDescription, type=self.buffer_type)
        for answer in self._listed(layout.ENUMERATE_FORMATS, asked):
            yield answer.pixelformat

    def sizes(self, pixel_format: int) -> Iterator[layout.FrameSize]:
        """Yield the sizes of a format, one by one or as ranges."""
        asked = partial(layout.FrameSize, pixel_format=pixel_format)
        return self._listed(layout.ENUMERATE_SIZES, asked)

    def intervals(
        self, pixel_format: int, width: int, height: int
    ) -> Iterator[layout.FrameInterval]:
        """Yield the frame intervals of a size, one by one or as ranges."""
        asked = partial(layout.FrameInterval, pixel_format=pixel_format, width=width, height=height)
        return self._listed(layout.ENUMERATE_INTERVALS, asked)

    def _listed(self, request: int, asked: Callable[..., _Answer]) -> Iterator[_Answer]:
        for index in range(_MOST_ITEMS):
            answer = asked(index=index)
            if not self._answers(request, answer):
                return
            yield answer

    def controls(self) -> tuple[Control, ...]:
        """Return all controls with their ranges, in the driver's order, without their values."""
        found: list[Control] = []
        last = 0
        for _ in range(_MOST_ITEMS):
            answer = layout.ControlQuery(id=last | layout.NEXT_CONTROL)
            if not self._answers(layout.QUERY_CONTROL, answer) or answer.id <= last:
                break
            last = answer.id
            found += filter(None, [self._control(answer)])
        if last == 0:
            found += filter(None, map(self.control, KNOWN_CONTROLS))
        return tuple(found)

    def control(self, number: int) -> Control | None:
        """Return one control as it is now; None where the camera has none of that number."""
        answer = layout.ControlQuery(id=number)
        if not self._answers(layout.QUERY_CONTROL, answer):
            return None
        return self._control(answer)

    def value(self, number: int) -> int:
        """Return the value that a control has now."""
        answer = layout.ControlValue(id=number)
        self._ask(layout.GET_CONTROL, answer)
        value: int = answer.value
        return value

    def set_value(self, number: int, value: int) -> None:
        """Set a control's value. Drivers may take another one; query ``value`` afterwards."""
        self._ask(layout.SET_CONTROL, layout.ControlValue(id=number, value=value))

    def _control(self, answer: layout.ControlQuery) -> Control | None:
        kind = _KINDS.get(answer.type)
        if kind is None or answer.flags & layout.FLAG_DISABLED:
            return None
        return Control(
            id=answer.id,
            name=layout.text_of(answer.name),
            kind=kind,
            minimum=answer.minimum,
            maximum=answer.maximum,
            step=answer.step,
            default=answer.default_value,
            inactive=bool(answer.flags & layout.FLAG_INACTIVE),
            grabbed=bool(answer.flags & layout.FLAG_GRABBED),
            read_only=bool(answer.flags & layout.FLAG_READ_ONLY),
            write_only=bool(answer.flags & layout.FLAG_WRITE_ONLY),
            volatile=bool(answer.flags & layout.FLAG_VOLATILE),
            menu=self._menu(answer, kind),
        )

    def _menu(self, query: layout.ControlQuery, kind: str) -> dict[int, str]:
        if kind not in ("menu", "integer menu"):
            return {}
        items = {}
        last = min(query.maximum, query.minimum + _MOST_ITEMS)
        for index in range(query.minimum, last + 1):
            answer = layout.MenuQuery(id=query.id, index=index)
            # Menus have gaps: an item that the camera lacks is answered with EINVAL.
            if self._answers(layout.QUERY_MENU, answer):
                named = kind == "menu"
                items[index] = layout.text_of(answer.name) if named else str(answer.value)
        return items

    def _answers(self, request: int, argument: ctypes.Structure) -> bool:
        """Send a request; return False if the driver says that there is no such item."""
        try:
            self._ask(request, argument)
        except OSError as error:
            if error.errno in (errno.EINVAL, errno.ENOTTY, errno.ENODATA):
                return False
            raise
        return True

    def _ask(self, request: int, argument: ctypes.Structure) -> None:
        if self._descriptor is None:
            raise OSError(errno.EBADF, "the device is closed")
        self._access.ioctl(self._descriptor, request, argument)


def is_gone(error: OSError) -> bool:
    """Return whether an error says that the camera itself is gone."""
    return error.errno in (errno.ENODEV, errno.ENXIO, errno.EBADF)


def rate_of(interval: layout.Fraction) -> float | None:
    """Return the rate, frames per second, of an interval; None if it is unknown."""
    if interval.numerator == 0 or interval.denominator == 0:
        return None
    rate: float = interval.denominator / interval.numerator
    return rate
