"""Cameras under Linux's own video interface: what they are, and setting their controls.

``apply_settings`` and ``read_settings`` are what sources call; ``device.DeviceAccess`` is the one
place where the kernel is reached. Images are read by OpenCV, not here.
"""

from __future__ import annotations

from observer.sources.cameras.v4l2.applying import apply_settings, read_settings

__all__ = ["apply_settings", "read_settings"]
