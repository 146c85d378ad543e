"""The world of a scenario and a seed: bodies, motions and cameras as exact functions of time.

Frames
    room: x forward, y left, z up, metres; the origin on the floor where the observer starts.
    body: x along the heading, y left, z up; the origin on the floor below the body's centre.
    left, right: a camera's optical frame as mounted (x right, y down, z forward).
    camera: the *rectified* left camera, according to the calibration that the world hands out, or
        to the true one if it hands out none. It has the left camera's origin and is rotated by
        ``stereoRectify``'s R1; without distortion and tilt it is the left camera itself. A method
        can only know this frame, so truth is given in it even if that calibration is wrong.
    world: the camera frame at time 0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from observer.camera import StereoCalibration
from observer.errors import ScenarioError
from observer.geometry import Float64Array, Pose
from observer.mount import R_CAMERA_BASE
from observer.simulation.bodies import (
    hanging_facet,
    p3dx_parts,
    room_part,
    shadow_facet,
    standing_parts,
    standing_shadow,
)
from observer.simulation.facets import Facet, Part
from observer.simulation.held_board import HeldBoard, held_board
from observer.simulation.motion import Parked, PlanarMotion, PlanarState
from observer.simulation.people.person import Person
from observer.simulation.rig import small_rotation, true_calibration
from observer.simulation.scenarios import Scenario
from observer.simulation.specs.places import DoorSpec, PosterSpec
from observer.simulation.specs.vehicles import AMIGOBOT_SIZE
from observer.simulation.variation import build_motion, oscillation, varied

# Metres: least distance of a vehicle's centre from a wall; nearer ones are refused.
_WALL_MARGIN_M = 0.15


@dataclass(frozen=True, eq=False)
class Body:
    """A thing with its own frame: a robot, a box or the observer.

    Attributes:
        id: 0 for the observer, then counted. role: ``observer``, ``obstacle`` or ``scenery``.
        size: length, width, height, metres. bottom: height of its underside, metres.
        parts: convex solids in the body's frame; none for the observer, which never sees itself.
        shadow: drawn on the floor below it, or None. person: the person it is, or None.
    """

    id: int
    name: str
    role: str
    size: tuple[float, float, float]
    bottom: float
    motion: PlanarMotion
    parts: tuple[Part, ...]
    shadow: Facet | None
    person: Person | None = None

    def T_room_body(self, time: float) -> Pose:
        return pose_on_floor(self.motion.state(time))

    @property
    def centre(self) -> Float64Array:
        """(3,) metres, body frame."""
        return np.array([0.0, 0.0, self.bottom + self.size[2] / 2])


def pose_on_floor(state: PlanarState) -> Pose:
    """Return ``T_room_body`` of a vehicle."""
    c, s = math.cos(state.heading), math.sin(state.heading)
    return Pose(
        np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), np.array([state.x, state.y, 0.0])
    )


class World:
    """The simulated lab at every instant from 0 on.

    Args:
        seed: 0 is the scenario as written; other seeds vary textures, layout and motion.
        walks: motions of the people, replacing the scenario's, in its order.

    Attributes:
        beginnings: number of restarts; after each the world may run differently, as when its
            robots are driven.

    Raises:
        ScenarioError: a vehicle leaves the room, a leg is too short for its speed.
    """

    def __init__(
        self, scenario: Scenario, seed: int = 0, *, walks: Sequence[PlanarMotion] | None = None
    ) -> None:
        if seed < 0:
            raise ScenarioError(f"the seed must be a whole number of at least 0, not {seed}")
        self.seed = seed
        self.beginnings = 0
        self.scenario = varied(scenario, seed)
        s = self.scenario
        texture_seed = 1000 * seed
        self.observer = Body(
            0, "AmigoBot", "observer", AMIGOBOT_SIZE, 0.0, build_motion(s.observer), (), None
        )
        bodies: list[Body] = []
        for k, robot in enumerate(s.robots):
            parts = p3dx_parts(robot.size, s.texture, texture_seed + 100 + k)
            shadow = shadow_facet(robot.size[0], robot.size[1])
            motion = build_motion(robot)
            bodies.append(
                Body(k + 1, robot.name, "obstacle", robot.size, 0.0, motion, parts, shadow)
            )
        count = len(s.robots) + len(s.objects)
        walks = [build_motion(spec) for spec in s.people] if walks is None else walks
        for k, (spec, motion) in enumerate(zip(s.people, walks, strict=True), start=1):
            person = Person.of(spec, motion, s.texture, s.duration_s, texture_seed + 300 + 10 * k)
            shadow = shadow_facet(0.3, 0.4)
            bodies.append(
                Body(
                    count + k, spec.name, "obstacle", person.size, 0.0, motion, person.carried,
                    shadow, person,
                )
            )  # fmt: skip
        posters: list[Facet] = []
        for k, item in enumerate(s.objects):
            item_seed = texture_seed + 200 + k
            if isinstance(item, DoorSpec | PosterSpec):
                posters.append(hanging_facet(item, s.room, s.texture, item_seed))
                continue
            bodies.append(
                Body(
                    len(s.robots) + k + 1,
                    f"{item.kind} {k + 1}",
                    "scenery",
                    item.size,
                    item.above_m,
                    build_motion(item),
                    standing_parts(item, s.texture, item_seed),
                    standing_shadow(item),
                )
            )
        self.bodies: tuple[Body, ...] = tuple(bodies)
        self.posters: tuple[Facet, ...] = tuple(posters)
        self.room: Part = room_part(s.room, s.texture, texture_seed)
        self._shake = {
            name: oscillation(getattr(s.shake, name)) for name in ("roll", "pitch", "yaw", "up")
        }
        self.board: HeldBoard | None = None if s.board is None else held_board(s.board)
        self._check_room()

    @property
    def spec(self) -> str:
        """The text that opens this world as a source."""
        suffix = f"?seed={self.seed}" if self.seed else ""
        return f"simulated:{self.scenario.name}{suffix}"

    def move(self, motions: Mapping[int, PlanarMotion]) -> None:
        """Replace the motions of bodies, by id; they must agree with the old ones at time 0.

        Renderers of this world must be rebuilt, since they may have cached a body as static.
        """
        self.observer = _moving_as(self.observer, motions)
        self.bodies = tuple(_moving_as(body, motions) for body in self.bodies)

    @property
    def obstacles(self) -> tuple[Body, ...]:
        return tuple(body for body in self.bodies if body.role == "obstacle")

    # ------------------------------------------------------------------ cameras

    @cached_property
    def true_calibration(self) -> StereoCalibration:
        """True calibration of the cameras."""
        return true_calibration(self.scenario.camera, self.scenario.faults)

    @cached_property
    def calibration(self) -> StereoCalibration:
        """Calibration of the ``camera`` frame: the true one, unless the scenario falsifies it.

        It is handed out with the images, unless the scenario hands out none.
        """
        true, error = self.true_calibration, self.scenario.faults.miscalibration
        wrong = small_rotation(error.pitch_deg, error.vergence_deg, error.roll_deg)
        if not error.focal and np.array_equal(wrong, np.eye(3)):
            return true
        K = true.K1.copy()
        K[:2, :2] *= 1 + error.focal
        R = wrong @ true.R
        T = true.T if np.array_equal(wrong, np.eye(3)) else wrong @ true.T
        return StereoCalibration(true.width, true.height, K, true.D1, K, true.D2, R, T)

    @cached_property
    def _rectification(self) -> tuple[Float64Array, Float64Array]:
        """Rotation (3, 3) and projection (3, 3) of the rectified left camera, OpenCV's R1, P1."""
        c = self.calibration
        if c.is_rectified:
            return np.eye(3), c.K1
        size = (c.width, c.height)
        R1, _, P1, *_ = cv2.stereoRectify(c.K1, c.D1, c.K2, c.D2, size, c.R, c.T, alpha=0)
        return np.asarray(R1, np.float64), np.asarray(P1[:, :3], np.float64)

    @property
    def R_camera_left(self) -> Float64Array:
        """Rotation (3, 3) from the left camera's axes to the rectified ones."""
        return self._rectification[0]

    @cached_property
    def K_camera(self) -> Float64Array:
        """Matrix (3, 3) from true directions in the ``camera`` frame to rectified left pixels."""
        K = self._rectification[1].copy()
        # A wrong focal length shifts points in the image that is rectified with it.
        K[[0, 1], [0, 1]] *= self.true_calibration.K1[0, 0] / self.calibration.K1[0, 0]
        return K

    @cached_property
    def T_right_left(self) -> Pose:
        return Pose(self.true_calibration.R, self.true_calibration.T)

    def T_base_left(self, time: float) -> Pose:
        """Return the left camera's pose on its vehicle, fixed unless the scenario shakes it."""
        c = self.scenario.camera
        pitch = math.radians(c.tilt_deg)
        up = self._shake["up"].value(time)
        angles = [math.radians(self._shake[n].value(time)) for n in ("roll", "pitch", "yaw")]
        # Roll, pitch (downwards) and yaw (to the left) about the vehicle's x, y and z axes.
        R = Rotation.from_euler("ZYX", [angles[2], angles[1] + pitch, angles[0]]).as_matrix()
        return Pose(R @ R_CAMERA_BASE.T, np.array([c.forward_m, c.baseline_m / 2, c.height_m + up]))

    def T_room_left(self, time: float) -> Pose:
        return self.observer.T_room_body(time) @ self.T_base_left(time)

    def T_room_right(self, time: float) -> Pose:
        return self.T_room_left(time) @ self.T_right_left.inverse()

    @property
    def camera_is_static(self) -> bool:
        """True if the left camera never moves in the room."""
        shakes = any(oscillation.amplitude for oscillation in self._shake.values())
        return isinstance(self.observer.motion, Parked) and not shakes

    # ------------------------------------------------------------------ board

    def T_room_board(self, time: float) -> Pose:
        """Return the pose of the board held before the cameras.

        Raises:
            ScenarioError: the scenario has none.
        """
        if self.board is None:
            raise ScenarioError(f"nobody is holding a board in the scenario {self.scenario.name}")
        # The person holding it stands in the room and does not move with the cameras.
        return self.T_room_left(0.0) @ self.board.motion.pose(time)

    def board_pose(self, time: float) -> Pose:
        """Return ``T_left_board``, see ``observer.calibration.boards.board.Board`` for its frame.

        Raises:
            ScenarioError: the scenario has no board.
        """
        return self.T_room_left(time).inverse() @ self.T_room_board(time)

    # ------------------------------------------------------------------ world frame

    @cached_property
    def T_world_room(self) -> Pose:
        T_camera_left = Pose(self.R_camera_left, np.zeros(3))
        return T_camera_left @ self.T_room_left(0.0).inverse()

    def T_world_camera(self, time: float) -> Pose:
        """Return the rectified left camera's pose."""
        T_left_camera = Pose(self.R_camera_left.T, np.zeros(3))
        return self.T_world_room @ self.T_room_left(time) @ T_left_camera

    def brightness(self, time: float) -> float:
        """Return both images' brightness: 1 without flicker and with settled exposure."""
        f, settling = self.scenario.faults.flicker, self.scenario.faults.settling
        since = time - max((s for s in settling.again_s if s <= time), default=0.0)
        exposure = 1 + (settling.gain - 1) * math.exp(-since / settling.time_s)
        return exposure * (1 + f.amplitude * math.sin(2 * math.pi * f.hz * time))

    def _check_room(self) -> None:
        """Refuse vehicles that drive into a wall, checked ten times a second."""
        s = self.scenario
        (x0, x1), (y0, y1) = s.room.x, s.room.y
        m = _WALL_MARGIN_M
        for body in (self.observer, *self.bodies):
            steps = 1 if body.role == "scenery" else math.ceil(s.duration_s * 10)
            for k in range(steps):
                state = body.motion.state(k / 10)
                if not (x0 + m <= state.x <= x1 - m and y0 + m <= state.y <= y1 - m):
                    raise ScenarioError(
                        f"scenario {s.name}: {body.name} leaves the room at {k / 10:.1f} s (x "
                        f"{state.x:.2f} m, y {state.y:.2f} m); the room extends from x {x0:g} to "
                        f"{x1:g} and y {y0:g} to {y1:g}"
                    )


def _moving_as(body: Body, motions: Mapping[int, PlanarMotion]) -> Body:
    return replace(body, motion=motions[body.id]) if body.id in motions else body
