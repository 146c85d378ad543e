"""The video devices of this machine: what they can do, and what stands in their way."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from observer.sources.cameras.device_files import Holder, User, holders, shown_path, text_in
from observer.sources.cameras.usb import UsbPlace, shared_bus_hints, usb_place
from observer.sources.cameras.v4l2 import layout
from observer.sources.cameras.v4l2.device import Control, DeviceAccess, LinuxAccess, V4l2Device
from observer.sources.cameras.v4l2.modes import CameraMode, camera_modes
from observer.sources.cameras.v4l2.opening import why_not

__all__ = ["CameraDevice", "Use", "list_devices", "shared_bus_hints"]

_MACHINE = Path("/")

# ``images``: a camera; ``metadata``: the second node that most cameras have; ``codec``,
# ``output``, ``other``: no cameras; ``unknown``: it could not be asked.
Use = Literal["images", "metadata", "codec", "output", "other", "unknown"]


@dataclass(frozen=True)
class CameraDevice:
    """One ``/dev/video*`` node.

    Attributes:
        path: as in ``/dev/video0``.
        by_path: its name by the port it is plugged into; stays when it is plugged in again.
        by_id: its name by maker and serial number; cameras of one model without serial numbers
            share it, so that only one of them is reached by it.
        use: what the node delivers.
        card, driver, bus: names, None where it could not be asked.
        modes: what images it offers. controls: what can be set, with ranges.
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
        """Whether it delivers images."""
        return self.use == "images"

    @property
    def stable_path(self) -> str:
        """The name by which it is best opened: that of its port, where it has one."""
        return self.by_path or self.path


def list_devices(
    root: Path = _MACHINE, access: DeviceAccess | None = None, user: User | None = None
) -> tuple[CameraDevice, ...]:
    """All video nodes in the order of their numbers. A bad one tells its trouble, none raises.

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
        card=_card_in_sysfs(file.name, root),
        usb=usb_place(file.name, root),
        used_by=holders(file, root),
    )
    try:
        with V4l2Device(file, access) as device:
            return _asked(known, device, file, root)
    except OSError as error:
        return replace(known, trouble=why_not(file, error, root, user))


def _asked(known: CameraDevice, device: V4l2Device, file: Path, root: Path) -> CameraDevice:
    """What is known, with what the opened device tells; a device that breaks off keeps the rest.

    Raises:
        OSError: it does not even tell who it is.
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
        who = ", ".join(f"{each.name} (process {each.process})" for each in known.used_by)
        return replace(
            known,
            trouble=f"{known.path} is open in {who}, and delivers images to one program at a "
            f"time; close it there",
        )
    if not known.modes:
        return replace(
            known,
            trouble=f"{known.path} names no pixel format; what its driver needs to deliver images "
            f"(a media controller, libcamera) is not supported here",
        )
    return known


def _use(capabilities: int) -> Use:
    if capabilities & (layout.IS_CODEC | layout.IS_CODEC_MULTIPLANAR):
        return "codec"
    images = capabilities & (layout.CAN_CAPTURE | layout.CAN_CAPTURE_MULTIPLANAR)
    output = capabilities & (layout.CAN_OUTPUT | layout.CAN_OUTPUT_MULTIPLANAR)
    if images:
        # A loopback says output as well.
        return "images"
    if capabilities & layout.CAN_CAPTURE_METADATA:
        return "metadata"
    return "output" if output else "other"


def _links(root: Path, kind: str) -> dict[str, str]:
    """Device -> the name that udev gave it, the plainest where there are several."""
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


def _card_in_sysfs(node: str, root: Path) -> str | None:
    """The card's name as told without opening it."""
    return text_in(root / "sys/class/video4linux" / node / "name") or None
