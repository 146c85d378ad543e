"""3D scene: viser on loopback, fed from the newest observation, reached only through our proxy."""

from __future__ import annotations

from app.viewer.viewer import NullViewer, Viewer, ViserViewer, start_viewer

__all__ = ["NullViewer", "Viewer", "ViserViewer", "start_viewer"]
