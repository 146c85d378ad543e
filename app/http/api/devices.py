"""The cameras and serial ports that are plugged into the server's machine."""

from __future__ import annotations

import asyncio
from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, Field

from observer.machine import Machine
from observer.robots.serial_ports import SerialPort, find_serial_ports
from observer.sources.cameras.devices import CameraDevice, list_devices, shared_bus_hints

router = APIRouter(tags=["source"])


class DeviceMode(BaseModel):
    pixel_format: str = Field(description="Four characters, as in MJPG.")
    width: int
    height: int
    rates: list[float] = Field(description="Images per second, the highest first.")


class DeviceControl(BaseModel):
    name: str
    minimum: int
    maximum: int
    step: int
    default: int


class VideoDevice(BaseModel):
    path: str
    by_path: str | None = Field(description="Its name by the port it is plugged into.")
    card: str | None
    trouble: str | None = Field(description="Why it cannot be used, and what to do.")
    modes: list[DeviceMode]
    controls: list[DeviceControl]


class SerialPortNow(BaseModel):
    path: str
    by_id: str | None = Field(description="Its name by maker and serial number, which stays.")
    description: str | None = Field(description="What the product says of itself.")
    usable: bool = Field(description="Whether the server's user may open it.")
    trouble: str | None = Field(description="Why it cannot be used, and what to do.")


class Devices(BaseModel):
    cameras: list[VideoDevice]
    serial_ports: list[SerialPortNow] = Field(description="On USB, by which robots are driven.")
    hints: list[str] = Field(description="Such as on what two cameras on one bus can carry.")


@router.get("/devices", response_model=Devices, summary="Cameras and serial ports")
async def get_devices() -> dict[str, Any]:
    """Looked for at every request; no serial port is opened; what cannot be used says why."""
    devices = await asyncio.to_thread(list_devices)
    ports = await asyncio.to_thread(find_serial_ports, Machine())
    cameras = [_entry(each) for each in devices if each.can_capture or each.trouble]
    return {
        "cameras": cameras,
        "serial_ports": [_port_entry(each) for each in ports],
        "hints": list(shared_bus_hints(devices)),
    }


def _port_entry(port: SerialPort) -> dict[str, Any]:
    return {
        "path": port.path,
        "by_id": port.by_id,
        "description": port.description,
        "usable": port.usable,
        "trouble": port.trouble,
    }


def _entry(device: CameraDevice) -> dict[str, Any]:
    return {
        "path": device.path,
        "by_path": device.by_path,
        "card": device.card,
        "trouble": device.trouble,
        "modes": [
            {
                "pixel_format": mode.pixel_format,
                "width": mode.width,
                "height": mode.height,
                "rates": list(mode.rates),
            }
            for mode in device.modes
        ],
        "controls": [
            {
                "name": control.name,
                "minimum": control.minimum,
                "maximum": control.maximum,
                "step": control.step,
                "default": control.default,
            }
            for control in device.controls
        ],
    }
