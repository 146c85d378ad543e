"""Cameras under Video4Linux: their properties and controls.

``apply_settings`` is what sources call; ``device.DeviceAccess`` is the one
place where the kernel is reached. Images are read by OpenCV, not here.
"""

from __future__ import annotations

from observer.sources.cameras.v4l2.applying import apply_settings

__all__ = ["apply_settings"]
