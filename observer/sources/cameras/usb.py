"""Place of cameras on USB, and hints on overloaded buses."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from observer.sources.cameras.device_files import text_in

_USB_2_MBIT = 480.0
# A USB 2 bus carries 60 MB/s, of which 80 % may be reserved for cameras, and each camera reserves
# more than it sends: the next larger of the steps that it offers.
_TOO_MUCH_BYTES_PER_S = 30e6
_COMPRESSED = frozenset({"MJPG", "JPEG", "H264", "HEVC"})
# Compression ratio of MJPG over 2 bytes per pixel, for textured images.
_COMPRESSION = 6.0


@dataclass(frozen=True)
class UsbPlace:
    """Place of a device on USB.

    Attributes:
        bus: number of the bus. controller: the host controller's address, as in ``0000:00:14.0``.
        port: the path from the controller to the device, as in ``1-2.3``.
        speed_mbit: what the device runs at, Mbit/s; None where it is not known.
        device: folder of the device below the file system's root; nodes of one camera share it.
    """

    bus: int
    controller: str
    port: str
    speed_mbit: float | None
    device: str

    @property
    def usb_2_bus(self) -> tuple[str, int] | None:
        """Controller and bus if the device is, or may be, on USB 2; else None."""
        return None if (self.speed_mbit or 0) > _USB_2_MBIT else (self.controller, self.bus)


def usb_place(node: str, root: Path) -> UsbPlace | None:
    """Return the place of a video node (as in ``video0``) on USB; None where it has none."""
    try:
        folder = (root / "sys/class/video4linux" / node / "device").resolve(strict=True)
    except OSError:
        return None
    for device in (folder, *folder.parents):
        bus = text_in(device / "busnum")
        if bus is not None and bus.isdecimal():
            speed = text_in(device / "speed") or ""
            hub = next((each for each in device.parents if each.name == f"usb{int(bus)}"), device)
            return UsbPlace(
                bus=int(bus),
                controller=hub.parent.name,
                port=device.name,
                speed_mbit=float(speed) if speed.replace(".", "", 1).isdecimal() else None,
                device=str(device.relative_to(root.resolve())),
            )
    return None


def bandwidth_hints(
    devices: Sequence[str],
    *,
    width: int,
    height: int,
    rate: float,
    pixel_format: str | None,
    root: Path = Path("/"),
) -> tuple[str, ...]:
    """Return sentences for the person who sets up two open cameras; none if all is well.

    Args:
        devices: paths of both.
        width, height: of each image, pixels. rate: frames per second.
        pixel_format: four characters, None where unknown.
        root: the machine's file system.
    """
    places = [
        usb_place(Path(os.path.realpath(root / device.lstrip("/"))).name, root)
        for device in devices
    ]
    buses = {place and place.usb_2_bus for place in places}
    if len(buses) != 1 or None in buses:
        return ()
    total = len(devices) * 2.0 * width * height * rate
    is_compressed = pixel_format in _COMPRESSED
    if is_compressed:
        total /= _COMPRESSION
    if total < _TOO_MUCH_BYTES_PER_S:
        return ()
    remedy = (
        "use a smaller size or a lower rate"
        if is_compressed
        else "set format=MJPG or a smaller size"
    )
    return (
        f"both cameras share one USB 2 bus and send about {total / 1e6:.0f} MB/s, which may be "
        f"too much for it; {remedy}, or plug one of them into a port of another controller",
    )
