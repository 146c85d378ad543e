"""Lines and poses of viser nodes that stay and only change their content."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from app.contract.scene import LAYERS, LayerName
from app.viewer.shapes import padded
from observer.geometry import Float64Array, Pose
from observer.obstacle_colors import Rgb


def in_layer(layer: LayerName, name: str) -> str:
    """Return the path of a node of a layer."""
    return f"{LAYERS[layer].node}/{name}"


def hidden_lines(
    server: viser.ViserServer, node: str, count: int, color: Rgb, thickness: float
) -> viser.LineSegmentsHandle:
    """Add a node of ``count`` line segments, hidden until ``show_lines``.

    Args:
        thickness: pixels of the screen.
    """
    return server.scene.add_line_segments(
        node,
        np.zeros((count, 2, 3), np.float32),
        color,
        thickness=thickness,
        thickness_units="screen",
        visible=False,
    )


def show_lines(node: Any, lines: Float64Array) -> None:
    """Show line segments or arrows (N, 2, 3); hide the node if there are none."""
    if len(lines):
        node.points = padded(lines.astype(np.float32), len(node.points))
    node.visible = bool(len(lines))


def move(node: Any, pose: Pose) -> None:
    """Place a node in the frame of its parent."""
    node.position = pose.translation
    node.wxyz = pose.quaternion_wxyz
