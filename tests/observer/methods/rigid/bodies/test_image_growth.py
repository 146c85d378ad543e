"""Growth of images, for points whose true motion is known."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.camera import StereoCamera
from observer.geometry import Float64Array, Pose
from observer.methods.rigid.bodies.image_growth import Growth
from observer.methods.rigid.camera_step import CameraStep
from observer.vision.camera_rate import CameraRate

CAMERA = StereoCamera(640, 400, 400.0, 400.0, 319.5, 199.5, 0.06)
DT = 1 / 30
STILL = CameraRate.still()
quick = settings(max_examples=60)


def seen(
    seconds: float,
    *,
    approach: float = 0.0,
    z: float = 4.0,
    x: float = 0.0,
    rate: CameraRate = STILL,
    doubt: float = 1.0,
    noise: float = 0.0,
    limbs: float = 0.0,
    points: int = 20,
) -> Growth:
    """The growth of points on a flat body as high as a person, after some seconds.

    Args:
        approach: m/s. x, z: metres, camera frame, where it begins. doubt: ratio of its measured to
            its true disparity. noise: px/s, of the flow. limbs: share of the points that swing.
    """
    rng = np.random.default_rng(7)
    offset = np.column_stack(
        [rng.uniform(-0.25, 0.25, points), rng.uniform(-0.8, 0.8, points), np.zeros(points)]
    )
    swings = np.arange(points) < limbs * points
    growth = Growth()
    place = offset + np.array([x, 0.0, z])
    for k in range(round(seconds / DT)):
        now = CameraStep(CAMERA, Pose.identity(), np.eye(6) * 1e-12, rate, DT)
        swing = np.where(swings, 1.5 * np.sin(6 * k * DT), 0.0)
        velocity = np.column_stack([swing, np.zeros(points), np.full(points, -approach)])
        velocity = velocity + np.cross(rate.turn, place) + rate.shift
        px, disparity = CAMERA.project(place)
        flow = flow_of(place, velocity) + rng.normal(0.0, noise, (points, 2))
        growth = growth.seen(px, flow, float(np.median(disparity)) * doubt, now)
        place = place + DT * (velocity - np.column_stack([swing, np.zeros((points, 2))]))
    return growth


def flow_of(place: Float64Array, velocity: Float64Array) -> Float64Array:
    """(N, 2) px/s of places (N, 3) m that move at (N, 3) m/s, by differences."""
    step = 1e-5
    before, after = (CAMERA.project(place + s * velocity)[0] for s in (-step, step))
    return np.asarray((after - before) / (2 * step))


@quick
@given(
    turn=st.tuples(*[st.floats(-0.4, 0.4)] * 3),
    shift=st.tuples(st.floats(-0.3, 0.3), st.floats(-0.1, 0.1), st.floats(-0.8, 0.8)),
    x=st.floats(-1.5, 1.5),
)
def test_a_static_body_does_not_grow_beyond_what_the_cameras_motion_explains(
    turn: tuple[float, float, float], shift: tuple[float, float, float], x: float
) -> None:
    growth = seen(0.5, x=x, rate=CameraRate(np.array(turn), np.array(shift)))
    assert growth.beyond == pytest.approx(0.0, abs=0.01)
    assert not growth.shows(1.0)
    assert not growth.shows(-1.0)


@quick
@given(doubt=st.floats(0.5, 2.0), drive=st.floats(-0.8, 0.8))
def test_a_static_body_of_doubtful_distance_does_not_seem_to_move(
    doubt: float, drive: float
) -> None:
    rate = CameraRate(np.zeros(3), np.array([0.0, 0.0, -drive]))
    growth = seen(2.0, z=5.0, rate=rate, doubt=doubt)
    assert not growth.shows(1.0)
    assert not growth.shows(-1.0)


@pytest.mark.parametrize("doubt", [0.8, 1.0, 1.25])
@pytest.mark.parametrize("drive", [0.0, 0.3])
@pytest.mark.parametrize("approach", [1.1, -1.1])
def test_a_body_that_walks_along_the_line_of_sight_is_shown_within_a_second(
    approach: float, drive: float, doubt: float
) -> None:
    rate = CameraRate(np.zeros(3), np.array([0.0, 0.0, -drive]))
    growth = seen(1.0, approach=approach, rate=rate, doubt=doubt, noise=4.0, limbs=0.3)
    assert growth.shows(approach)
    assert not growth.shows(-approach)


def test_the_growth_is_the_logarithm_of_the_ratio_of_the_distances() -> None:
    assert seen(1.0, approach=1.0).beyond == pytest.approx(np.log(4.0 / 3.0), abs=0.01)


@pytest.mark.parametrize("limbs", [0.0, 0.3])
def test_neither_noise_nor_limbs_make_a_body_grow(limbs: float) -> None:
    growth = seen(5.0, noise=8.0, limbs=limbs)
    assert not growth.shows(1.0)
    assert not growth.shows(-1.0)


def test_a_few_points_show_nothing() -> None:
    assert seen(1.0, approach=1.0, points=5) == Growth()
