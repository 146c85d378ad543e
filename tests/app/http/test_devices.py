"""Serial ports as the page lists them."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import Any

import pytest

from observer.machine import Machine
from observer.sources.cameras.device_files import User

from ...observer.sources.cameras.fake_machine import FakeMachine
from ...observer.sources.cameras.fake_v4l2 import FakeKernel

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="device files are Linux's")


async def test_serial_ports_are_listed_with_stable_names_and_permissions(
    serve: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    files, kernel = FakeMachine(tmp_path), FakeKernel({})
    by_id = tmp_path / "dev" / "serial" / "by-id"
    by_id.mkdir(parents=True)
    for name in ("ttyUSB0", "ttyACM1", "ttyS0"):
        (tmp_path / "dev" / name).touch()
    (by_id / "usb-Prolific_2303-if00-port0").symlink_to("../../ttyUSB0")
    files.groups(f"dialout:x:{(tmp_path / 'dev' / 'ttyACM1').stat().st_gid}:")
    kernel.denied.add("ttyACM1")
    described = {"/dev/ttyUSB0": "USB-Serial Controller", "/dev/ttyACM1": "n/a"}
    machine = Machine(tmp_path, kernel, User("ada", frozenset({54321})), lambda: described)
    monkeypatch.setattr("app.http.api.devices.Machine", lambda: machine)

    async with asyncio.timeout(30), serve() as served:
        answer = await served.http.get("/api/devices")
        assert answer.status_code == 200
        locked, ready = answer.json()["serial_ports"]
        assert ready == {
            "path": "/dev/ttyUSB0",
            "by_id": "/dev/serial/by-id/usb-Prolific_2303-if00-port0",
            "description": "USB-Serial Controller",
            "usable": True,
            "trouble": None,
        }
        assert (locked["path"], locked["by_id"], locked["description"]) == (
            "/dev/ttyACM1", None, None,
        )  # fmt: skip
        assert not locked["usable"]
        assert "sudo usermod -aG dialout ada" in locked["trouble"]
        # Unplugged: the next request finds only the other one.
        (tmp_path / "dev" / "ttyACM1").unlink()
        (left,) = (await served.http.get("/api/devices")).json()["serial_ports"]
        assert left == ready
