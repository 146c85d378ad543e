"""Overlay of a frame's results on a copy of its rectified left image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from observer.drawing import DrawnObstacle, color_copy, draw_obstacles, draw_text, obstacle_color
from observer.obstacle_labels import obstacle_label
from observer.types import Image

_TEXT = (235, 235, 235)
# Text scale per pixel of picture width: 0.45 at 512 pixels.
_LETTERS_PER_WIDTH = 0.45 / 512


def draw_overlay(left: Image, line: Mapping[str, Any]) -> Image:
    """Return a new BGR picture with silhouettes, boxes, speeds and the frame's time and status.

    Args:
        left: rectified left image, (H, W) grey or (H, W, 3) BGR; it is not modified.
        line: the observation's JSON line, see ``observer.jsonl.observation_line``.
    """
    canvas = color_copy(left)
    scale = max(0.35, left.shape[1] * _LETTERS_PER_WIDTH)
    drawn: list[DrawnObstacle] = []
    for entry in line["obstacles"]:
        text = obstacle_label(entry["id"], entry["motion"], entry["speed"], entry["speed_std"])
        color = obstacle_color(entry["state"], entry["motion"])
        # Older recordings have no silhouettes.
        drawn.append(DrawnObstacle(entry["box_px"], entry.get("silhouette"), text, color))
    draw_obstacles(canvas, drawn, scale)
    status = "" if line["status"] == "ok" else f"  {line['status']}"
    text = f"frame {line['frame']}  {line['time']:.3f} s{status}"
    draw_text(canvas, text, (6, left.shape[0] - 8), _TEXT, scale)
    return canvas
