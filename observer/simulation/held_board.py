"""A calibration board in a person's hands: its texture, its motion, its corners in the images.

Poses are ``T_left_board``: from the board's frame (``observer.calibration.boards.board.Board``: x
along a row, y along a column, z into the board, the origin at corner 0) to the left camera's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from observer.calibration.boards.board import Board
from observer.calibration.boards.printing import MARGIN_SQUARES
from observer.camera import StereoCalibration
from observer.geometry import Float64Array, Pose
from observer.simulation.facets import Material, Part, rectangle
from observer.simulation.specs.boards import BoardPoseSpec, BoardSpec

# An integer, so that every edge lies between two pixels.
_TEXTURE_PX_PER_SQUARE = 64
# Three samples per axis render shifts accurately to a hundredth of a pixel.
_SAMPLES = 3
# Hz: hands tremble at several frequencies at once (sway, and 8 to 12 of physiological tremor).
_TREMOR_HZ = (0.9, 3.1, 8.3)
_TREMOR_SHARES = (0.5, 0.3, 0.2)
# Pixels: least distance of the squares from the image border when poses are redrawn.
_BORDER_PX = 3.0
_TRIES = 30


class HandMotion:
    """Cyclic motion from pose to pose that holds each pose for a while.

    Args:
        poses: ``T_left_board``. centre: (3,) of the board, in its own frame: it moves in a
            straight line, and the board turns about it.
        hold_s, move_s: seconds. tremor_m: largest tremor along each axis.

    A move follows the minimum-jerk profile, 10 s^3 - 15 s^4 + 6 s^5 of the way (Flash and Hogan,
    The coordination of arm movements, 1985), and turns about one axis in step with it.
    """

    def __init__(
        self,
        poses: Sequence[Pose],
        centre: Float64Array,
        hold_s: float,
        move_s: float,
        tremor_m: float = 0.0,
    ) -> None:
        self._poses = tuple(poses)
        self._centre = centre
        self._hold_s, self._move_s = hold_s, move_s
        self._tremor_m = tremor_m
        self._centres = [pose.apply(centre) for pose in poses]
        self._turns = [
            Rotation.from_matrix(a.rotation.T @ b.rotation).as_rotvec()
            for a, b in zip(poses, (*poses[1:], poses[0]), strict=True)
        ]

    @property
    def period_s(self) -> float:
        """Duration of one pass over all poses, seconds."""
        return len(self._poses) * (self._hold_s + self._move_s)

    @property
    def held_at(self) -> tuple[float, ...]:
        """Middle of each hold in the first pass, seconds."""
        step = self._hold_s + self._move_s
        return tuple(k * step + self._hold_s / 2 for k in range(len(self._poses)))

    def pose(self, time: float) -> Pose:
        """Return ``T_left_board`` at ``time`` >= 0 seconds, beginning with the first hold."""
        rest = time % self.period_s
        index, since = divmod(rest, self._hold_s + self._move_s)
        k = min(int(index), len(self._poses) - 1)
        s = min(max((since - self._hold_s) / self._move_s, 0.0), 1.0)
        share = s**3 * (10 - 15 * s + 6 * s * s)
        a, b = self._centres[k], self._centres[(k + 1) % len(self._poses)]
        R = self._poses[k].rotation @ Rotation.from_rotvec(share * self._turns[k]).as_matrix()
        return Pose(R, a + share * (b - a) + self._tremor(rest) - R @ self._centre)

    def _tremor(self, time: float) -> Float64Array:
        """Return (3,) metres; each pass holds whole oscillations, so that the cycle closes."""
        offset = np.zeros(3)
        for n, (hz, share) in enumerate(zip(_TREMOR_HZ, _TREMOR_SHARES, strict=True)):
            turns = max(1, round(hz * self.period_s))
            for axis in range(3):
                angle = 2 * math.pi * (turns + axis) * time / self.period_s + axis + n
                offset[axis] += share * math.sin(angle)
        return self._tremor_m * offset


@dataclass(frozen=True, eq=False)
class HeldBoard:
    """A board, its shape and its motion.

    Attributes:
        part: one facet in the board's frame, visible from its front only.
    """

    board: Board
    part: Part
    motion: HandMotion


def held_board(spec: BoardSpec) -> HeldBoard:
    """Build the board of a scenario."""
    board = spec.board
    centre = _centre(board)
    poses = [_pose(pose, centre) for pose in spec.poses]
    motion = HandMotion(poses, centre, spec.hold_s, spec.move_s, spec.tremor_mm / 1000)
    return HeldBoard(board, board_part(board), motion)


def board_part(board: Board) -> Part:
    """Build the squares with their white margin, as a rectangle in the board's frame."""
    material = Material(
        f"board_{board.kind}",
        0,
        (
            ("columns", board.columns),
            ("rows", board.rows),
            ("density", _TEXTURE_PX_PER_SQUARE / board.square_m),
            ("samples", _SAMPLES),
        ),
    )
    margin = MARGIN_SQUARES * board.square_m
    width, height = (size + 2 * margin for size in board.size_m)
    corner = -margin - board.square_m
    x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return Part((rectangle([corner, corner, 0.0], x, y, (width, height), material),))


def corners_px(
    calibration: StereoCalibration, T_left_board: Pose, points: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Project points (N, 3) of the board to (N, 2) pixels of the left and right image as taken.

    Points outside an image get pixels outside it.
    """
    c = calibration
    T_right_board = Pose(c.R, c.T) @ T_left_board
    result = []
    for T, K, D in ((T_left_board, c.K1, c.D1), (T_right_board, c.K2, c.D2)):
        turn = Rotation.from_matrix(T.rotation).as_rotvec()
        pixels = cv2.projectPoints(points.reshape(-1, 1, 3), turn, T.translation, K, D)[0]
        result.append(np.asarray(pixels, np.float64).reshape(-1, 2))
    return result[0], result[1]


def whole_in_view(
    calibration: StereoCalibration, T_left_board: Pose, board: Board, border_px: float = 0.0
) -> tuple[bool, bool]:
    """Return whether all squares lie ``border_px`` inside the left and the right image."""
    c, s = calibration, board.square_m
    # Lenses bend lines, so check every corner of every square, not just the outer four.
    u, v = np.mgrid[-1 : board.columns + 1, -1 : board.rows + 1]
    points = np.stack([u.ravel(), v.ravel(), np.zeros(u.size)], axis=-1) * s
    if (T_left_board.apply(points)[:, 2] <= 0).any():
        return False, False
    low, high = border_px, np.array([c.width, c.height]) - 1 - border_px
    left, right = (
        bool(((px >= low) & (px <= high)).all()) for px in corners_px(c, T_left_board, points)
    )
    return left, right


def drawn_anew(
    spec: BoardSpec,
    calibration: StereoCalibration,
    shift: float,
    turn_deg: float,
    rng: np.random.Generator,
) -> BoardSpec:
    """Return the board with its poses shifted and turned a little, in another order.

    Args:
        shift: largest shift along each axis, as a share of the pose's depth.
        turn_deg: largest turn about each axis.

    A board that was completely in view of a camera stays so; a pose for which no such draw is
    found is kept as written.
    """
    if shift <= 0 and turn_deg <= 0:
        return spec
    board = spec.board
    centre = _centre(board)
    poses: list[BoardPoseSpec] = []
    for written in spec.poses:
        seen = whole_in_view(calibration, _pose(written, centre), board, _BORDER_PX)
        chosen = written
        for _ in range(_TRIES):
            move = written.centre[2] * shift * rng.uniform(-1, 1, 3)
            turn = turn_deg * rng.uniform(-1, 1, 3)
            x, y, z = (np.array(written.centre) + move).tolist()
            a, b, c = (np.array(written.turn_deg) + turn).tolist()
            drawn = BoardPoseSpec(centre=(x, y, z), turn_deg=(a, b, c))
            now = whole_in_view(calibration, _pose(drawn, centre), board, _BORDER_PX)
            if now[0] >= seen[0] and now[1] >= seen[1]:
                chosen = drawn
                break
        poses.append(chosen)
    order = rng.permutation(len(poses))
    return spec.model_copy(update={"poses": tuple(poses[k] for k in order)})


def _centre(board: Board) -> Float64Array:
    """Centre (3,) of the board in its own frame, metres."""
    return np.array([board.columns - 1, board.rows - 1, 0.0]) * board.square_m / 2


def _pose(spec: BoardPoseSpec, centre: Float64Array) -> Pose:
    R = np.asarray(Rotation.from_euler("xyz", spec.turn_deg, degrees=True).as_matrix(), np.float64)
    return Pose(R, np.array(spec.centre) - R @ centre)
