"""Nodes of the observer's robot: outline, guard zones, sonar, path, goal and reason."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from app.contract.scene import BASE_NODE, LAYERS, WORLD_NODE
from app.viewer.nodes import hidden_lines, in_layer, move, show_lines
from app.viewer.robot_marks import (
    GOAL_LINES,
    MEETING_LINES,
    MOST_OUTLINE_LINES,
    MOST_PATH_LINES,
    MOST_REFUSED_LINES,
    MOST_SONAR_LINES,
    MOST_ZONE_LINES,
    RobotMarks,
)
from observer.guard.guard import Level
from observer.obstacle_colors import Rgb

_PATH, _REFUSED, _MEETING = LAYERS["path"].colors
_STOP, _SLOW, _SONAR = LAYERS["guard"].colors
_GREY = (132, 138, 142)
# Colours of the stop zone and of the slow zone by the guard's action.
_ZONES: dict[Level | None, tuple[Rgb, Rgb]] = {
    None: (_GREY, _GREY),
    "clear": ((170, 120, 110), (120, 160, 130)),
    "slow": ((205, 110, 70), _SLOW),
    "stop": (_STOP, _SLOW),
}


class RobotNodes:
    """Nodes of the observer's robot, for use by one thread.

    Args:
        color: of its outline.
    """

    def __init__(self, server: viser.ViserServer, color: Rgb) -> None:
        def lines(node: str, count: int, color: Rgb, thickness: float) -> Any:
            return hidden_lines(server, node, count, color, thickness)

        # Nothing is drawn here: it tells the page where the robot is.
        self.base = server.scene.add_frame(BASE_NODE, show_axes=False, visible=False)
        self.outline = lines(f"{WORLD_NODE}/robot", MOST_OUTLINE_LINES, color, 2.5)
        self.stop_zone = lines(in_layer("guard", "stop"), MOST_ZONE_LINES, _STOP, 3.0)
        self.slow_zone = lines(in_layer("guard", "slow"), MOST_ZONE_LINES, _SLOW, 2.0)
        self.sonar = lines(in_layer("guard", "sonar"), MOST_SONAR_LINES, _SONAR, 2.5)
        self.path = lines(in_layer("path", "planned"), MOST_PATH_LINES, _PATH, 3.5)
        self.refused = lines(in_layer("path", "refused"), MOST_REFUSED_LINES, _REFUSED, 1.5)
        self.meeting = lines(in_layer("path", "meeting"), MEETING_LINES, _MEETING, 3.0)
        self.goal = lines(in_layer("path", "goal"), GOAL_LINES, _PATH, 3.0)
        # In no layer: nobody can hide why the robot stands or does not obey.
        self.reason = server.scene.add_label(
            f"{WORLD_NODE}/reason", "", anchor="bottom-center", visible=False
        )
        self._level: Level | None = None

    def show(self, robot: RobotMarks | None) -> None:
        """Draw the robot, its goal, and why it is slowed or waits; None hides all of it."""
        nodes = (
            *(self.outline, self.stop_zone, self.slow_zone, self.sonar),
            *(self.path, self.refused, self.meeting, self.goal),
        )
        if robot is None:
            for node in (*nodes, self.base, self.reason):
                node.visible = False
            return
        move(self.base, robot.T_world_base)
        self.base.visible = True
        self._color_zones(robot.level)
        parts = (
            *(robot.outline, robot.stop_zone, robot.slow_zone, robot.sonar),
            *(robot.path, robot.refused, robot.meeting, robot.goal),
        )
        for node, lines in zip(nodes, parts, strict=True):
            show_lines(node, lines)
        if robot.text is not None:
            self.reason.text = robot.text
            self.reason.position = robot.place
        self.reason.visible = robot.text is not None

    def _color_zones(self, level: Level | None) -> None:
        if level == self._level:
            return
        self._level = level
        for node, color in zip((self.stop_zone, self.slow_zone), _ZONES[level], strict=True):
            node.colors = np.array(color, np.uint8)
