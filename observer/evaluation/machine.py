"""Facts about the machine on which figures are measured, and its load."""

from __future__ import annotations

import os
import platform
from typing import Any

import cv2


def machine_facts() -> dict[str, Any]:
    """Return what a reader of figures must know about the machine, as plain values for JSON."""
    return {
        "platform": platform.platform(),
        "python": platform.python_version(),
        "opencv": cv2.__version__,
        "cores": os.cpu_count(),
    }


def machine_line() -> str:
    """Return ``machine_facts`` as one sentence."""
    return f"Machine: {', '.join(f'{key} {value}' for key, value in machine_facts().items())}."


def load() -> float | None:
    """Return the average number of runnable processes over the last minute.

    None if the system does not report it.
    """
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else None
