"""Step 4 of the method: the camera's own motion by RANSAC; its inliers are static background.

The planar models (``affine``, ``homography``) describe how the image moves. The camera's pose is
estimated separately, by stereo PnP on their inliers, only to express results in the world frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, map_pixels
from observer.methods.contract import WEAK_SHARE
from observer.parameters import EgoMotionParameters
from observer.types import Matches, Status

_RANSAC_CONFIDENCE = 0.999
# Between two frames the image of the background cannot shrink or grow by more than this.
_MAX_SCALE = 1.6
# PnP's minimal solver takes 4 points; this many more make a wrong pose unlikely.
_MIN_PNP_POINTS = 8
_PNP_ITERATIONS = 200
# Rounds of refinement: first on the background, then on all matches that the pose explains.
_BACKGROUND_ROUNDS = 2
_ALL_ROUNDS = 4
# A pose that explains less than this share of the background is rejected.
_AGREED_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class PlanarEgoMotion:
    """Ego-motion as one planar map of the image (see ``observer.types.EgoMotion``).

    Attributes:
        model: ``affine`` or ``homography``.
        covariance: (6, 6) of t11 t12 t13 t21 t22 t23 (affine), or (8, 8) of h11 .. h32 (with
            h33 = 1), from the inliers' Jacobian and residuals; None while lost.
        homography: (3, 3) pixels at t to pixels at t+dt; None while lost.
        pose_covariance: (6, 6) of ``T_current_previous`` (rad, m) from PnP's Jacobian and
            residuals; None without a pose.
        residual_rms_px: root mean square residual of the inliers, per axis; NaN while lost.
    """

    model: str
    status: Status
    reasons: tuple[str, ...]
    inliers: NDArray[np.bool_]
    covariance: Float64Array | None = None
    homography: Float64Array | None = None
    T_current_previous: Pose | None = None
    pose_covariance: Float64Array | None = None
    residual_rms_px: float = float("nan")

    def refused(self, reason: str) -> PlanarEgoMotion:
        """Return this motion as lost, for the given reason."""
        return PlanarEgoMotion(self.model, Status.LOST, (*self.reasons, reason), self.inliers)

    def predict(self, px: Float64Array, disparity: Float64Array | None = None) -> Float64Array:
        """Pixels (N, 2) at t+dt of static points at (N, 2) at t; NaN while lost.

        ``disparity`` is not used: a planar model ignores depth, which is its weakness.
        """
        del disparity
        px = np.asarray(px, dtype=np.float64).reshape(-1, 2)
        if self.homography is None:
            return np.full_like(px, np.nan)
        return map_pixels(self.homography, px)


def estimate_ego_motion(
    matches: Matches,
    disparity: Float64Array | None,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> PlanarEgoMotion:
    """Fit the model by RANSAC to the matches, then the pose by PnP to its inliers.

    Args:
        matches: N matches in the left image.
        disparity: (N,) disparity at t of the matches, NaN = unknown; None without stereo, in
            which case no pose is estimated.
        seed: of the RANSAC samples; the frame number, so that equal input gives equal results.

    Returns:
        The motion; its status is ``lost``, with the reason, where the matches do not allow a fit.
    """
    count = len(matches)
    if count < parameters.min_inliers:
        return _lost(
            parameters.model,
            count,
            f"only {count} matches between the two images, {parameters.min_inliers} are needed: "
            f"too few features, or too large a motion",
        )
    # OpenCV's RANSAC uses its own random generator with a fixed seed, so the samples can only be
    # varied through the order of the matches.
    order = np.random.default_rng(seed).permutation(count)
    homography, found = _ransac(matches.previous[order], matches.current[order], parameters)
    inliers = np.zeros(count, np.bool_)
    inliers[order] = found
    support = int(inliers.sum())
    if homography is None or support < parameters.min_inliers:
        return _lost(
            parameters.model,
            count,
            f"only {support} of {count} matches agree on one motion, {parameters.min_inliers} are "
            "needed",
        )
    if not _is_plausible(homography, camera):
        return _lost(
            parameters.model,
            count,
            "the image transformation is implausible: it folds or scales the image",
        )
    covariance, rms = _covariance(parameters.model, homography, matches, inliers)
    pose = pose_covariance = None
    if disparity is not None:
        pose, pose_covariance = _pose(matches, disparity, inliers, camera, parameters)
    reasons = []
    if support < 2 * parameters.min_inliers:
        reasons.append(f"the ego-motion is supported by only {support} matches")
    if support < WEAK_SHARE * count:
        reasons.append(f"only {100 * support / count:.0f} % of the matches agree on one motion")
    if pose is None:
        reasons.append("the camera's pose is unknown: too few background points with depth")
    return PlanarEgoMotion(
        model=parameters.model,
        status=Status.DEGRADED if reasons else Status.OK,
        reasons=tuple(reasons),
        inliers=inliers,
        covariance=covariance,
        homography=homography,
        T_current_previous=pose,
        pose_covariance=pose_covariance,
        residual_rms_px=rms,
    )


@dataclass(frozen=True)
class AffineDecomposition:
    """Six affine parameters decomposed into the operations of the paper's table I.

    The linear part is rotation(angle) x [[scale_x, shear x scale_y], [0, scale_y]] with the
    rotation in the table's sign convention [[cos, sin], [-sin, cos]].

    Attributes:
        translation_px: (t13, t23). rotation_rad: angle. shear: horizontal, no unit.
        scale: along x and y; a negative y scale is a reflection.
    """

    translation_px: tuple[float, float]
    rotation_rad: float
    shear: float
    scale: tuple[float, float]


def decompose_affine(matrix: Float64Array) -> AffineDecomposition:
    """Return translation, rotation, shear and scale of an affine map (2, 3) or (3, 3).

    For a homography, its affine part is used (the map near the image's origin).
    """
    m = np.asarray(matrix, dtype=np.float64)
    (t11, t12, t13), (t21, t22, t23) = m[:2].tolist()
    angle = float(np.arctan2(-t21, t11))
    c, s = np.cos(angle), np.sin(angle)
    scale_x = float(np.hypot(t11, t21))
    skew, scale_y = float(c * t12 - s * t22), float(s * t12 + c * t22)
    return AffineDecomposition(
        translation_px=(t13, t23),
        rotation_rad=angle,
        shear=skew / scale_y if scale_y else float("nan"),
        scale=(scale_x, scale_y),
    )


def _lost(model: str, count: int, reason: str) -> PlanarEgoMotion:
    return PlanarEgoMotion(model, Status.LOST, (reason,), np.zeros(count, np.bool_))


def _ransac(
    previous: NDArray[np.float32], current: NDArray[np.float32], parameters: EgoMotionParameters
) -> tuple[Float64Array | None, NDArray[np.bool_]]:
    if parameters.model == "affine":
        affine, mask = cv2.estimateAffine2D(
            previous,
            current,
            method=cv2.RANSAC,
            ransacReprojThreshold=parameters.ransac_threshold_px,
            maxIters=parameters.ransac_iterations,
            confidence=_RANSAC_CONFIDENCE,
        )
        matrix = None if affine is None else np.vstack([affine, (0.0, 0.0, 1.0)])
    else:
        matrix, mask = cv2.findHomography(
            previous,
            current,
            cv2.RANSAC,
            parameters.ransac_threshold_px,
            maxIters=parameters.ransac_iterations,
            confidence=_RANSAC_CONFIDENCE,
        )
    if matrix is None or not np.isfinite(matrix).all():
        return None, np.zeros(len(previous), np.bool_)
    return np.asarray(matrix, dtype=np.float64), np.asarray(mask[:, 0] > 0, dtype=np.bool_)


def _is_plausible(homography: Float64Array, camera: StereoCamera) -> bool:
    # Checked at the image's corners and centre, since a homography's scale varies over the image.
    w, h = camera.width - 1.0, camera.height - 1.0
    corners = np.array([[0, 0], [w, 0], [w, h], [0, h], [w / 2, h / 2]])
    scale = homography[2, :2] @ corners.T + homography[2, 2]
    if (scale <= 0).any():
        return False
    J = _local_map(homography, corners)
    area = np.linalg.det(J)
    lengths = np.linalg.svd(J, compute_uv=False)
    lengths = np.maximum(lengths, 1 / lengths)
    return bool((area > 0).all() and (lengths < _MAX_SCALE).all())


def _local_map(homography: Float64Array, px: Float64Array) -> Float64Array:
    """(N, 2, 2) derivative of the mapped pixel with respect to the pixel."""
    w = px @ homography[2, :2] + homography[2, 2]
    mapped = map_pixels(homography, px)
    return np.asarray(
        (homography[None, :2, :2] - mapped[:, :, None] * homography[None, None, 2, :2])
        / w[:, None, None],
        dtype=np.float64,
    )


def _jacobian(model: str, homography: Float64Array, px: Float64Array) -> Float64Array:
    """(N, 2, P) derivative of the predicted pixel with respect to the model's parameters."""
    x, y = px[:, 0], px[:, 1]
    J = np.zeros((len(px), 2, 6 if model == "affine" else 8))
    w = px @ homography[2, :2] + homography[2, 2]
    for axis in (0, 1):
        J[:, axis, 3 * axis : 3 * axis + 3] = np.stack([x, y, np.ones_like(x)], 1) / w[:, None]
    if model != "affine":
        mapped = map_pixels(homography, px)
        J[:, :, 6] = -mapped * (x / w)[:, None]
        J[:, :, 7] = -mapped * (y / w)[:, None]
    return J


def _covariance(
    model: str, homography: Float64Array, matches: Matches, inliers: NDArray[np.bool_]
) -> tuple[Float64Array, float]:
    """sigma^2 (J^T J)^-1 with sigma^2 from the inliers' own residuals, and sigma."""
    px = matches.previous[inliers].astype(np.float64)
    J = _jacobian(model, homography, px)
    parameters = J.shape[2]
    residual = matches.current[inliers] - map_pixels(homography, px)
    variance = float((residual**2).sum()) / max(1, 2 * len(px) - parameters)
    information = np.einsum("nai,naj->ij", J, J)
    return np.asarray(variance * np.linalg.pinv(information), np.float64), float(np.sqrt(variance))


def _pose(
    matches: Matches,
    disparity: Float64Array,
    inliers: NDArray[np.bool_],
    camera: StereoCamera,
    parameters: EgoMotionParameters,
) -> tuple[Pose | None, Float64Array | None]:
    """``T_current_previous`` by stereo PnP-RANSAC on the background, and its covariance.

    It is first refined on the planar model's inliers alone, which are known to be background.
    Only then are other matches that this pose explains added, for their range of depths: the
    inliers lie near one plane, which separates rotation from sideways motion badly. If all
    matches were used at once, a wall and an object moving in front of it could together be
    explained by a wrong camera motion.
    """
    known = np.isfinite(disparity)
    background = inliers & known
    if np.count_nonzero(background) < _MIN_PNP_POINTS:
        return None, None
    points = camera.triangulate(matches.previous, disparity)
    px = matches.current.astype(np.float64)
    threshold = parameters.ransac_threshold_px
    found, rotation, translation, _ = cv2.solvePnPRansac(
        points[background],
        px[background],
        camera.K,
        None,
        iterationsCount=_PNP_ITERATIONS,
        reprojectionError=threshold,
        confidence=_RANSAC_CONFIDENCE,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not found:
        return None, None
    for candidates in _BACKGROUND_ROUNDS * (background,) + _ALL_ROUNDS * (known,):
        if not (np.isfinite(rotation).all() and np.isfinite(translation).all()):
            return None, None
        pose = Pose.from_rotvec(rotation, translation)
        near = candidates & _explained(pose, points, px, camera, threshold)
        agreed = np.count_nonzero(near & background) / np.count_nonzero(background)
        if np.count_nonzero(near) < _MIN_PNP_POINTS or agreed < _AGREED_SHARE:
            return None, None
        rotation, translation = cv2.solvePnPRefineLM(
            points[near], px[near], camera.K, None, rotation, translation
        )
    pose = Pose.from_rotvec(rotation, translation)
    return pose, _pose_covariance(pose, points[near], px[near], camera)


def _explained(
    pose: Pose, points: Float64Array, px: Float64Array, camera: StereoCamera, threshold: float
) -> NDArray[np.bool_]:
    """(N,) which points reproject to within ``threshold`` pixels of where they are seen."""
    projected, _ = camera.project(pose.apply(points))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.linalg.norm(projected - px, axis=1) <= threshold, dtype=np.bool_)


def _pose_covariance(
    pose: Pose, points: Float64Array, px: Float64Array, camera: StereoCamera
) -> Float64Array:
    """(6, 6) sigma^2 (J^T J)^-1 with sigma^2 from the residuals of the points used."""
    projected, jacobian = cv2.projectPoints(
        points, pose.rotvec, pose.translation, camera.K, np.zeros(4)
    )
    residual = px - np.asarray(projected, dtype=np.float64)[:, 0]
    J = np.asarray(jacobian, dtype=np.float64)[:, :6]
    variance = float((residual**2).sum()) / max(1, 2 * len(px) - 6)
    return np.asarray(variance * np.linalg.pinv(J.T @ J), dtype=np.float64)
