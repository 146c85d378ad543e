"""Overlay of what was found in a frame on a copy of its rectified left image."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2

from observer.drawing import color_copy
from observer.types import Image

# BGR, as in the panel: moving, stopped, coasting.
_COLORS = {"moving": (0, 235, 255), "stopped": (255, 170, 80)}
_COASTING = (160, 160, 160)
_TEXT = (235, 235, 235)
# Height of the letters in pictures of this width, pixels.
_LETTERS_PER_WIDTH = 0.45 / 512


def draw_overlay(left: Image, line: Mapping[str, Any]) -> Image:
    """Return a new BGR picture with rectangles, speeds and the frame's time and status.

    Args:
        left: rectified left image, (H, W) grey or (H, W, 3) BGR; it stays as it is.
        line: the observation's JSON line, see ``observer.jsonl.observation_line``.
    """
    canvas = color_copy(left)
    scale = max(0.35, left.shape[1] * _LETTERS_PER_WIDTH)
    for entry in line["obstacles"]:
        color = _COASTING if entry["state"] == "coasting" else _COLORS[entry["motion"]]
        u0, v0, u1, v1 = (round(value) for value in entry["box_px"])
        cv2.rectangle(canvas, (u0, v0), (u1, v1), color, 2, cv2.LINE_AA)
        std = entry["speed_std"]
        sure = "" if std is None else f" +-{std:.2f}"
        text = f"#{entry['id']}  {entry['speed']:.2f}{sure} m/s"
        _write(canvas, text, (u0, max(v0 - 6, round(28 * scale))), color, scale)
    status = "" if line["status"] == "ok" else f"  {line['status']}"
    text = f"frame {line['frame']}  {line['time']:.3f} s{status}"
    _write(canvas, text, (6, left.shape[0] - 8), _TEXT, scale)
    return canvas


def _write(
    canvas: Image, text: str, at: tuple[int, int], color: tuple[int, int, int], scale: float
) -> None:
    for thickness, ink in ((3, (0, 0, 0)), (1, color)):
        cv2.putText(canvas, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, ink, thickness, cv2.LINE_AA)
