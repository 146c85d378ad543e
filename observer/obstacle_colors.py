"""Colours of obstacles by state: the same in images, the 3D scene, figures and on the page.

In charts and tables, which tell obstacles apart, each has a colour of its own instead.
"""

from __future__ import annotations

from collections.abc import Mapping

Rgb = tuple[int, int, int]

# Each has a contrast of at least 3:1 to the light and to the dark background of the page.
OBSTACLE_RGB: Mapping[str, Rgb] = {
    "moving": (226, 44, 44),
    "in_place": (205, 112, 0),
    "stopped": (0, 133, 200),
    "coasting": (128, 128, 128),
}
MOVING_HEX = "#{:02x}{:02x}{:02x}".format(*OBSTACLE_RGB["moving"])


def obstacle_rgb(state: str, motion: str) -> Rgb:
    """Return the colour of an obstacle in this ``TrackState`` and ``MotionState``."""
    return OBSTACLE_RGB["coasting" if state == "coasting" else motion]
