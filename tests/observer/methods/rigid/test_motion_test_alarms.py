"""False alarms of the motion test: their declared rate, and errors that all points share."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from observer.camera import StereoCamera
from observer.geometry import Float64Array, cross_matrix
from observer.parameters import EvidenceParameters
from observer.vision.camera_rate import CameraRate

from ...builders import LAB, ROAD, points_in_view, watched
from .pooled_motion import DT, STEP_STD, STILL, P, board, pooled


def ground(camera: StereoCamera, count: int, rng: np.random.Generator) -> Float64Array:
    """(N, 3) points on a floor from 1 m to 8 m ahead of a camera with a baseline of 0.12 m."""
    px = rng.uniform((8, 8), (camera.width - 9, camera.height - 9), (count, 2))
    near, far = camera.baseline / 0.12, 8 * camera.baseline / 0.12
    steepness = (px[:, 1] - 8) / (camera.height - 17)
    inverse = 1 / far + (1 / near - 1 / far) * steepness
    return camera.triangulate(px, camera.fx * camera.baseline * inverse)


def alarm_rate(
    draws: int,
    parameters: EvidenceParameters,
    *,
    step_std: Float64Array | None = None,
    stated_cov: Float64Array = STILL,
    camera: StereoCamera = LAB,
    memory_s: float = 0.5,
) -> float:
    """Share of frames of a static scene in which anything counts as dynamic."""
    alarms = 0
    for seed in range(draws):
        rng = np.random.default_rng(seed)
        points = watched(
            camera, ground(camera, 150, rng), np.zeros(3), rng,
            frames=6, step_std=step_std, memory_s=memory_s,
        )  # fmt: skip
        motion = pooled(points, camera=camera, step_covariance=stated_cov, parameters=parameters)
        alarms += bool(motion.dynamic.any())
    return alarms / draws


def likely(rate: float, draws: int) -> tuple[float, float]:
    """Bounds of the share of alarms in ``draws`` frames, exceeded once in a thousand cases."""
    low, high = np.asarray(binom.ppf([0.0005, 0.9995], draws, rate)) / draws
    return float(low), float(high)


@pytest.mark.parametrize("rate", [0.05, 0.4])
def test_false_alarms_occur_at_the_declared_rate(rate: float) -> None:
    """If all assumptions hold: independent errors, and nothing is forgotten."""
    draws = 120
    p = P.model_copy(
        update={"false_alarms_per_frame": rate, "noise_correlation": 0.0, "min_points": 1}
    )
    low, high = likely(rate, draws)
    assert low / 2 <= alarm_rate(draws, p, memory_s=1e9) <= 1.3 * high


@pytest.mark.parametrize("camera", [LAB, ROAD])
def test_false_alarms_do_not_exceed_the_declared_rate_by_default(camera: StereoCamera) -> None:
    draws, rate = 120, 0.05
    p = P.model_copy(update={"false_alarms_per_frame": rate})
    assert alarm_rate(draws, p, camera=camera) <= likely(rate, draws)[1]


def test_a_stated_pose_error_causes_no_false_alarms() -> None:
    draws, rate = 120, 0.05
    p = P.model_copy(update={"false_alarms_per_frame": rate})
    alarms = alarm_rate(draws, p, step_std=5 * STEP_STD, stated_cov=np.diag((5 * STEP_STD) ** 2))
    assert alarms <= likely(rate, draws)[1]
    assert alarm_rate(20, p, step_std=5 * STEP_STD) > 0.5


def test_the_threshold_follows_from_the_declared_rate() -> None:
    points = watched(
        LAB,
        points_in_view(LAB, 100, np.random.default_rng(0), 1, 8),
        np.zeros(3),
        np.random.default_rng(1),
    )
    strict, lax = (
        pooled(points, parameters=P.model_copy(update={"false_alarms_per_frame": rate})).threshold
        for rate in (1e-6, 0.1)
    )
    assert strict > lax + 1
    few = points.take(np.arange(10))
    assert pooled(few).threshold < pooled(points).threshold


def test_the_pose_error_does_not_average_away() -> None:
    """However many points are pooled, the uncertainty of the camera's own motion remains."""
    step = np.diag((10 * STEP_STD) ** 2)
    spread = {}
    for count in (4, 100):
        rng = np.random.default_rng(count)
        place = board(rng, side_px=20, count=count)
        points = watched(LAB, place, np.zeros(3), rng)
        exact, unsure = pooled(points), pooled(points, step_covariance=step)
        added = unsure.covariance - exact.covariance
        at = unsure.position[0]
        G = np.concatenate([-cross_matrix(at), np.eye(3)], axis=1)
        spread[count] = np.trace(added[0])
        # At least as much as if the window consisted of independent steps.
        floor = np.trace(G @ step @ G.T) / (DT * points.sums.window_s()[0])
        assert spread[count] > 0.9 * floor
        assert np.linalg.eigvalsh(added[0]).min() > 0
    assert spread[100] == pytest.approx(spread[4], rel=0.1)


def test_more_points_do_not_turn_the_pose_error_into_motion() -> None:
    step_std = 10 * STEP_STD
    for count in (6, 60):
        worst = []
        for seed in range(25):
            rng = np.random.default_rng(seed)
            points = watched(
                LAB, board(rng, side_px=24, count=count), np.zeros(3), rng, step_std=step_std
            )
            motion = pooled(points, step_covariance=np.diag(step_std**2))
            worst.append(motion.significance.max() / motion.threshold)
            blind = pooled(points)
        assert max(worst) < 1
        if count == 60:
            assert blind.significance.max() > blind.threshold


def test_a_stretched_edge_of_the_image_is_not_motion() -> None:
    """As at the edge of KITTI's images, where hedges pass 3 % faster than they should."""
    rng, rate = np.random.default_rng(6), CameraRate(np.zeros(3), np.array([0.0, 0.0, -12.0]))
    edge = board(rng, depth=12.0, side_px=50, count=20, centre_px=(60.0, 200.0), camera=ROAD)
    passes = rate.lasting_errors(edge, np.zeros_like(edge), ROAD, 0, 1)[:, 1]
    points = watched(ROAD, edge, P.distortion_sigma * passes, rng, frames=12)
    assert not pooled(points, camera=ROAD, rate=rate).dynamic.any()
    strict = P.model_copy(update={"distortion_sigma": 0.0})
    assert pooled(points, camera=ROAD, rate=rate, parameters=strict).dynamic.any()
    # With a camera at rest, or for such speeds in the middle of the image, it is motion.
    assert pooled(points, camera=ROAD, rate=CameraRate.still()).dynamic.any()
    middle = board(rng, depth=12.0, side_px=50, count=20, centre_px=(600.0, 200.0), camera=ROAD)
    points = watched(ROAD, middle, P.distortion_sigma * passes, rng, frames=12)
    assert pooled(points, camera=ROAD, rate=rate).dynamic.mean() > 0.8


@pytest.mark.parametrize("untold", ["recurs", "cornered"])
def test_texture_that_recurs_or_is_only_an_edge_is_no_evidence_of_motion(untold: str) -> None:
    rng = np.random.default_rng(4)
    points = watched(LAB, board(rng, side_px=20, count=40), np.array([0.2, 0, 0]), rng)
    assert pooled(points).dynamic.all()
    points = points.but(**{untold: np.full(len(points), untold == "recurs")})
    assert not pooled(points).dynamic.any()
    assert not pooled(points).judged.any()


def test_shared_errors_of_neighbours_lower_the_significance() -> None:
    rng = np.random.default_rng(4)
    points = watched(LAB, board(rng, side_px=20, count=40), np.array([0.2, 0, 0]), rng)
    independent = pooled(points, parameters=P.model_copy(update={"noise_correlation": 0.0}))
    shared = pooled(points)
    assert (shared.significance < 0.7 * independent.significance).all()
