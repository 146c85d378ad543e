"""Nodes of the obstacles: boxes, velocity arrows and labels, and the boxes of true bodies."""

from __future__ import annotations

import numpy as np
import viser

from app.contract.scene import LAYERS
from app.viewer.nodes import hidden_lines, in_layer, show_lines
from app.viewer.picture import Picture, Tag
from app.viewer.shapes import EDGES_OF_A_BOX, linear_rgb, padded
from observer.obstacle_colors import OBSTACLE_RGB

_MOST_OBSTACLES = 16
_MOST_BODIES = 16
(_ARROW,), (_TRUTH,) = (LAYERS[name].colors for name in ("arrows", "truth"))
# Replaced by each obstacle's own.
_BOX = OBSTACLE_RGB["moving"]


class ObstacleNodes:
    """Nodes of all obstacles and true bodies, for use by one thread."""

    def __init__(self, server: viser.ViserServer) -> None:
        scene = server.scene
        self.boxes = hidden_lines(
            server, in_layer("boxes", "edges"), _MOST_OBSTACLES * EDGES_OF_A_BOX, _BOX, 3.0
        )
        self.labels = [
            scene.add_label(
                in_layer("boxes", f"label_{k}"), "", anchor="bottom-center", visible=False
            )
            for k in range(_MOST_OBSTACLES)
        ]
        self.arrows = scene.add_arrows(
            in_layer("arrows", "velocities"),
            np.zeros((_MOST_OBSTACLES, 2, 3), np.float32),
            _ARROW,
            shaft_radius=0.018,
            head_radius=0.045,
            head_length=0.1,
            visible=False,
        )
        self.truth = hidden_lines(
            server, in_layer("truth", "edges"), _MOST_BODIES * EDGES_OF_A_BOX, _TRUTH, 1.5
        )

    def show(self, picture: Picture) -> None:
        """Draw the obstacles and true bodies of a picture, and nothing else of it."""
        self._color_boxes(picture)
        show_lines(self.boxes, picture.boxes.reshape(-1, 2, 3))
        show_lines(self.truth, picture.truth.reshape(-1, 2, 3))
        show_lines(self.arrows, picture.arrows)
        self._label(picture.tags)

    def _color_boxes(self, picture: Picture) -> None:
        if not len(picture.boxes):
            return
        edges = np.repeat(picture.box_colors, EDGES_OF_A_BOX, axis=0)
        # Both ends of each edge.
        ends = np.repeat(linear_rgb(edges)[:, None], 2, axis=1)
        colors = padded(ends, len(self.boxes.points))
        if not np.array_equal(self.boxes.colors, colors):
            self.boxes.colors = colors

    def _label(self, tags: tuple[Tag, ...]) -> None:
        for k, label in enumerate(self.labels):
            if k < len(tags):
                label.text = tags[k].text
                label.position = tags[k].position
            label.visible = k < len(tags)
