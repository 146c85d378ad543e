"""Check of the vergence against the calibration, by the distance that the wheels report.

Vergence cannot be seen in one pair: it looks like depth. But depth scales the distance that the
camera travels, which the robot's wheels measure independently (``observer.vision.vergence_fit`` has
the formula).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from observer.calibration.ageing.words import VergenceWord
from observer.camera import StereoCamera
from observer.geometry import Pose
from observer.intervals import half_95
from observer.mount import CameraMount
from observer.number_format import format_number
from observer.types import Odometry
from observer.vision.vergence_fit import DistanceEquation, SeenTwice, distance_equation
from observer.vision.view import StereoRows
from observer.vision.wheel_odometry import driven_distance, driven_step

# Metres between the two views of a pair, and radians at most: a longer distance loses the points,
# and a turn makes the distance depend on where the camera is mounted.
_LEAST_DISTANCE_M, _MOST_TURN = 0.2, 0.35
# Seconds between two fits, which take 1 ms.
_PAUSE_S = 1.0
# Resolution of the wheel encoders, metres.
_STEP_M = 0.002
# The wheels' scale is wrong by about 1 % (a worn tyre, a soft floor) throughout a drive. So f v is
# never known better than 1 % of the disparities seen, except through their spread.
WHEEL_SCALE_SIGMA = 0.01
# A scale error this large is not a usual one: the wheels slip, or a gear ratio is set wrong.
_STRANGE_SCALE = 0.05
# No vergence makes the ways differ by such a factor: the wheels spin, or their count was reset.
_SAME_DISTANCE = 2.5
# If the turns by stereo and by the wheels differ by more than these, radians and a share of the
# turn, the camera tips or swings, and the wheels cannot measure its motion.
_SAME_TURN, _SAME_TURN_SHARE = 0.015, 0.1
_CHECK_WHEELS = (
    "check that they do not slip and that their scale is right, and drive on even ground"
)
# Points of one scene have common errors, beside edges and by interpolation, which recur in every
# pair: the variance is at least so many times that of independent errors, and a bias, pixels, is
# the same for all. Both are from simulated drives.
_SHARED = 10.0
_BIAS_PX = 0.1
# How far back the fits count: metres driven over which their weight falls to 1/e.
_MEMORY_M = 20.0
_LEAST_PAIRS = 3.5
_SURE_SIGMAS = 3.0
# Vergence counts as known once its error in disparity is below this standard deviation, pixels.
_KNOWN_PX = 0.3
# Metres: depth errors are reported for objects at this distance.
_AT_M = 3.0
_HOW = "drive 2 m straight ahead with wheel odometry, past near and far objects"
_NOT_DRIVEN = f"vergence not measured yet: the robot has not driven; {_HOW}"
# More frames without matches than this are not just the first ones of a segment.
_BLIND_FRAMES = 5


@dataclass(frozen=True)
class VergenceCheck:
    """Result of the check so far.

    Attributes:
        status: ``consistent`` with the calibration, ``drifted`` from it, or ``unobserved``.
        vergence_rad: by how much the cameras converge more than calibrated; None where nothing
            is known. std_rad: one standard deviation, the wheels' scale error included.
        sentence: the same in words; while unobserved, what would make it observable.
        distance_m: metres driven by the wheels that it is based on; 0 without wheels.
    """

    status: VergenceWord
    vergence_rad: float | None
    std_rad: float | None
    sentence: str
    distance_m: float = 0.0


@dataclass(frozen=True, eq=False)
class _Seen:
    rows: StereoRows
    T_world_camera: Pose
    odometry: Odometry
    time_s: float


class VergenceWatch:
    """Watch of one calibration's vergence, fed with every frame; costs 0.05 ms a frame on average.

    Args:
        camera: the rectified pair.
        mount: where the camera is on the robot; None if unknown, then curves say less.
    """

    def __init__(self, camera: StereoCamera, mount: CameraMount | None = None) -> None:
        self._camera = camera
        self._mount = CameraMount(1.0, 0.0) if mount is None else mount
        self._key: _Seen | None = None
        self._segment: int | None = None
        self._fitted_s = -math.inf
        self._information, self._vector = np.zeros((2, 2)), np.zeros(2)
        self._square = self._pairs = self._distance_m = 0.0
        self._blind = 0
        self._found = _unobserved(_NOT_DRIVEN)

    def add_frame(
        self,
        time_s: float,
        segment: int,
        rows: StereoRows | None,
        T_world_camera: Pose | None,
        odometry: Odometry | None,
    ) -> VergenceCheck:
        """Return what is known after one more frame.

        Args:
            time_s: the frame's, seconds on the source's clock.
            segment: of the observation: points and poses of two segments are unrelated.
            rows: the points that stereo found; None where the method finds none.
            T_world_camera: by stereo; None while it is unknown.
            odometry: the wheels' at this frame; None if unknown.
        """
        if segment != self._segment or (self._key is not None and time_s < self._key.time_s):
            self._key, self._segment, self._fitted_s = None, segment, -math.inf
        if rows is None or odometry is None:
            self._key = None
            self._blind += 1
            # The first frame of a segment has no matches yet, whatever the method.
            missing = odometry is None or self._blind > _BLIND_FRAMES
            if missing and self._pairs < _LEAST_PAIRS:
                self._found = _unobserved(_missing(odometry))
            return self._found
        if self._blind and self._pairs < _LEAST_PAIRS:
            self._found = _unobserved(_NOT_DRIVEN)
        self._blind = 0
        if T_world_camera is None:
            return self._found
        key = self._key
        seen = _Seen(rows, T_world_camera, odometry, time_s)
        driven_m = None if key is None else driven_distance(key.odometry, odometry)
        if key is None or driven_m is None or _turn(key.odometry, odometry) > _MOST_TURN:
            self._key = seen
        elif driven_m >= _LEAST_DISTANCE_M:
            if time_s - self._fitted_s >= _PAUSE_S:
                self._fitted_s = time_s
                self._fit(key, seen)
            self._key = seen
        return self._found

    def _fit(self, before: _Seen, now: _Seen) -> None:
        seen, wheels_m = _pair(before, now, self._mount)
        seen_m = float(np.linalg.norm(seen.T_now_before.translation))
        turn = float(np.linalg.norm(seen.T_now_before.rotvec))
        wheels_turn = _turn(before.odometry, now.odometry)
        same = wheels_m / _SAME_DISTANCE < seen_m < wheels_m * _SAME_DISTANCE
        if not same or abs(turn - wheels_turn) > _SAME_TURN + _SAME_TURN_SHARE * wheels_turn:
            if self._pairs < _LEAST_PAIRS:
                self._found = _unobserved(
                    f"vergence not measured: the wheels report {wheels_m:.2f} m and "
                    f"{math.degrees(wheels_turn):.0f}° of turn where stereo saw {seen_m:.2f} m and "
                    f"{math.degrees(turn):.0f}°; {_CHECK_WHEELS}"
                )
            return
        start = (self._found.vergence_rad or 0.0, 0.0)
        equation = distance_equation(seen, self._camera, start, WHEEL_SCALE_SIGMA)
        if equation is None:
            return
        self._add(equation, wheels_m)
        self._found = self._tell()

    def _add(self, equation: DistanceEquation, distance_m: float) -> None:
        keep = math.exp(-distance_m / _MEMORY_M)
        self._information = keep * self._information + equation.information
        self._vector = keep * self._vector + equation.vector
        self._square = keep * self._square + equation.square
        self._pairs = keep * self._pairs + 1
        self._distance_m = keep * self._distance_m + distance_m

    def _tell(self) -> VergenceCheck:
        driven = f"{self._distance_m:.1f} m"
        if self._pairs < _LEAST_PAIRS:
            return _unobserved(f"vergence not measured after {driven} of driving; {_HOW}")
        # The variance by which the pairs contradict each other; each gives two unknowns.
        own = np.linalg.pinv(self._information, hermitian=True) @ self._vector
        excess = (self._square - float(own @ self._vector)) / (2 * self._pairs - 2)
        excess = max(_SHARED, excess)
        information, vector = self._information / excess, self._vector / excess
        information[1, 1] += WHEEL_SCALE_SIGMA**-2
        if np.linalg.cond(information * np.outer(_UNITS, _UNITS)) > 1e12:
            return _unobserved(f"vergence not measured after {driven} of driving; {_HOW}")
        covariance = np.linalg.inv(information)
        vergence = float(covariance[0] @ vector)
        std = math.hypot(math.sqrt(covariance[0, 0]), _BIAS_PX / self._camera.fx)
        if self._strange(float(own[1]), excess):
            scale = float(own[1])
            return _unobserved(
                f"vergence not measured: over {driven} the wheels report {100 * abs(scale):.0f} % "
                f"too {'little' if scale > 0 else 'much'} at all distances, which vergence "
                f"does not explain; {_CHECK_WHEELS}"
            )
        return self._judged(vergence, std)

    def _judged(self, vergence: float, std: float) -> VergenceCheck:
        """Return the verdict on a vergence and its standard deviation, rad."""
        driven = f"{self._distance_m:.1f} m"
        spread = f"± {math.degrees(half_95(std)):.2f}°"
        if abs(vergence) > _SURE_SIGMAS * std:
            lead, effect = drift_words(vergence, std, self._camera.baseline)
            sentence = (
                f"{lead}, compared with the wheels over {driven}: {effect}; refine the calibration "
                "from the scene or recalibrate with a board"
            )
            return VergenceCheck("drifted", vergence, std, sentence, self._distance_m)
        if std * self._camera.fx > _KNOWN_PX:
            sentence = (
                f"vergence not measured well enough: {driven} of driving determine it only to "
                f"{spread} (95 % interval); {_HOW}"
            )
            return VergenceCheck("unobserved", vergence, std, sentence, self._distance_m)
        share, share_half = (
            _depth_share(angle, self._camera.baseline) for angle in (vergence, half_95(std))
        )
        sentence = (
            f"the wheels confirm the calibrated vergence over {driven}: "
            f"{format_number(math.degrees(vergence), 2, signed=True)}° {spread} from it, or "
            f"{format_number(share, 1, signed=True)} ± "
            f"{share_half:.1f} % of depth at {_AT_M:g} m (95 % intervals, with a "
            f"{100 * half_95(WHEEL_SCALE_SIGMA):.1f} % scale error allowed for the wheels)"
        )
        return VergenceCheck("consistent", vergence, std, sentence, self._distance_m)

    def _strange(self, scale: float, excess: float) -> bool:
        """Return whether near and far points alike contradict the wheels, whatever the vergence.

        Args:
            scale: the wheels' scale error by the spread of disparities alone, a share.
            excess: factor on the variance of the pairs' fits.
        """
        (a, b), (_, c) = self._information.tolist()
        left = c - b * b / a if a > 0 else 0.0
        if left <= 0:
            return False
        sigma = math.hypot(math.sqrt(excess / left), WHEEL_SCALE_SIGMA)
        return abs(scale) > max(_STRANGE_SCALE, _SURE_SIGMAS * sigma)


def drift_words(vergence: float, std: float, baseline: float) -> tuple[str, str]:
    """Return in words how far the vergence is from the calibrated one, and its effect on depth.

    Args:
        vergence, std: radians beyond the calibration, and one standard deviation.
        baseline: metres.
    """
    course, error = ("more", "far") if vergence > 0 else ("less", "near")
    lead = (
        f"the cameras converge {course} than calibrated, by {abs(math.degrees(vergence)):.2f}° ± "
        f"{math.degrees(half_95(std)):.2f}° (95 % interval)"
    )
    share = abs(_depth_share(vergence, baseline))
    return lead, f"points at {_AT_M:g} m appear about {share:.0f} % too {error}"


def _depth_share(vergence: float, baseline: float) -> float:
    """Depth error at ``_AT_M``, per cent.

    Depth appears multiplied by d / (d - f v), which is 1 + v Z / B for small v.
    """
    return 100 * vergence * _AT_M / baseline


# Typical sizes of vergence and scale errors, rad and 1; they make the two comparable.
_UNITS = np.array([1e-3, 1e-2])


def _unobserved(sentence: str) -> VergenceCheck:
    return VergenceCheck("unobserved", None, None, sentence)


def _missing(odometry: Odometry | None) -> str:
    if odometry is None:
        return f"vergence cannot be measured: the source reports no wheel odometry; {_HOW}"
    return (
        "vergence cannot be measured: this method does not match points between left and right; "
        "set ego_motion.model to rigid"
    )


def _turn(before: Odometry, now: Odometry) -> float:
    return abs(math.remainder(now.yaw - before.yaw, 2 * math.pi))


def _pair(before: _Seen, now: _Seen, mount: CameraMount) -> tuple[SeenTwice, float]:
    """Return the points seen in both views, and the distance between them by the wheels, metres."""
    _, distance_m, turn = driven_step(before.odometry, now.odometry, mount)
    T_now_before = now.T_world_camera.inverse() @ before.T_world_camera
    distance_std_m = math.hypot(_STEP_M, mount.lever_sigma_m * turn)
    return SeenTwice.of(before.rows, now.rows, T_now_before, distance_m, distance_std_m), distance_m
