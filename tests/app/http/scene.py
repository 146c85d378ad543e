"""The real 3D scene behind the server, and the client that speaks to it."""

from __future__ import annotations

from typing import Any

import viser

from app.viewer import ViserViewer

PROTOCOL = f"viser-v{viser.__version__}"


def real_viewer(server: Any) -> ViserViewer:
    return ViserViewer(server, points=500, rate_hz=20)
