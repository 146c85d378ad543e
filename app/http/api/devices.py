"""The cameras and serial ports that are plugged into the server's machine."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter

from app.contract.devices import DeviceControl, DeviceMode, Devices, SerialPortNow, VideoDevice
from app.contract.values import filled
from observer.machine import Machine
from observer.robots.serial_ports import find_serial_ports
from observer.sources.cameras.devices import CameraDevice, list_devices, shared_bus_hints

router = APIRouter(tags=["source"])


@router.get("/devices", summary="Cameras and serial ports")
async def get_devices() -> Devices:
    """Searched at every request; no serial port is opened. Unusable devices say why."""
    devices = await asyncio.to_thread(list_devices)
    ports = await asyncio.to_thread(find_serial_ports, Machine())
    cameras = [_entry(each) for each in devices if each.can_capture or each.trouble]
    return Devices(
        cameras=cameras,
        serial_ports=[filled(SerialPortNow, each) for each in ports],
        hints=shared_bus_hints(devices),
    )


def _entry(device: CameraDevice) -> VideoDevice:
    return filled(
        VideoDevice,
        device,
        modes=[filled(DeviceMode, mode) for mode in device.modes],
        controls=[filled(DeviceControl, control) for control in device.controls],
    )
