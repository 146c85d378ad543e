"""Video devices of this machine: what they can do, and what keeps them from being used."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from observer.sources.cameras.device_files import (
    MACHINE,
    Holder,
    User,
    holders,
    in_words,
    shown_path,
    text_in,
    why_not,
)
from observer.sources.cameras.usb import UsbPlace, usb_place
from observer.sources.cameras.v4l2 import layout
from observer.sources.cameras.v4l2.device import Control, DeviceAccess, LinuxAccess, V4l2Device
from observer.sources.cameras.v4l2.modes import CameraMode, camera_modes

# MB/s of images that USB 2.0 (480 Mbit/s) carries, less protocol and reserved time: empirical.
_USB_2_USABLE_MB = (35, 40)
# YUYV: 4 bytes for 2 pixels.
_YUYV_BYTES_PER_PIXEL = 2
_EXAMPLE = (640, 480, 30)

# ``images``: a camera; ``metadata``: the second node that most cameras have; ``codec``,
# ``output``, ``other``: not a camera; ``unknown``: the node could not be queried.
Use = Literal["images", "metadata", "codec", "output", "other", "unknown"]


@dataclass(frozen=True)
class CameraDevice:
    """One ``/dev/video*`` node.

    Attributes:
        path: as in ``/dev/video0``.
        by_path: its name by the port it is plugged into; the same after it is plugged in again.
        by_id: its name by maker and serial number; cameras of one model without serial numbers
            share it, so only one of them can be reached by it.
        use: what the node delivers.
        card, driver, bus: names, None where the node could not be queried.
        modes: which images it offers. controls: what can be set, with ranges.
        usb: where on USB it is, None elsewhere.
        used_by: other processes that have it open, as far as this user may see.
        trouble: one sentence that says why it cannot be used and what to do; None where it can.
    """

    path: str
    by_path: str | None = None
    by_id: str | None = None
    use: Use = "unknown"
    card: str | None = None
    driver: str | None = None
    bus: str | None = None
    modes: tuple[CameraMode, ...] = ()
    controls: tuple[Control, ...] = ()
    usb: UsbPlace | None = None
    used_by: tuple[Holder, ...] = ()
    trouble: str | None = None

    @property
    def can_capture(self) -> bool:
        """Return whether it delivers images."""
        return self.use == "images"

    @property
    def stable_path(self) -> str:
        """Best name to open it by: that of its port, where it has one."""
        return self.by_path or self.path


def list_devices(
    root: Path = MACHINE, access: DeviceAccess | None = None, user: User | None = None
) -> tuple[CameraDevice, ...]:
    """Return all video nodes in numerical order. A bad one has its trouble noted; none raises.

    Args:
        root: the machine's file system. access: its kernel; None for this one.
        user: whom advice on permissions is for; None for the user of this process.
    """
    try:
        names = [file.name for file in (root / "dev").iterdir()]
    except OSError:
        return ()
    numbers = sorted(int(name[5:]) for name in names if re.fullmatch(r"video[0-9]+", name))
    by_path, by_id = _links(root, "by-path"), _links(root, "by-id")
    kernel = access or LinuxAccess()
    devices = []
    for number in numbers:
        path = f"/dev/video{number}"
        named = CameraDevice(path, by_path.get(path), by_id.get(path))
        devices.append(_device(named, root / "dev" / f"video{number}", root, kernel, user))
    return tuple(devices)


def _device(
    named: CameraDevice, file: Path, root: Path, access: DeviceAccess, user: User | None
) -> CameraDevice:
    known = replace(
        named,
        # Its name, readable without opening it.
        card=text_in(root / "sys/class/video4linux" / file.name / "name") or None,
        usb=usb_place(file.name, root),
        used_by=holders(file, root),
    )
    try:
        with V4l2Device(file, access) as device:
            return _asked(known, device, file, root)
    except OSError as error:
        return replace(known, trouble=why_not(file, error, root, user))


def _asked(known: CameraDevice, device: V4l2Device, file: Path, root: Path) -> CameraDevice:
    """Return what is known, completed by what the opened device reports.

    Raises:
        OSError: it does not even report its identity.
    """
    identity = device.identity()
    known = replace(
        known,
        use=_use(identity.capabilities),
        card=identity.card or known.card,
        driver=identity.driver or None,
        bus=identity.bus or None,
    )
    if not known.can_capture:
        return known
    try:
        known = replace(known, modes=camera_modes(device), controls=device.controls())
    except OSError as error:
        return replace(known, trouble=why_not(file, error, root))
    if known.used_by:
        return replace(
            known,
            trouble=f"{known.path} is open in {in_words(known.used_by)}, and a camera delivers "
            "images to only one program at a time; close it there",
        )
    if not known.modes:
        return replace(
            known,
            trouble=f"{known.path} reports no pixel format; its driver needs a media controller "
            "(libcamera), which is not supported",
        )
    return known


def _use(capabilities: int) -> Use:
    if capabilities & (layout.IS_CODEC | layout.IS_CODEC_MULTIPLANAR):
        return "codec"
    # Before output, which a loopback device also reports.
    if capabilities & (layout.CAN_CAPTURE | layout.CAN_CAPTURE_MULTIPLANAR):
        return "images"
    if capabilities & layout.CAN_CAPTURE_METADATA:
        return "metadata"
    output = capabilities & (layout.CAN_OUTPUT | layout.CAN_OUTPUT_MULTIPLANAR)
    return "output" if output else "other"


def _links(root: Path, kind: str) -> dict[str, str]:
    """Return device -> the name that udev gave it, the shortest of several."""
    found: dict[str, str] = {}
    try:
        links = sorted((root / "dev" / "v4l" / kind).iterdir(), key=lambda each: len(each.name))
    except OSError:
        return found
    for link in links:
        try:
            device = shown_path(link.resolve(strict=True), root.resolve())
        except (OSError, ValueError):
            continue  # its device is gone
        found.setdefault(device, shown_path(link, root))
    return found


def shared_bus_hints(cameras: Iterable[CameraDevice]) -> tuple[str, ...]:
    """Return one sentence for each USB 2 bus that several cameras share.

    The nodes of one device count once: a device with two views is designed to transfer both.
    """
    buses: dict[tuple[str, int], dict[str, CameraDevice]] = {}
    for camera in cameras:
        place = camera.usb
        if camera.can_capture and place and (bus := place.usb_2_bus):
            buses.setdefault(bus, {}).setdefault(place.device, camera)
    return tuple(
        _hint(number, controller, list(sharing.values()))
        for (controller, number), sharing in sorted(buses.items())
        if len(sharing) > 1
    )


def _hint(bus: int, controller: str, cameras: Sequence[CameraDevice]) -> str:
    width, height, rate = _EXAMPLE
    each = width * height * _YUYV_BYTES_PER_PIXEL * rate / 1e6
    names = ", ".join(camera.path for camera in cameras[:-1]) + f" and {cameras[-1].path}"
    low, high = _USB_2_USABLE_MB
    together = each * len(cameras)
    lacking = [
        camera.path
        for camera in cameras
        if camera.modes and not any(mode.pixel_format == "MJPG" for mode in camera.modes)
    ]
    what = (
        f"choose a smaller size or rate ({', '.join(lacking)}: no MJPG)"
        if lacking
        else "use compressed images with format=MJPG"
    )
    return (
        f"{names} share one USB 2 bus (bus {bus} of the controller {controller}), which carries "
        f"about {low} to {high} MB/s: uncompressed (YUYV) {width}x{height} at {rate} fps needs "
        f"{each:.1f} MB/s per camera, {together:.1f} MB/s in total, which "
        f"{'fits barely, if at all' if together <= high else 'does not fit'}; {what}, or plug one "
        "camera into a port of another controller"
    )
