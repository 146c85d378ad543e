"""Dense evidence of one frame."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.camera_step import CameraStep
from observer.methods.rigid.dense.corrections import at_one_time, with_bias
from observer.methods.rigid.dense.depth_image import RowTexture, depth_image
from observer.methods.rigid.dense.free_space import DepthFrame, FreeSpace
from observer.methods.rigid.dense.grey_change import GreyChange, Light
from observer.methods.rigid.dense.grid import Grid
from observer.methods.rigid.dense.ground import Ground, GroundPlane, above_ground, near_enough
from observer.mount import CameraMount
from observer.parameters import DenseParameters, StereoParameters
from observer.types import Image
from observer.vision.view import View

# Metres, most thickness of a body; and matched columns, least noise of the disparity.
_THICKNESS_M = 0.35
_LEAST_TOLERANCE_COLUMNS = 0.65
# m/s: no robot for which these methods are meant drives faster.
_FASTEST_MPS = 2.5


@dataclass(frozen=True, eq=False)
class DenseScene:
    """Dense evidence of one frame.

    Attributes:
        time: seconds. grid: its cells. T_world_camera: the pose.
        left, right: (h, w) the images, grey. texture: of the left image.
        matched, disparity: (h, w) px, NaN unknown; as the images show it, and corrected.
        near: (h, w) which cells are near enough to be judged.
        standing: (h, w) those of them that stand out of the ground.
        evidence: (h, w) of motion, see ``observer.methods.rigid.dense.free_space``.
        changed: (h, w) which cells look different from a moment ago.
        light: how it changes.
        ground: in the world; None if unknown.
    """

    time: float
    grid: Grid
    T_world_camera: Pose
    left: Image
    right: Image
    texture: RowTexture
    matched: NDArray[np.float32]
    disparity: NDArray[np.float32]
    near: NDArray[np.bool_]
    standing: NDArray[np.bool_]
    evidence: NDArray[np.uint8]
    changed: NDArray[np.bool_]
    light: Light
    ground: GroundPlane | None

    @cached_property
    def T_camera_world(self) -> Pose:
        """The pose, from the world's frame to the camera's."""
        return self.T_world_camera.inverse()

    def along_sight(self, place: Float64Array) -> Float64Array:
        """(3, 3) the projection onto the line of sight to a place (3,) m, world."""
        ahead = place - self.T_world_camera.translation
        return np.asarray(ahead[:, None] * ahead / float(ahead @ ahead))

    @cached_property
    def tolerances(self) -> tuple[float, float]:
        """Least ``tolerance`` of disparity, px, and its ratio to the squared disparity, 1/px."""
        camera = self.grid.camera
        thickness = _THICKNESS_M / camera.fb
        return _LEAST_TOLERANCE_COLUMNS * self.grid.column_px, thickness

    def tolerance(self, disparity: float) -> float:
        """Return by how many px the disparities of parts of one body may differ."""
        least, thickness = self.tolerances
        return max(least, disparity * disparity * thickness)


class DenseVision:
    """Depth, ground and free space over the frames of one segment."""

    def __init__(self, camera: StereoCamera, mount: CameraMount | None) -> None:
        self._grid = Grid.of(camera)
        self._ground = Ground(self._grid, mount)
        self._space = FreeSpace(self._grid)
        self._change = GreyChange(self._grid)
        self._looked = -np.inf

    def is_due(self, time: float, dt: float, parameters: DenseParameters) -> bool:
        """Return whether a frame is due to be looked at, at the rate of the parameters.

        Args:
            time: of the frame, dt: since the one before, seconds.
        """
        rate = parameters.rate_hz
        return bool(rate > 0 and time - self._looked > 1 / rate - dt / 2)

    def look(
        self, view: View, now: CameraStep, parameters: StereoParameters, bias_px: float
    ) -> DenseScene | None:
        """Return the evidence of a frame, and remember its depth.

        None while the camera is so fast that static things look different from frame to frame: on
        the road only the points are used.

        Args:
            bias_px: by how much all disparities are too small, at the image's centre.
        """
        self._looked = view.time
        if np.linalg.norm(now.rate.shift) > _FASTEST_MPS:
            return None
        left, right = (self._grid.reduced(image) for image in (view.left, view.right))
        texture = RowTexture.of(left)
        pair = left, right
        if self._grid.column_px < self._grid.reduction:
            pair = self._grid.matched(view.left), self._grid.matched(view.right)
        matched = depth_image(*pair, texture, self._grid, parameters)
        delay_s = 0.0 if view.right_time is None else view.right_time - view.time
        disparity = with_bias(
            at_one_time(matched, now.rate, delay_s, self._grid), bias_px, self._grid
        )
        self._ground.update(disparity, now.T_camera_world, view.index)
        plane = self._ground.plane(now.T_camera_world)
        near = near_enough(disparity, self._grid)
        standing = near & above_ground(disparity, plane, self._grid)
        frame = DepthFrame(view.time, disparity, now.T_camera_world)
        evidence = self._space.evidence(frame, standing)
        self._space.keep(frame)
        changed = self._change.changed(frame, left, standing)
        return DenseScene(
            time=view.time,
            grid=self._grid,
            T_world_camera=now.T_world_camera,
            left=left,
            right=right,
            texture=texture,
            matched=matched,
            disparity=disparity,
            near=near,
            standing=standing,
            evidence=evidence,
            changed=changed,
            light=self._change.light,
            ground=self._ground.in_world,
        )

    def correct_disparities(self, bias_px: float) -> None:
        """Change all that is remembered as if its disparities had been larger by a bias, px."""
        self._space.correct_disparities(bias_px)

    def forget(self) -> None:
        """Forget where space was free: what was seen there was seen at wrong depths."""
        self._space = FreeSpace(self._grid)
