"""Step 4 with depth: the camera's own motion as a rigid one, with six degrees of freedom.

The points that do not move are where they were in the world; the pose is the one from which they
look as they do now, in the left image and in their disparity. RANSAC finds it, least squares on
its inliers refine it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose, cross_matrix, inverse_3x3
from observer.parameters import EgoMotionParameters
from observer.types import Status

_SAMPLE = 3
_BATCH = 32
_CONFIDENCE = 0.9999
_SAMPLE_STEPS = 3
_REFINE_STEPS = 4
# Most points used to judge a sample; more do not make the better one better known.
_JUDGES = 200
# A pose that explains less than this share of the points may follow an obstacle instead.
_WEAK_SHARE = 0.4
# Residuals beyond this many standard deviations are outliers of the refinement.
_OUTLIER_SIGMAS = 3.5
_DAMPING = 1e-9
_MEDIAN_CHI2 = float(chi2.ppf(0.5, df=3))


@dataclass(frozen=True, eq=False)
class StaticScene:
    """N points of the world that are taken for static, and where they are seen now.

    Attributes:
        position: (N, 3) metres, world. covariance: (N, 3, 3) m^2.
        px: (N, 2) pixels now, left image. disparity: (N,) pixels now, NaN unknown.
        sigma: (N, 3) pixels, standard deviations of u, v and disparity.
        weight: (N,) share of the image a point stands for; where points are dense it is less, so
            that a well textured obstacle cannot outvote the background.
    """

    position: Float64Array
    covariance: Float64Array
    px: Float64Array
    disparity: Float64Array
    sigma: Float64Array
    weight: Float64Array

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True, eq=False)
class RigidEgoMotion:
    """The camera's pose at t+dt, and its motion since t (see ``observer.types.EgoMotion``).

    Attributes:
        camera: the rectified pair, by which ``predict`` projects.
        inliers: (N,) which points follow it: the static background.
        T_camera_world: pose at t+dt; None while lost.
        T_current_previous: the motion; None while lost.
        pose_covariance: (6, 6) of both, as rotation vector (rad) and translation (m) in the
            camera's axes; None while lost.
        residual_rms: of the inliers, in standard deviations of their noise; NaN while lost.
        noise_scale: by how much all points, not only the inliers, scatter more than their noise;
            by the median, so that obstacles do not count.
    """

    camera: StereoCamera
    status: Status
    reasons: tuple[str, ...]
    inliers: NDArray[np.bool_]
    T_camera_world: Pose | None
    T_current_previous: Pose | None
    pose_covariance: Float64Array | None
    residual_rms: float
    noise_scale: float

    @property
    def covariance(self) -> Float64Array | None:
        """(6, 6): the model's parameters are the motion itself."""
        return self.pose_covariance

    @property
    def homography(self) -> None:
        """No image is warped."""
        return None

    def predict(self, px: Float64Array, disparity: Float64Array | None) -> Float64Array:
        """Pixels (N, 2) at t+dt of static points at (N, 2) with disparity (N,) at t.

        NaN while lost and for points of unknown disparity.
        """
        px = np.asarray(px, dtype=np.float64).reshape(-1, 2)
        if self.T_current_previous is None or disparity is None:
            return np.full_like(px, np.nan)
        place = self.T_current_previous.apply(self.camera.triangulate(px, disparity))
        return self.camera.project(place)[0]


def estimate_rigid_motion(
    scene: StaticScene,
    T_previous_world: Pose,
    T_expected_world: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    seed: int,
) -> RigidEgoMotion:
    """Find the camera's pose from static points by RANSAC, and refine it on the inliers.

    Args:
        T_previous_world: the pose at t. T_expected_world: about where the camera should be now;
            where the search begins.
        seed: decides the samples; the frame's number, so that equal input gives equal results.

    Returns:
        A motion whose status is ``lost``, with the reason, where the points do not allow one.
    """
    count = len(scene)
    if count < parameters.min_inliers:
        return _lost(
            camera,
            count,
            f"only {count} static points could be followed, {parameters.min_inliers} are needed: "
            f"too few features, or too large a motion",
        )
    pose = _ransac(scene, T_expected_world, camera, parameters, np.random.default_rng(seed))
    inliers = _fits(scene, pose, camera, parameters.ransac_threshold_px)
    information = np.zeros((6, 6))
    rms = float("nan")
    for step in range(_REFINE_STEPS):
        if np.count_nonzero(inliers) < parameters.min_inliers:
            break
        pose, information, mahalanobis = _refined(scene, inliers, pose, camera)
        fits = _fits(scene, pose, camera, parameters.ransac_threshold_px)
        near = mahalanobis <= _OUTLIER_SIGMAS if step else np.ones(count, np.bool_)
        inliers = fits & near
        rms = float(np.sqrt(np.mean(mahalanobis[inliers] ** 2))) if inliers.any() else rms
    support = int(inliers.sum())
    if support < parameters.min_inliers:
        return _lost(
            camera,
            count,
            f"only {support} of {count} points follow one motion, "
            f"{parameters.min_inliers} are needed",
        )
    reasons = []
    if support < 2 * parameters.min_inliers:
        reasons.append(f"the camera's motion rests on {support} points only")
    if support < _WEAK_SHARE * count:
        reasons.append(f"only {100 * support / count:.0f} % of the points follow one motion")
    # Residuals of three dimensions have a mean square of 3; more means more noise than declared.
    excess = max(1.0, rms**2 / 3)
    covariance = np.linalg.pinv(information) * excess * _shared(support, parameters)
    return RigidEgoMotion(
        camera=camera,
        status=Status.DEGRADED if reasons else Status.OK,
        reasons=tuple(reasons),
        inliers=inliers,
        T_camera_world=pose,
        T_current_previous=pose @ T_previous_world.inverse(),
        pose_covariance=covariance.astype(np.float64),
        residual_rms=rms,
        noise_scale=float(np.sqrt(np.median(mahalanobis**2) / _MEDIAN_CHI2)),
    )


def _shared(count: int, parameters: EgoMotionParameters) -> float:
    """By how much errors that points share make the result worse than independent ones would."""
    return 1 + parameters.shared_error * count


def _lost(camera: StereoCamera, count: int, reason: str) -> RigidEgoMotion:
    return RigidEgoMotion(
        camera=camera,
        status=Status.LOST,
        reasons=(reason,),
        inliers=np.zeros(count, np.bool_),
        T_camera_world=None,
        T_current_previous=None,
        pose_covariance=None,
        residual_rms=float("nan"),
        noise_scale=1.0,
    )


def _ransac(
    scene: StaticScene,
    start: Pose,
    camera: StereoCamera,
    parameters: EgoMotionParameters,
    rng: np.random.Generator,
) -> Pose:
    """The best of many poses, each the least-squares fit of three points, all tried at once.

    As in libviso2 (Geiger et al., StereoScan, 2011); a sample of three points with disparity is
    solved by a few Gauss-Newton steps from the expected pose.
    """
    deep = np.flatnonzero(np.isfinite(scene.disparity))
    if len(deep) < _SAMPLE:
        return start
    judges = np.linspace(0, len(scene) - 1, min(_JUDGES, len(scene))).astype(np.intp)
    sigma = _total_sigma(scene, start, camera)
    limit = np.minimum(parameters.ransac_threshold_px, _OUTLIER_SIGMAS * sigma[:, 0])[judges]
    cap = (limit / sigma[judges, 0]) ** 2
    weight = scene.weight[judges]
    best, best_cost, tried, wanted = start, np.inf, 0, float(parameters.ransac_iterations)
    # The expected pose itself is a candidate: in quiet driving it is nearly right.
    while tried < wanted:
        R = np.broadcast_to(start.rotation, (_BATCH, 3, 3)).copy()
        t = np.broadcast_to(start.translation, (_BATCH, 3)).copy()
        sample = deep[rng.integers(0, len(deep), (_BATCH, _SAMPLE))]
        for _ in range(_SAMPLE_STEPS):
            R, t = _sample_step(scene, sample, R, t, camera)
        if tried == 0:
            R[0], t[0] = start.rotation, start.translation
        squared = _squared(scene, judges, sigma[judges], R, t, camera)
        # MSAC: an outlier costs what the worst inlier costs (Torr and Zisserman, 2000).
        cost = np.minimum(squared, cap) @ weight
        cost[~np.isfinite(cost)] = np.inf
        number = int(np.argmin(cost))
        if cost[number] < best_cost:
            best_cost = float(cost[number])
            best = Pose(_orthonormal(R[number]), t[number])
            share = float(np.mean(squared[number] <= cap))
            miss = np.log1p(-min(share**_SAMPLE, 1 - 1e-9)) if share > 0 else -1e-9
            wanted = min(wanted, np.log(1 - _CONFIDENCE) / miss)
        tried += _BATCH
    return best


def _camera_points(
    scene: StaticScene, which: NDArray[np.intp], R: Float64Array, t: Float64Array
) -> Float64Array:
    """(S, K, 3) of points (K,) or (S, K) from S poses."""
    return np.asarray(scene.position[which] @ np.swapaxes(R, 1, 2) + t[:, None, :])


def _residuals(
    scene: StaticScene, which: NDArray[np.intp], p: Float64Array, camera: StereoCamera
) -> Float64Array:
    """(..., 3) pixels: seen minus predicted u, v and disparity; 0 for unknown disparities."""
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = np.where(p[..., 2] > 0, 1 / p[..., 2], np.nan)
        r = np.empty(p.shape)
        r[..., 0] = scene.px[which, 0] - (camera.fx * p[..., 0] * inverse + camera.cx)
        r[..., 1] = scene.px[which, 1] - (camera.fy * p[..., 1] * inverse + camera.cy)
        r[..., 2] = scene.disparity[which] - camera.fx * camera.baseline * inverse
    r[..., 2] = np.where(np.isnan(scene.disparity[which]), 0.0, r[..., 2])
    return r


def _total_sigma(scene: StaticScene, pose: Pose, camera: StereoCamera) -> Float64Array:
    """(N, 3) pixels: of u, v, disparity, of the sighting and of what is known of the place."""
    J = camera.projection_jacobian(pose.apply(scene.position)) @ pose.rotation
    spread = np.einsum("nij,njk,nik->ni", J, scene.covariance, J)
    return np.sqrt(scene.sigma**2 + np.where(np.isfinite(spread), spread, 0.0))


def _squared(
    scene: StaticScene,
    which: NDArray[np.intp],
    sigma: Float64Array,
    R: Float64Array,
    t: Float64Array,
    camera: StereoCamera,
) -> Float64Array:
    """(S, K) squared residuals of K points at S poses, in standard deviations."""
    r = _residuals(scene, which, _camera_points(scene, which, R, t), camera) / sigma
    squared = np.einsum("ski,ski->sk", r, r)
    return np.where(np.isfinite(squared), squared, np.inf)


def _jacobian(p: Float64Array, camera: StereoCamera) -> Float64Array:
    """(..., 3, 6) derivative of u, v, disparity by a small rotation and translation of points."""
    J = camera.projection_jacobian(p)
    return np.concatenate([J @ -cross_matrix(p), J], axis=-1)


def _sample_step(
    scene: StaticScene,
    sample: NDArray[np.intp],
    R: Float64Array,
    t: Float64Array,
    camera: StereoCamera,
) -> tuple[Float64Array, Float64Array]:
    p = _camera_points(scene, sample, R, t)
    r = _residuals(scene, sample, p, camera) / scene.sigma[sample]
    J = _jacobian(p, camera) / scene.sigma[sample][..., None]
    J, r = J.reshape(len(R), -1, 6), r.reshape(len(R), -1)
    bad = ~(np.isfinite(J).all(axis=(1, 2)) & np.isfinite(r).all(axis=1))
    J[bad], r[bad] = 0.0, 0.0
    A = np.swapaxes(J, 1, 2) @ J
    A[:, range(6), range(6)] += _DAMPING + 1e-6 * A[:, range(6), range(6)]
    step = np.linalg.solve(A, np.einsum("sai,sa->si", J, r)[..., None])[..., 0]
    # Three points nearly in a line turn anyhow; such samples lose, and must not overflow.
    step = np.clip(step, -1e3, 1e3)
    turn = Rotation.from_rotvec(step[:, :3]).as_matrix()
    return turn @ R, np.einsum("sij,sj->si", turn, t) + step[:, 3:]


def _fits(
    scene: StaticScene, pose: Pose, camera: StereoCamera, threshold_px: float
) -> NDArray[np.bool_]:
    """(N,) which points the pose explains, allowing for how well each one's place is known."""
    r = _residuals(scene, np.arange(len(scene)), pose.apply(scene.position), camera)
    sigma = _total_sigma(scene, pose, camera)
    scaled = r * (sigma[:, :1] / sigma)
    squared = np.einsum("ni,ni->n", scaled, scaled)
    with np.errstate(invalid="ignore"):
        return np.asarray(squared <= threshold_px**2, dtype=np.bool_)


def _refined(
    scene: StaticScene, inliers: NDArray[np.bool_], pose: Pose, camera: StereoCamera
) -> tuple[Pose, Float64Array, Float64Array]:
    """One Gauss-Newton step on the inliers, weighted by each point's full covariance.

    Returns:
        the new pose, the information (6, 6) and all points' Mahalanobis lengths (N,) before it.
    """
    p = pose.apply(scene.position)
    r = _residuals(scene, np.arange(len(scene)), p, camera)
    J = camera.projection_jacobian(p)
    JR = J @ pose.rotation
    S = JR @ scene.covariance @ np.swapaxes(JR, 1, 2)
    variance = np.where(np.isnan(scene.disparity)[:, None], scene.sigma**2 + 1e9 * _LAST, 0.0)
    variance = np.where(variance > 0, variance, scene.sigma**2)
    S[:, range(3), range(3)] += variance
    W = inverse_3x3(S)
    Wr = np.einsum("nij,nj->ni", W, r)
    squared = np.einsum("ni,ni->n", r, Wr)
    mahalanobis = np.sqrt(np.where(np.isfinite(squared), np.maximum(squared, 0.0), np.inf))
    use = inliers & np.isfinite(mahalanobis)
    # Huber's weights: what is far off, yet no outlier, counts by its distance only.
    weight = np.minimum(1.0, 2.0 / np.maximum(mahalanobis[use], 1e-9))
    J6 = np.concatenate([J[use] @ -cross_matrix(p[use]), J[use]], axis=-1)
    WJ = (W[use] * weight[:, None, None]) @ J6
    A = np.einsum("nai,naj->ij", J6, WJ)
    b = np.einsum("nai,na->i", J6, Wr[use] * weight[:, None])
    step = np.linalg.lstsq(A, b, rcond=1e-12)[0]
    step = np.clip(step, -10.0, 10.0)
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    moved = Pose(_orthonormal(turn @ pose.rotation), turn @ pose.translation + step[3:])
    return moved, A, mahalanobis


_LAST = np.array([0.0, 0.0, 1.0])


def _orthonormal(R: Float64Array) -> Float64Array:
    u, _, vt = np.linalg.svd(R)
    return np.asarray(u @ vt, dtype=np.float64)
