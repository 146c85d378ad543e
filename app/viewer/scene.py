"""Nodes of the viser scene. Each layer is one permanent node; only its content changes.

Removing and re-adding nodes, and changing the length of arrays, makes the browsers' memory grow; so
every layer has a fixed number of elements and is hidden when it is empty. A person hides the parent
node instead, which is never touched here.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import partial
from typing import Any

import numpy as np
import viser

from app.contract.scene import (
    BASE_NODE,
    CAMERA_NODE,
    DISPLAY_NODE,
    LAYERS,
    WORLD_NODE,
    LayerName,
    Rgb,
)
from app.viewer.map_tiles import MapTiles
from app.viewer.picture import Cloud, Picture, Tag
from app.viewer.robot_marks import (
    GOAL_LINES,
    MEETING_LINES,
    MOST_OUTLINE_LINES,
    MOST_PATH_LINES,
    MOST_REFUSED_LINES,
    MOST_SONAR_LINES,
    MOST_ZONE_LINES,
    Level,
    RobotMarks,
)
from app.viewer.shapes import EDGES_OF_A_BOX, Follower, floor_lines, padded, thinned
from app.viewer.trails import MOST_CAMERA_POINTS, Trails
from observer.geometry import Float64Array, Pose

_MOST_OBSTACLES = 16
_MOST_BODIES = 16
_MOST_RIG_LINES = 4
_TRAIL_LINES = MOST_CAMERA_POINTS - 1
_OBSTACLE_TRAIL_LINES = 200
_FLOOR_HALF_WIDTH_M = 8
_FLOOR = (150, 162, 158)
(_BOX,), (_ARROW,), (_TRUTH,) = (LAYERS[name].colors for name in ("boxes", "arrows", "truth"))
_PATH, _REFUSED, _MEETING = LAYERS["path"].colors
_TRAIL, _OBSTACLE_TRAIL = LAYERS["trails"].colors
_STOP, _SLOW, _SONAR = LAYERS["guard"].colors
# The robot and its camera have the colour of their trail.
_ROBOT = _TRAIL
_GREY = (132, 138, 142)
# Colours of the stop zone and of the slow zone by the guard's action.
_ZONES: dict[Level | None, tuple[Rgb, Rgb]] = {
    None: (_GREY, _GREY),
    "clear": ((170, 120, 110), (120, 160, 130)),
    "slow": ((205, 110, 70), _SLOW),
    "stop": (_STOP, _SLOW),
}
# Behind the robot, above it and somewhat to its left, looking in its direction.
_EYE = (-1.6, 1.0, 1.5)
_LOOK_AT = (2.3, -0.1, 0.25)
_EYE_FOV_RAD = 0.9


class Scene:
    """Scene, for use by one thread.

    Args:
        points: number of points of the cloud.
    """

    def __init__(self, server: viser.ViserServer, points: int) -> None:
        self._server = server
        self._points = points
        self._trails = Trails()
        self._follower = Follower()
        self._segment: tuple[int, int] | None = None
        self._T_world_camera = Pose.identity()
        scene = server.scene
        scene.set_up_direction("+z")
        server.initial_camera.position = _EYE
        server.initial_camera.look_at = _LOOK_AT
        server.initial_camera.up = (0.0, 0.0, 1.0)
        server.initial_camera.fov = _EYE_FOV_RAD
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._display = scene.add_frame(DISPLAY_NODE, show_axes=False)
        # viser's own infinite grid is a shader over the whole picture; with software rendering it
        # takes a fifth of the drawing time.
        self._floor = scene.add_line_segments(
            f"{DISPLAY_NODE}/floor",
            floor_lines(_FLOOR_HALF_WIDTH_M),
            _FLOOR,
            thickness=0.7,
            thickness_units="screen",
            visible=False,
        )
        self._world = scene.add_frame(WORLD_NODE, show_axes=False)
        frames = {
            name: scene.add_frame(layer.node, show_axes=False) for name, layer in LAYERS.items()
        }
        self._cloud_frame = frames["cloud"]
        self._cloud = scene.add_point_cloud(
            _in_layer("cloud", "points"),
            np.zeros((points, 3), np.float32),
            np.zeros((points, 3), np.uint8),
            point_size=0.024,
            point_shape="circle",
            point_shading="flat",
            visible=False,
        )
        boxes, trails, guard, path = (
            partial(_in_layer, name) for name in ("boxes", "trails", "guard", "path")
        )
        self._boxes = self._lines(boxes("edges"), _MOST_OBSTACLES * EDGES_OF_A_BOX, _BOX, 3.0)
        self._truth = self._lines(
            _in_layer("truth", "edges"), _MOST_BODIES * EDGES_OF_A_BOX, _TRUTH, 1.5
        )
        self._rig = self._lines(f"{WORLD_NODE}/rig", _MOST_RIG_LINES, _ROBOT, 2.0)
        self._trail = self._lines(trails("camera"), _TRAIL_LINES, _TRAIL, 2.0)
        self._obstacle_trails = self._lines(
            trails("obstacles"), _OBSTACLE_TRAIL_LINES, _OBSTACLE_TRAIL, 2.0
        )
        self._outline = self._lines(f"{WORLD_NODE}/robot", MOST_OUTLINE_LINES, _ROBOT, 2.5)
        self._stop_zone = self._lines(guard("stop"), MOST_ZONE_LINES, _STOP, 3.0)
        self._slow_zone = self._lines(guard("slow"), MOST_ZONE_LINES, _SLOW, 2.0)
        self._sonar = self._lines(guard("sonar"), MOST_SONAR_LINES, _SONAR, 2.5)
        self._path = self._lines(path("planned"), MOST_PATH_LINES, _PATH, 3.5)
        self._refused = self._lines(path("refused"), MOST_REFUSED_LINES, _REFUSED, 1.5)
        self._meeting = self._lines(path("meeting"), MEETING_LINES, _MEETING, 3.0)
        self._goal = self._lines(path("goal"), GOAL_LINES, _PATH, 3.0)
        self._map = scene.add_image(
            _in_layer("map", "cells"),
            np.zeros((1, 1, 4), np.uint8),
            *(1.0, 1.0),
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        # Nothing is drawn here: it tells the page where the robot is.
        self._base = scene.add_frame(BASE_NODE, show_axes=False, visible=False)
        self._level: Level | None = None
        self._arrows = scene.add_arrows(
            _in_layer("arrows", "velocities"),
            np.zeros((_MOST_OBSTACLES, 2, 3), np.float32),
            _ARROW,
            shaft_radius=0.018,
            head_radius=0.045,
            head_length=0.1,
            visible=False,
        )
        self._camera = scene.add_camera_frustum(
            CAMERA_NODE,
            fov=1.0,
            aspect=2.0,
            scale=0.22,
            color=_ROBOT,
            thickness=0.006,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._labels = [
            scene.add_label(boxes(f"label_{k}"), "", anchor="bottom-center", visible=False)
            for k in range(_MOST_OBSTACLES)
        ]
        # In no layer: nobody can hide why the robot stands or does not obey.
        self._reason = scene.add_label(
            f"{WORLD_NODE}/reason", "", anchor="bottom-center", visible=False
        )

    def _lines(
        self, node: str, count: int, color: Rgb, thickness: float
    ) -> viser.LineSegmentsHandle:
        return self._server.scene.add_line_segments(
            node,
            np.zeros((count, 2, 3), np.float32),
            color,
            thickness=thickness,
            thickness_units="screen",
            visible=False,
        )

    def together(self) -> AbstractContextManager[None]:
        """Send all changes made within this context to browsers together, as one drawing."""
        return self._server.atomic()

    def show(self, picture: Picture, now: float) -> None:
        """Draw everything but cloud and image."""
        with self._server.atomic():
            if picture.segment != self._segment:
                self._segment = picture.segment
                self._trails.clear()
                self._follower.reset()
                self._T_world_camera = Pose.identity()
            self._place(picture)
            self._follow_trails(picture, now)
            _show_lines(self._boxes, picture.boxes.reshape(-1, 2, 3))
            _show_lines(self._truth, picture.truth.reshape(-1, 2, 3))
            _show_lines(self._arrows, picture.arrows)
            _show_lines(self._rig, picture.rig)
            _show_lines(self._trail, self._trails.camera)
            _show_lines(self._obstacle_trails, self._trails.obstacles)
            self._label(picture.tags)
            self._show_robot(picture.robot, picture.stale)

    def _show_robot(self, robot: RobotMarks | None, stale: bool) -> None:
        """Draw the robot, its goal, and why it is slowed or waits; hide all of it if stale."""
        nodes = (
            *(self._outline, self._stop_zone, self._slow_zone, self._sonar),
            *(self._path, self._refused, self._meeting, self._goal),
        )
        if robot is None or stale:
            for node in (*nodes, self._base, self._reason):
                node.visible = False
            return
        _move(self._base, robot.T_world_base)
        self._base.visible = True
        if robot.level != self._level:
            self._level = robot.level
            for node, color in zip(
                (self._stop_zone, self._slow_zone), _ZONES[robot.level], strict=True
            ):
                node.colors = np.array(color, np.uint8)
        parts = (
            *(robot.outline, robot.stop_zone, robot.slow_zone, robot.sonar),
            *(robot.path, robot.refused, robot.meeting, robot.goal),
        )
        for node, lines in zip(nodes, parts, strict=True):
            _show_lines(node, lines)
        if robot.text is not None:
            self._reason.text = robot.text
            self._reason.position = robot.place
        self._reason.visible = robot.text is not None

    def show_map(self, tiles: MapTiles | None) -> None:
        """Draw the local map from now on; None: there is none."""
        with self._server.atomic():
            if tiles is not None:
                # As with the live image: the handle's own setter would encode it again.
                self._map._data = tiles.png
                self._map.scale = tiles.side_m
                _move(self._map, tiles.T_world_middle)
            self._map.visible = tiles is not None

    def show_cloud(self, cloud: Cloud) -> None:
        """Draw the cloud in the pose of its own instant."""
        chosen = thinned(len(cloud.points), self._points)
        points, colors = cloud.points[chosen], cloud.colors[chosen]
        if not len(points):
            self._cloud.visible = False
            return
        pose = cloud.T_world_camera or self._T_world_camera
        with self._server.atomic():
            self._cloud.points = padded(points, self._points)
            self._cloud.colors = padded(colors, self._points)
            _move(self._cloud_frame, pose)
            self._cloud.visible = True

    def show_image(self, jpeg: bytes) -> None:
        """Put the live image into the camera's frustum.

        The handle's own setter would decode and re-encode it; these bytes are sent as they are.
        """
        with self._server.atomic():
            self._camera._format = "jpeg"
            self._camera._image_data = jpeg

    def _place(self, picture: Picture) -> None:
        pose = picture.T_world_camera
        if pose is not None:
            self._T_world_camera = pose
            self._trails.add_camera(pose.translation)
            _move(self._camera, pose)
            self._camera.visible = True
        if picture.optics is not None:
            self._camera.fov, self._camera.aspect = picture.optics
        at = picture.T_display_world.apply(self._T_world_camera.translation)
        self._display.position = self._follower.offset(at)
        _move(self._world, picture.T_display_world)
        # Moved by whole metres, so that the floor is everywhere but its lines seem to stay still.
        self._floor.position = (*np.round(at[:2]), 0.0)
        self._floor.visible = picture.floor_known

    def _follow_trails(self, picture: Picture, now: float) -> None:
        for id, position in picture.positions.items():
            self._trails.add_obstacle(id, position, now)
        self._trails.forget_gone(now)

    def _label(self, tags: tuple[Tag, ...]) -> None:
        for k, label in enumerate(self._labels):
            if k < len(tags):
                label.text = tags[k].text
                label.position = tags[k].position
            label.visible = k < len(tags)


def _in_layer(layer: LayerName, name: str) -> str:
    return f"{LAYERS[layer].node}/{name}"


def _show_lines(node: Any, lines: Float64Array) -> None:
    if len(lines):
        node.points = padded(lines.astype(np.float32), len(node.points))
    node.visible = bool(len(lines))


def _move(node: Any, pose: Pose) -> None:
    node.position = pose.translation
    node.wxyz = pose.quaternion_wxyz
