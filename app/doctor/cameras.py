"""Cameras: those present, their modes, and what prevents their use."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from itertools import groupby

from app.doctor.finding import Finding, Section
from observer.machine import Machine
from observer.sources.cameras.device_files import text_in
from observer.sources.cameras.devices import CameraDevice, list_devices, shared_bus_hints
from observer.sources.cameras.v4l2 import layout
from observer.sources.cameras.v4l2.modes import CameraMode

_SECTION = Section("Cameras")
_CONTAINER = "in a container pass it with --device /dev/video0 --group-add video"
_USB_VIDEO_CLASS = "0e"
_SIZES_SHOWN = 4
_SETTABLE = {
    layout.EXPOSURE: "exposure",
    layout.GAIN: "gain",
    layout.WHITE_BALANCE_TEMPERATURE: "white balance",
    layout.FOCUS: "focus",
}


def examine_cameras(machine: Machine) -> tuple[list[Finding], tuple[CameraDevice, ...]]:
    """Return the findings, and the devices that they are about."""
    if sys.platform != "linux":
        text = "cameras are listed on Linux only; network cameras and files work everywhere"
        return [_SECTION.warning(text)], ()
    devices = list_devices(machine.root, machine.access, machine.user)
    return list(_findings(machine, devices)), devices


def _findings(machine: Machine, devices: Sequence[CameraDevice]) -> Iterator[Finding]:
    main, further = _main_nodes(devices)
    if not main:
        yield _no_cameras(machine)
    for device in main:
        yield _camera(device)
    if further:
        listed = ", ".join(
            device.path + ("" if device.use == "unknown" else f" ({device.use})")
            for device in further
        )
        yield _SECTION.ok(f"other video nodes, which are not cameras: {listed}")
    hints = shared_bus_hints(devices)
    for hint in hints:
        yield _SECTION.warning(hint)
    usable = [device for device in main if device.trouble is None]
    if len(usable) > 1:
        yield _SECTION.ok(_as_a_pair(usable[0], usable[1], compressed=bool(hints)))


def _as_a_pair(left: CameraDevice, right: CameraDevice, *, compressed: bool) -> str:
    both_can = all(any(m.pixel_format == "MJPG" for m in each.modes) for each in (left, right))
    settings = "?format=MJPG" if compressed and both_can else ""
    source = f"camera:{left.stable_path},{right.stable_path}{settings}"
    return f"to use two of them as left and right: dynamic-observer serve '{source}'"


def _main_nodes(
    devices: Sequence[CameraDevice],
) -> tuple[list[CameraDevice], list[CameraDevice]]:
    """Return the nodes to report, and the others.

    A node that could not be queried stands for the other nodes of its camera: most cameras have a
    second node for metadata, which lacks the same permission.
    """
    main = [device for device in devices if device.use == "images"]
    spoken_for = {device.usb.device for device in main if device.usb}
    for device in devices:
        if device.use != "unknown":
            continue
        if device.usb is None or device.usb.device not in spoken_for:
            main.append(device)
            spoken_for |= {device.usb.device} if device.usb else set()
    main.sort(key=devices.index)
    return main, [device for device in devices if device not in main]


def _no_cameras(machine: Machine) -> Finding:
    if _usb_camera_connected(machine):
        return _SECTION.warning(
            f"a USB camera is connected but has no /dev/video*: load its driver with sudo "
            f"modprobe uvcvideo; {_CONTAINER}"
        )
    return _SECTION.ok(f"no camera is connected; {_CONTAINER}")


def _usb_camera_connected(machine: Machine) -> bool:
    interfaces = (machine.root / "sys/bus/usb/devices").glob("*/bInterfaceClass")
    return any(text_in(file) == _USB_VIDEO_CLASS for file in interfaces)


def _camera(device: CameraDevice) -> Finding:
    name = device.card or "a device"
    details = tuple(_details(device))
    if device.trouble is None:
        return _SECTION.ok(f"{name} ({device.path})", details)
    # Another program may close the device (and may be our own server); other faults prevent its
    # use.
    finding = _SECTION.warning if device.modes else _SECTION.problem
    return finding(f"{name}: {device.trouble}", details)


def _details(device: CameraDevice) -> Iterator[str]:
    if device.by_path:
        yield f"persistent name for this port: {device.by_path}"
    if device.usb:
        speed = f", {device.usb.speed_mbit:g} Mbit/s" if device.usb.speed_mbit else ""
        yield f"USB bus {device.usb.bus}, port {device.usb.port}{speed}"
    for pixel_format, modes in groupby(device.modes, key=lambda mode: mode.pixel_format):
        yield f"{pixel_format}: {_folded(list(modes))}"
    settable = [
        f"{_SETTABLE[control.id]} {control.range_text}"
        for control in device.controls
        if control.id in _SETTABLE
    ]
    if settable:
        yield f"settable: {', '.join(settable)}"


def _folded(modes: Sequence[CameraMode]) -> str:
    """Return the largest sizes with their highest rates, and always 640x480: most rigs use it."""
    shown = [mode for mode in modes if (mode.width, mode.height) == (640, 480)]
    for mode in sorted(modes, key=lambda mode: mode.width * mode.height, reverse=True):
        if len(shown) < _SIZES_SHOWN and mode not in shown:
            shown.append(mode)
    shown.sort(key=lambda mode: mode.width * mode.height)
    left = len(modes) - len(shown)
    texts = [
        f"{mode.width}x{mode.height}{f' at {mode.rates[0]:.3g}/s' if mode.rates else ''}"
        for mode in shown
    ]
    return ", ".join(texts) + (f" and {left} more sizes" if left else "")
