"""Where on USB a camera is, and whether what shares a bus fits on it."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from observer.sources.cameras.device_files import text_in
from observer.sources.cameras.v4l2.modes import CameraMode

# What USB 2.0 (480 Mbit/s) carries of images, after protocol and reserved time: known from use.
_USB2_MBIT = 480.0
_USB2_USABLE_MB = (35, 40)
# YUYV: 4 bytes for 2 pixels.
_YUYV_BYTES_PER_PIXEL = 2
_EXAMPLE = (640, 480, 30)


@dataclass(frozen=True)
class UsbPlace:
    """Where on USB a device is.

    Attributes:
        bus: number of the bus. controller: the host controller's address, as in ``0000:00:14.0``.
        port: the way from the controller to the device, as in ``1-2.3``.
        speed_mbit: what the device runs at, Mbit/s; None where it is not known.
        device: folder of the device below the file system's root; nodes of one camera share it.
    """

    bus: int
    controller: str
    port: str
    speed_mbit: float | None
    device: str


class OnUsb(Protocol):
    """What is asked of a camera here."""

    @property
    def path(self) -> str: ...
    @property
    def can_capture(self) -> bool: ...
    @property
    def usb(self) -> UsbPlace | None: ...
    @property
    def modes(self) -> tuple[CameraMode, ...]: ...


def usb_place(node: str, root: Path) -> UsbPlace | None:
    """Where the video node (as in ``video0``) is on USB; None where it is not, or not told."""
    try:
        folder = (root / "sys/class/video4linux" / node / "device").resolve(strict=True)
    except OSError:
        return None
    for device in (folder, *folder.parents):
        bus = text_in(device / "busnum")
        if bus is not None and bus.isdecimal():
            speed = text_in(device / "speed") or ""
            return UsbPlace(
                bus=int(bus),
                controller=_controller(device, int(bus)),
                port=device.name,
                speed_mbit=float(speed) if speed.replace(".", "", 1).isdecimal() else None,
                device=str(device.relative_to(root.resolve())),
            )
    return None


def _controller(device: Path, bus: int) -> str:
    hub = next((each for each in device.parents if each.name == f"usb{bus}"), device)
    return hub.parent.name


def yuyv_rate_mb(width: int, height: int, rate: float) -> float:
    """Megabytes per second of uncompressed YUYV images."""
    return width * height * _YUYV_BYTES_PER_PIXEL * rate / 1e6


def shared_bus_hints(cameras: Iterable[OnUsb]) -> tuple[str, ...]:
    """One sentence for each USB 2 bus that several cameras share.

    The nodes of one camera count once: who has two views in one device has one that fits them.
    """
    buses: dict[tuple[str, int], dict[str, OnUsb]] = {}
    for camera in cameras:
        place = camera.usb
        if camera.can_capture and place and (place.speed_mbit or _USB2_MBIT) <= _USB2_MBIT:
            buses.setdefault((place.controller, place.bus), {}).setdefault(place.device, camera)
    return tuple(
        _hint(bus, controller, list(sharing.values()))
        for (controller, bus), sharing in sorted(buses.items())
        if len(sharing) > 1
    )


def _hint(bus: int, controller: str, cameras: Sequence[OnUsb]) -> str:
    each = yuyv_rate_mb(*_EXAMPLE)
    width, height, rate = _EXAMPLE
    names = ", ".join(camera.path for camera in cameras[:-1]) + f" and {cameras[-1].path}"
    low, high = _USB2_USABLE_MB
    together = each * len(cameras)
    lacking = [
        camera.path
        for camera in cameras
        if camera.modes and not any(mode.pixel_format == "MJPG" for mode in camera.modes)
    ]
    what = (
        f"choose a smaller size or rate ({', '.join(lacking)}: no MJPG)"
        if lacking
        else "take compressed images with format=MJPG"
    )
    return (
        f"{names} share one USB 2 bus (bus {bus} of the controller {controller}), which carries "
        f"about {low} to {high} MB/s: uncompressed (YUYV) {width}x{height} at {rate}/s takes "
        f"{each:.1f} MB/s each, {together:.1f} MB/s together, which "
        f"{'fits barely, if at all' if together <= high else 'does not fit'}; {what}, "
        f"or plug one camera into a port of another controller"
    )
