"""Nodes of the viser scene in a running viewer."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest

from app.contract.drive import DriveState
from app.contract.events import EngineState, LocalMapEvent
from app.contract.robots import (
    DriveFacts,
)
from app.server import Server
from app.storage import Storage
from app.viewer import ViserViewer
from app.viewer.robot_marks import (
    MOST_PATH_LINES,
    MOST_ZONE_LINES,
)
from observer.geometry import Pose
from observer.occupancy import OccupancyMap

from .robot_facts import GOAL, ROBOT


async def test_the_scene_reuses_its_nodes_and_hides_a_stale_robot_pose(
    peer: Any, drive: Any, storage: Storage, capsys: Any
) -> None:
    async def watch(viewer: ViserViewer) -> None:
        scene = viewer._scene
        handles = dict(viewer._viser.server.scene._handle_from_node_name)
        with viewer.connected():
            while "cloud" not in peer.watched:
                await asyncio.sleep(0.005)
            for _ in range(5):
                peer.observe()
                await asyncio.sleep(0.06)
            assert scene._cloud.visible
            assert scene._cloud.points.shape == (300, 3)
            assert scene._obstacles.boxes.visible
            assert scene._obstacles.boxes.points.shape == (16 * 12, 2, 3)
            # Without gamma, which the viewer's client adds.
            assert (scene._obstacles.boxes.colors == (194, 6, 6)).all()
            assert scene._obstacles.labels[0].visible
            assert scene._obstacles.labels[0].text.startswith("#7  0.40")
            assert not scene._obstacles.labels[1].visible
            assert scene._camera._image_data == peer.views["plain"].read(0).payload
            assert not scene._robot.outline.visible
            assert not scene._map.visible
            cells = OccupancyMap.of(np.ones((9, 9), np.uint8), (0.0, 0.0), 0.1, (0.0,) * 3, 0.0)
            for local_map in (LocalMapEvent(cells, Pose.identity()), LocalMapEvent(None, None)):
                peer.publish(local_map)
                while scene._map.visible != (local_map.map is not None):
                    peer.observe()
                    await asyncio.sleep(0.03)
            assert scene._map.scale == pytest.approx(0.9)
            robots: Any = {"observer": ROBOT, "obstacle": None}
            drive.publish(DriveState(DriveFacts(None, None, None, None, None, robots), 0.0))
            while not scene._robot.outline.visible:
                peer.observe()
                await asyncio.sleep(0.03)
            assert scene._robot.base.visible
            assert not scene._robot.path.visible
            drive.publish(DriveState(DriveFacts(None, None, None, None, GOAL, robots), 0.0))
            while not scene._robot.goal.visible:
                peer.observe()
                await asyncio.sleep(0.03)
            assert scene._robot.path.points.shape == (MOST_PATH_LINES, 2, 3)
            assert scene._robot.reason.text == GOAL.sentence
            drive.publish(DriveState(DriveFacts(None, None, None, None, None, robots), 0.0))
            while scene._robot.goal.visible:
                peer.observe()
                await asyncio.sleep(0.03)
            assert scene._robot.stop_zone.points.shape == (MOST_ZONE_LINES, 2, 3)
            assert scene._robot.slow_zone.visible
            assert scene._robot.sonar.visible
            assert scene._robot.reason.text == "slowed: obstacle 3 is 1.2 m ahead"
            peer.lose()
            while scene._robot.outline.visible:
                await asyncio.sleep(0.01)
            assert not scene._robot.reason.visible
            assert not scene._robot.base.visible
            # The page, not the scene, says that it is old.
            assert scene._cloud.visible
            peer.start_process()
            while not scene._robot.outline.visible:
                if peer.opened is not None:
                    peer.observe()
                await asyncio.sleep(0.03)
        assert viewer._viser.server.scene._handle_from_node_name == handles

    server = Server(peer, storage, source="simulated:lab", drive=drive)
    viewer = None
    try:
        await server.start()
        while server.source.state.state is EngineState.IDLE:
            await asyncio.sleep(0.005)
        viewer = await asyncio.to_thread(ViserViewer, server, points=300, rate_hz=20)
        await watch(viewer)
    finally:
        if viewer is not None:
            await asyncio.to_thread(viewer.stop)
        await server.stop()
    assert "viser" not in capsys.readouterr().out
