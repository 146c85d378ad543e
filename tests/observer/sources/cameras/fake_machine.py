"""The parts of a machine's file system about cameras: /dev, /sys, /proc and /etc/group."""

from __future__ import annotations

import os
from pathlib import Path

CONTROLLER = "0000:00:14.0"


class FakeMachine:
    """A machine built below ``root``, piece by piece."""

    def __init__(self, root: Path, group_number: int | None = None) -> None:
        self.root = root
        # The group that owns files made by a test; tests cannot change it.
        self.group = os.getgid() if group_number is None else group_number
        (root / "dev").mkdir(parents=True)
        (root / "etc").mkdir()
        self.groups(f"video:x:{self.group}:")

    def groups(self, *lines: str) -> None:
        (self.root / "etc" / "group").write_text("".join(f"{line}\n" for line in lines))

    def camera(
        self,
        number: int,
        *,
        port: str = "1-1",
        bus: int = 1,
        controller: str = CONTROLLER,
        speed: str = "480",
        by_id: str | None = None,
        name: str = "HD Webcam",
        index: int = 0,
    ) -> Path:
        """Make a node of a USB camera with all its names; return its file."""
        node = self.root / "dev" / f"video{number}"
        node.touch()
        device = self.root / f"sys/devices/pci0000:00/{controller}/usb{bus}" / port
        (device / f"{port}:1.0").mkdir(parents=True, exist_ok=True)
        (device / "busnum").write_text(f"{bus}\n")
        (device / "speed").write_text(f"{speed}\n")
        node_class = self.root / "sys/class/video4linux" / node.name
        node_class.mkdir(parents=True)
        (node_class / "name").write_text(f"{name}\n")
        (node_class / "device").symlink_to(os.path.relpath(device / f"{port}:1.0", node_class))
        usb = port.partition("-")[2]
        self._link("by-path", f"pci-{controller}-usb-0:{usb}:1.0-video-index{index}", node)
        # Newer systems add a second name of this kind.
        self._link("by-path", f"pci-{controller}-usbv2-0:{usb}:1.0-video-index{index}", node)
        if by_id:
            self._link("by-id", f"usb-{by_id}-video-index{index}", node)
        return node

    def process(self, number: int, name: str, *opened: str, parent: int = 1) -> None:
        """Make a process that has files open, by their names on this machine."""
        folder = self.root / "proc" / str(number)
        (folder / "fd").mkdir(parents=True)
        (folder / "comm").write_text(f"{name}\n")
        (folder / "stat").write_text(f"{number} ({name}) S {parent} {number} 0 0\n")
        for descriptor, path in enumerate(opened):
            (folder / "fd" / str(descriptor)).symlink_to(path)

    def _link(self, kind: str, name: str, node: Path) -> None:
        folder = self.root / "dev" / "v4l" / kind
        folder.mkdir(parents=True, exist_ok=True)
        (folder / name).unlink(missing_ok=True)
        (folder / name).symlink_to(os.path.relpath(node, folder))
