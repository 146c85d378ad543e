"""Nodes of the viser scene. Each layer is one permanent node; only its content changes.

Removing and re-adding nodes, and changing the length of arrays, makes the browsers' memory grow; so
every layer has a fixed number of elements and is hidden when it is empty. A person hides the parent
node instead, which is never touched here.
"""

from __future__ import annotations

from contextlib import AbstractContextManager

import numpy as np
import viser

from app.contract.scene import (
    CAMERA_NODE,
    DISPLAY_NODE,
    LAYERS,
    WORLD_NODE,
)
from app.viewer.map_tiles import MapTiles
from app.viewer.nodes import hidden_lines, in_layer, move, show_lines
from app.viewer.obstacle_nodes import ObstacleNodes
from app.viewer.picture import Cloud, Picture
from app.viewer.robot_nodes import RobotNodes
from app.viewer.shapes import Follower, floor_lines, padded, thinned
from app.viewer.trails import MOST_CAMERA_POINTS, Trails
from observer.geometry import Pose

_MOST_RIG_LINES = 4
_TRAIL_LINES = MOST_CAMERA_POINTS - 1
_OBSTACLE_TRAIL_LINES = 200
_FLOOR_HALF_WIDTH_M = 8
_FLOOR = (150, 162, 158)
_TRAIL, _OBSTACLE_TRAIL = LAYERS["trails"].colors
# The robot and its camera have the colour of their trail.
_ROBOT = _TRAIL
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
        _set_stage(server)
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
            in_layer("cloud", "points"),
            np.zeros((points, 3), np.float32),
            np.zeros((points, 3), np.uint8),
            point_size=0.024,
            point_shape="circle",
            point_shading="flat",
            visible=False,
        )
        self._obstacles = ObstacleNodes(server)
        self._trail = hidden_lines(server, in_layer("trails", "camera"), _TRAIL_LINES, _TRAIL, 2.0)
        self._obstacle_trails = hidden_lines(
            server, in_layer("trails", "obstacles"), _OBSTACLE_TRAIL_LINES, _OBSTACLE_TRAIL, 2.0
        )
        self._rig = hidden_lines(server, f"{WORLD_NODE}/rig", _MOST_RIG_LINES, _ROBOT, 2.0)
        self._robot = RobotNodes(server, _ROBOT)
        self._map = scene.add_image(
            in_layer("map", "cells"),
            np.zeros((1, 1, 4), np.uint8),
            *(1.0, 1.0),
            cast_shadow=False,
            receive_shadow=False,
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
            self._obstacles.show(picture)
            show_lines(self._rig, picture.rig)
            show_lines(self._trail, self._trails.camera)
            show_lines(self._obstacle_trails, self._trails.obstacles)
            self._robot.show(None if picture.stale else picture.robot)

    def show_map(self, tiles: MapTiles | None) -> None:
        """Draw the local map from now on; None: there is none."""
        with self._server.atomic():
            if tiles is not None:
                # As with the live image: the handle's own setter would encode it again.
                self._map._data = tiles.png
                self._map.scale = tiles.side_m
                move(self._map, tiles.T_world_middle)
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
            move(self._cloud_frame, pose)
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
            move(self._camera, pose)
            self._camera.visible = True
        if picture.optics is not None:
            self._camera.fov, self._camera.aspect = picture.optics
        at = picture.T_display_world.apply(self._T_world_camera.translation)
        self._display.position = self._follower.offset(at)
        move(self._world, picture.T_display_world)
        # Moved by whole metres, so that the floor is everywhere but its lines seem to stay still.
        self._floor.position = (*np.round(at[:2]), 0.0)
        self._floor.visible = picture.floor_known

    def _follow_trails(self, picture: Picture, now: float) -> None:
        for id, position in picture.positions.items():
            self._trails.add_obstacle(id, position, now)
        self._trails.forget_gone(now)


def _set_stage(server: viser.ViserServer) -> None:
    """Set where the camera begins, which way is up, and that viser shows no buttons of its own."""
    server.scene.set_up_direction("+z")
    server.initial_camera.position = _EYE
    server.initial_camera.look_at = _LOOK_AT
    server.initial_camera.up = (0.0, 0.0, 1.0)
    server.initial_camera.fov = _EYE_FOV_RAD
    server.gui.configure_theme(show_logo=False, show_share_button=False)
