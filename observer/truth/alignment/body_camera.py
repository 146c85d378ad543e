"""Extrinsics of the camera on the body tracked by motion capture, from one drive both recorded.

Every camera pose in its world is ``T_world_room @ T_room_body @ T_body_camera``, where the two
outer ones are unknown and constant (robot-world and hand-eye calibration: Dornaika and Horaud,
1998). Both are found together by least squares. Driving on the ground leaves some degrees of
freedom open, such as the height; these are taken from the rig, or assumed, and reported.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from observer.errors import NotObservable
from observer.geometry import Float64Array, Pose, rotation_matrix
from observer.truth.alignment.frame_alignment import upright

# One standard deviation of each pose, visual odometry and motion capture combined.
_POSITION_M, _ANGLE_RAD = 0.01, 0.005
# Metres: the same for an obstacle's observed centre, in the ground plane.
_POINT_M = 0.1
_ROBUST = 2.0
_MOST_POSES = 200
_MOST_STEPS = 30
Function = Callable[[Float64Array], Float64Array]
# Sigmas of assumptions: offset on the body, a known vertical, a guessed vertical.
_OFFSET_M, _UP_GIVEN_RAD, _UP_GUESSED_RAD = 0.3, 0.01, 0.1
_GIVEN_M, _GIVEN_RAD, _FREE_RAD = 0.003, 0.01, 3.0
_HEIGHT_M = 0.01
# A degree of freedom counts as observed if the data reduce its assumed sigma to this share, and
# its sigma is below five times the values for metres and radians.
_SHARE, _GOOD_M, _GOOD_RAD = 0.5, 0.02, 0.02
_NAMES = ("x", "y", "height", "turn about x", "turn about y", "turn about the vertical")


@dataclass(frozen=True, eq=False)
class Assumed:
    """Prior knowledge.

    Attributes:
        up_world: (3,) the vertical in the world, from the mount; None where unknown, in which
            case the camera is assumed to be level.
        T_body_camera: as typed in or from the rig, None where unknown.
        camera_height_m: above the room's floor, z = 0; None where unknown.
    """

    up_world: Float64Array | None = None
    T_body_camera: Pose | None = None
    camera_height_m: float | None = None


@dataclass(frozen=True, eq=False)
class BodyCamera:
    """The camera on its body, and the room in the world.

    Attributes:
        T_body_camera, T_world_room: as found.
        observed: (6,) True where the drive determined x, y, z or the turns about x, y, z of
            ``T_body_camera``; the others are as assumed.
        residual_m: RMS distance of the camera from where motion capture puts it.
        notes: what was not observable, a sentence each.
    """

    T_body_camera: Pose
    T_world_room: Pose
    observed: tuple[bool, ...]
    residual_m: float
    notes: tuple[str, ...]


def find_body_camera(
    camera: Float64Array,
    body: Float64Array,
    assumed: Assumed | None = None,
    points: tuple[Float64Array, Float64Array] | None = None,
) -> BodyCamera:
    """Find the camera on its body and the room in the world.

    Args:
        camera: (N, 4, 4) ``T_world_camera``. body: (N, 4, 4) ``T_room_body`` at the same instants;
            rows with NaN are left out.
        assumed: prior knowledge.
        points: (M, 3) in the world and (M, 3) in the room, the same obstacles; they help with
            the yaw if the observer hardly moves.

    Raises:
        NotObservable: the data do not determine the room's pose in the world.
    """
    assumed = assumed or Assumed()
    known = np.isfinite(camera).all(axis=(1, 2)) & np.isfinite(body).all(axis=(1, 2))
    chosen = np.flatnonzero(known)
    if len(chosen) < 5:
        raise NotObservable(
            f"the observer's body and its camera pose are both known in only {len(chosen)} frames, "
            "too few to determine the camera's position on the body; motion capture must see the "
            "observer"
        )
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(len(chosen), _MOST_POSES)).astype(int)]
    thinned = _thinned(points)
    # Start from yaws all around, since the cost has several minima.
    problems = [
        _Problem(camera[chosen], body[chosen], assumed, thinned, yaw)
        for yaw in np.arange(16) * np.pi / 8
    ]
    problems.sort(key=lambda problem: float(np.log1p(problem.cost(problem.begin) ** 2).sum()))
    solved = [(each, *_levenberg_marquardt(each.cost, each.begin)) for each in problems[:3]]
    best, x, _ = min(solved, key=lambda found: found[2])
    return best.result(x)


def _thinned(
    points: tuple[Float64Array, Float64Array] | None,
) -> tuple[Float64Array, Float64Array]:
    if points is None or not len(points[0]):
        return np.zeros((0, 3)), np.zeros((0, 3))
    seen, true = points
    known = np.flatnonzero(np.isfinite(seen).all(axis=1) & np.isfinite(true).all(axis=1))
    known = known[np.linspace(0, len(known) - 1, min(len(known), _MOST_POSES)).astype(int)]
    return seen[known], true[known]


class _Problem:
    """Unknowns: rotation (3) and translation (3) of ``T_world_room`` and of ``T_body_camera``.

    Rotations apply on top of a start value, the camera's about the body's axes.

    Args:
        yaw: of the room in the world at the start, radians.

    Attributes:
        begin: (12,) the start.
    """

    def __init__(
        self,
        camera: Float64Array,
        body: Float64Array,
        assumed: Assumed,
        points: tuple[Float64Array, Float64Array],
        yaw: float,
    ) -> None:
        self._Rc, self._pc = camera[:, :3, :3], camera[:, :3, 3]
        self._Rb, self._pb = body[:, :3, :3], body[:, :3, 3]
        self._seen, self._true = points
        self._assumed = assumed
        given = assumed.T_body_camera
        up, self._up_sigma = np.array([0.0, -1.0, 0.0]), _UP_GUESSED_RAD
        if assumed.up_world is not None:
            up, self._up_sigma = np.asarray(assumed.up_world), _UP_GIVEN_RAD
        elif given is not None:
            # The body's pose gives the vertical; the given extrinsics carry it to the camera.
            tops = self._Rc @ given.rotation.T @ np.swapaxes(self._Rb, 1, 2)[:, :, 2:]
            up, self._up_sigma = tops[:, :, 0].mean(axis=0), _UP_GIVEN_RAD
        self._up = up / np.linalg.norm(up)
        self._offset = np.zeros(3) if given is None else given.translation
        self._offset_sigma = _OFFSET_M if given is None else _GIVEN_M
        level = Pose.from_rotvec([0, 0, yaw], np.zeros(3)).rotation
        self._R0 = upright(self._up).T @ level
        self._X0 = self._Rb[0].T @ self._R0.T @ self._Rc[0] if given is None else given.rotation
        self.begin = np.zeros(12)
        middle = np.mean(self._pb + self._Rb @ self._offset, axis=0)
        self.begin[3:6] = np.mean(self._pc, axis=0) - self._R0 @ middle
        self.begin[9:12] = self._offset

    def _poses(self, x: Float64Array) -> tuple[Float64Array, ...]:
        Rw = self._R0 @ rotation_matrix(x[0:3])
        Rx = rotation_matrix(x[6:9]) @ self._X0
        return Rw, x[3:6], Rx, x[9:12]

    def _data(self, x: Float64Array) -> Float64Array:
        Rw, tw, Rx, tx = self._poses(x)
        turn = np.swapaxes(Rw @ self._Rb @ Rx, 1, 2) @ self._Rc
        # The axis times the angle's sine: accurate enough near zero.
        skew = 0.5 * (turn - np.swapaxes(turn, 1, 2))
        angle = skew[:, [2, 0, 1], [1, 2, 0]]
        # Beyond a right angle the sine decreases again, so penalise the cosine.
        far = np.maximum(1 - np.trace(turn, axis1=1, axis2=2), 0)[:, None]
        place = self._pc - (self._pb + self._Rb @ tx) @ Rw.T - tw
        parts = [angle / _ANGLE_RAD, far / _ANGLE_RAD, place / _POSITION_M]
        if len(self._seen):
            # Heights are uninformative: a body's origin may be anywhere on it.
            apart = ((self._seen - tw) @ Rw - self._true)[:, :2]
            # All points together count as at most 30, as their errors are correlated.
            parts.append(apart / _POINT_M * np.sqrt(min(1.0, 30 / len(apart))))
        return np.concatenate([part.ravel() for part in parts])

    def cost(self, x: Float64Array) -> Float64Array:
        Rw, _, _, tx = self._poses(x)
        priors = [
            (Rw[:, 2] - self._up) / self._up_sigma,
            (tx - self._offset) / self._offset_sigma,
        ]
        given = self._assumed.T_body_camera
        priors.append(x[6:9] / (_FREE_RAD if given is None else _GIVEN_RAD))
        if self._assumed.camera_height_m is not None and given is None:
            height = float((self._pb[:, 2] + (self._Rb @ tx)[:, 2]).mean())
            priors.append(np.array([(height - self._assumed.camera_height_m) / _HEIGHT_M]))
        return np.concatenate([self._data(x), *priors])

    def result(self, x: Float64Array) -> BodyCamera:
        Rw, tw, Rx, tx = self._poses(x)
        T_world_room = Pose(Rw, tw)
        place = self._pc - T_world_room.apply(self._pb + self._Rb @ tx)
        residual = float(np.sqrt((place**2).sum(axis=1).mean()))
        scale = max(1.0, residual / (_POSITION_M * np.sqrt(3)))
        J = _jacobian(self.cost, x)
        data = len(self._data(x))
        # Errors of consecutive poses are correlated, so five poses count as one.
        information = J[:data].T @ J[:data] / (5 * scale**2)
        wanted = [9, 10, 11, 6, 7, 8]
        before = np.r_[[_OFFSET_M] * 3, [_FREE_RAD] * 3]
        free = np.r_[[_FREE_RAD] * 3, [10.0] * 3, [_FREE_RAD] * 3, [_OFFSET_M] * 3]
        weak = np.diag(free**-2)
        weak[:3, :3] += J[data : data + 3, :3].T @ J[data : data + 3, :3]
        alone = np.sqrt(np.diag(np.linalg.pinv(information + weak))[wanted])
        good = np.r_[[_GOOD_M] * 3, [_GOOD_RAD] * 3]
        observed = tuple(bool(v) for v in (alone < _SHARE * before) & (alone < 5 * good))
        return BodyCamera(
            T_body_camera=Pose(Rx, tx),
            T_world_room=T_world_room,
            observed=observed,
            residual_m=residual,
            notes=self._notes(observed),
        )

    def _notes(self, observed: tuple[bool, ...]) -> tuple[str, ...]:
        open_ = [name for name, known in zip(_NAMES, observed, strict=True) if not known]
        if not open_:
            return ()
        given = self._assumed.T_body_camera is not None
        listed = ", ".join(open_)
        source = "the given values are used" if given else "default values are assumed"
        if not given and self._assumed.camera_height_m is not None and open_ == ["height"]:
            source = "it follows from the height of the mount above the floor"
        elif open_ == ["height"]:
            source = "the given value is used" if given else "the body's own is assumed"
        why = (
            "planar motion does not determine"
            if open_ == ["height"]
            else "the observer moved too little to determine"
        )
        return (f"Camera position on the body: {why} {listed}; {source}.",)


def _levenberg_marquardt(function: Function, x: Float64Array) -> tuple[Float64Array, float]:
    """Minimise robust least squares starting at x; return the solution and its cost.

    Residuals beyond two sigmas count linearly. Normal equations are accurate enough for twelve
    unknowns and take a hundredth of the time of decomposing the full Jacobian.
    """
    damping = 1e-3
    r = function(x)
    cost = _robust_cost(r)
    for _ in range(_MOST_STEPS):
        weight = 1 / np.sqrt(1 + (r / _ROBUST) ** 2)
        J = _jacobian(function, x)
        normal = J.T @ (weight[:, None] * J)
        gradient = J.T @ (weight * r)
        before = cost
        for _ in range(8):
            damped = normal + damping * np.diag(np.diag(normal) + 1e-9)
            moved = x - np.linalg.solve(damped, gradient)
            r_moved = function(moved)
            if _robust_cost(r_moved) < cost:
                x, r, cost = moved, r_moved, _robust_cost(r_moved)
                damping = max(damping / 10, 1e-9)
                break
            damping *= 10
        if before - cost <= 1e-6 * before:
            break
    return x, cost


def _robust_cost(r: Float64Array) -> float:
    return float((np.sqrt(1 + (r / _ROBUST) ** 2) - 1).sum())


def _jacobian(function: Function, x: Float64Array) -> Float64Array:
    columns = []
    for k in range(len(x)):
        step = np.zeros(len(x))
        step[k] = 1e-6
        columns.append((function(x + step) - function(x - step)) / 2e-6)
    return np.column_stack(columns)
