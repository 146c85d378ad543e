"""Height, tilt and roll of the camera from the ground that it sees by stereo."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from observer.calibration.fitting.uncertainty import numeric_jacobian
from observer.camera import StereoCamera
from observer.geometry import Float64Array
from observer.intervals import half_95
from observer.mount import CameraMount
from observer.number_format import format_number
from observer.rig.estimates import Estimated, Refused
from observer.rig.ground_planes import DisparityPoints, LevelPlane, level_planes, stand_of
from observer.robust import MAD_TO_SIGMA

# Disparity noise, one standard deviation: of a single disparity; the bias that a calibration
# leaves at the image's edge, each for a constant offset and for slopes across the image; and the
# error that it leaves in focal length times baseline, as a share.
_SIGMA_PX, _BIAS_PX, _SCALE = 0.35, 0.2, 0.005
# Share of the points judged against the floor that may lie beneath it: mismatches and reflections
# in the floor reach this.
_MOST_BENEATH = 0.15
# Shares of a plane's points with which a second plane competes with it, or is the floor below it.
_RIVAL, _FLOOR_OF_TABLE = 0.4, 0.1
_SAME_HEIGHT, _SAME_HEIGHT_M, _SAME_ANGLE = 0.1, 0.03, math.radians(3)
# Points of a view that are used.
MOST_POINTS = 20_000
_FEWEST_POINTS = 500
# Errors of neighbouring pixels are correlated: the image has this many cells each way, and all
# points of a cell are taken to err together.
_CELLS = 8
# Standard deviations too large to be of use; metres or share of the height, radians.
_USELESS_HEIGHT_M, _USELESS_HEIGHT, _USELESS_ANGLE = 0.03, 0.06, math.radians(1.5)
_LEAST_SHARE_OF_VIEWS = 0.5


@dataclass(frozen=True)
class GroundEstimate:
    """Height and attitude of the camera above the ground.

    Attributes:
        height_m: metres. tilt_rad, roll_rad: as in ``CameraMount``, radians.
        share: of all points that lie on the floor; the median of the views.
        views: how many views gave an estimate. views_left_out: how many did not.
        sentence: the result in words.
    """

    height_m: Estimated
    tilt_rad: Estimated
    roll_rad: Estimated
    share: float
    views: int
    views_left_out: int
    sentence: str

    @property
    def mount(self) -> CameraMount:
        """The mount as far as the floor determines it."""
        return CameraMount(self.height_m.value, self.tilt_rad.value, roll_rad=self.roll_rad.value)


def estimate_ground(views: Sequence[ArrayLike], camera: StereoCamera) -> GroundEstimate | Refused:
    """Estimate the ground plane below a camera from stereo clouds of one or more frames.

    The floor is the largest level plane below the camera that has next to nothing beneath it, or
    a level plane below that one: this tells it from tables and boxes. The camera is assumed to be
    firmly mounted: all views see one plane, and their median counts. Walls are excluded by tilt
    (within 45 degrees) and roll (within 20).

    The standard deviations include the uncertainty of one view (each image cell errs as a whole),
    the spread of the views, and the disparity bias that a calibration leaves, which no number of
    views removes.

    Args:
        views: for each frame points (N, 3), metres, camera frame, as dense stereo gives them;
            rows with NaN are left out.
        camera: on the same pixel grid that the clouds were made on.
    """
    found: list[_GroundView] = []
    refused: list[str] = []
    for number, view in enumerate(views):
        one = _ground_of_view(_disparity_points(view, camera, number), camera, number)
        if isinstance(one, Refused):
            refused.append(one.sentence)
        else:
            found.append(one)
    if not found and not refused:
        return Refused("no view of the floor was given; at least one stereo point cloud is needed")
    if len(found) < _LEAST_SHARE_OF_VIEWS * len(views):
        return Refused(max(refused, key=refused.count))
    return _combined(found, len(refused), camera)


@dataclass(frozen=True, eq=False)
class _GroundView:
    """Plane coefficients (3,) of one view, and their covariance (3, 3) by its own noise alone."""

    coefficients: Float64Array
    covariance: Float64Array
    share: float


def _disparity_points(view: ArrayLike, camera: StereoCamera, number: int) -> DisparityPoints:
    points = np.asarray(view, np.float64).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1) & (points[:, 2] > 0)]
    if len(points) > MOST_POINTS:
        rng = np.random.default_rng(np.random.SeedSequence([number, 0xF101]))
        points = points[rng.permutation(len(points))[:MOST_POINTS]]
    ray = points / points[:, 2:]
    return DisparityPoints(ray, camera.fb / points[:, 2])


def _ground_of_view(
    points: DisparityPoints, camera: StereoCamera, number: int
) -> _GroundView | Refused:
    if len(points) < _FEWEST_POINTS:
        return Refused(
            f"only {len(points)} points have a depth, and {_FEWEST_POINTS} are needed; check that "
            "both cameras are uncovered, in focus and calibrated"
        )
    planes = level_planes(points, camera.fb, _SIGMA_PX, number)
    if not planes:
        return Refused(
            "no level plane is visible below the camera; turn the robot towards open floor, and "
            "check that the camera looks ahead and is mounted upright"
        )
    floor = _lowest(planes)
    if isinstance(floor, Refused):
        return floor
    if floor.support < _FEWEST_POINTS:
        return Refused(
            f"only {floor.support} points are visible on the floor, and {_FEWEST_POINTS} are "
            "needed; turn the robot towards more open floor, or lay newspapers on a floor without "
            "texture"
        )
    covariance = _covariance(points.chosen(floor.members), floor)
    return _GroundView(floor.coefficients, covariance, floor.support / len(points))


def _lowest(planes: list[LevelPlane]) -> LevelPlane | Refused:
    """Return the floor among planes sorted by size, largest first; refused if two compete.

    It is the largest plane with next to nothing beneath it, or a level plane that carries that one.
    """
    nothing_beneath = [plane for plane in planes if plane.beneath <= _MOST_BENEATH]
    if not nothing_beneath:
        return Refused(
            f"a level plane was found {planes[0].words}, but {100 * planes[0].beneath:.0f} % of "
            "the points there lie beneath it, so it is not the floor; turn the robot towards open "
            "floor"
        )
    floor = nothing_beneath[0]
    for lower in nothing_beneath[1:]:
        if lower.support >= _FLOOR_OF_TABLE * floor.support and lower.carries(floor):
            floor = lower
    for rival in planes:
        # A plane with only the floor beneath it may be a ramp, and the robot may stand on either.
        if (
            rival.support >= _RIVAL * floor.support
            and rival.beneath_but_for(floor) <= _MOST_BENEATH
            and not floor.carries(rival)
            and not _same(floor, rival)
        ):
            return Refused(
                f"two planes could be the floor: one {floor.words}, one {rival.words}; turn the "
                "robot towards open, flat floor"
            )
    return floor


def _same(a: LevelPlane, b: LevelPlane) -> bool:
    height, tilt, roll = np.abs(a.stand - b.stand)
    near = max(_SAME_HEIGHT_M, _SAME_HEIGHT * a.stand[0])
    return bool(height < near and tilt < _SAME_ANGLE and roll < _SAME_ANGLE)


def _covariance(points: DisparityPoints, floor: LevelPlane) -> Float64Array:
    """(3, 3) of the coefficients: the residuals of one image cell count as one error.

    The "sandwich" estimator for clustered errors (Liang and Zeger, 1986): dense stereo smooths, so
    the pixels hold far less information than their number suggests.
    """
    residual = points.disparity - points.ray @ floor.coefficients
    low, high = points.ray[:, :2].min(axis=0), points.ray[:, :2].max(axis=0)
    cell = np.minimum((points.ray[:, :2] - low) / (high - low + 1e-12) * _CELLS, _CELLS - 1)
    number = cell[:, 0].astype(np.intp) * _CELLS + cell[:, 1].astype(np.intp)
    scores = np.zeros((_CELLS * _CELLS, 3))
    np.add.at(scores, number, points.ray * residual[:, None])
    information = np.linalg.pinv(points.ray.T @ points.ray)
    cells = len(np.unique(number))
    excess = cells / max(1, cells - 3)
    return np.asarray(information @ (scores.T @ scores) @ information * excess)


def _combined(
    found: list[_GroundView], left_out: int, camera: StereoCamera
) -> GroundEstimate | Refused:
    fb = camera.fb
    poses = np.array([stand_of(view.coefficients, fb) for view in found])
    middle = np.median(poses, axis=0)
    spread = MAD_TO_SIGMA * np.median(np.abs(poses - middle), axis=0)
    # Covariance of the coefficients by the bias that the calibration leaves: slopes and offset.
    edge = np.array([camera.width / 2 / camera.fx, camera.height / 2 / camera.fy, 1.0])
    bias = np.diag((_BIAS_PX / edge) ** 2)
    variances = []
    for view in found:
        J = numeric_jacobian(lambda c: stand_of(c, fb), view.coefficients, np.full(3, 1e-3))
        variances.append(np.diagonal(J @ (view.covariance + bias) @ J.T))
    # Views of one floor share its texture and their errors, so more of them improve nothing.
    variance = np.median(variances, axis=0) + spread**2
    variance[0] += (_SCALE * middle[0]) ** 2
    sigma = np.sqrt(variance)
    useless_m = max(_USELESS_HEIGHT_M, _USELESS_HEIGHT * middle[0])
    if sigma[0] > useless_m or sigma[1] > _USELESS_ANGLE or sigma[2] > _USELESS_ANGLE:
        return Refused(
            f"too little of the floor is visible, or the views disagree: height {middle[0]:.2f} ± "
            f"{half_95(sigma[0]):.2f} m, tilt {format_number(math.degrees(middle[1]), 1)} ± "
            f"{math.degrees(half_95(sigma[1])):.1f} degrees (95 % intervals); turn the robot "
            "towards more open floor and keep it still"
        )
    height, tilt, roll = (Estimated(float(v), float(s)) for v, s in zip(middle, sigma, strict=True))
    share = float(np.median([view.share for view in found]))
    return GroundEstimate(
        height, tilt, roll, share, len(found), left_out, _sentence(height, tilt, roll, share)
    )


def _sentence(height: Estimated, tilt: Estimated, roll: Estimated, share: float) -> str:
    return (
        f"the left camera is {100 * height.value:.1f} ± {100 * half_95(height.sigma):.1f} cm above "
        f"the floor, tilted down by {_degrees(tilt)} and rolled by {_degrees(roll)} (95 % "
        f"intervals); {100 * share:.0f} % of the image is floor"
    )


def _degrees(angle: Estimated) -> str:
    """Return an angle with half of its 95 % interval, in words."""
    value, sigma = angle.degrees.value, angle.degrees.sigma
    return f"{format_number(value, 1)} ± {half_95(sigma):.1f} degrees"
