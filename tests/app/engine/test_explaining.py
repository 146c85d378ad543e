"""The engine's answers about a pixel and the camera's motion, on rendered frames."""

from __future__ import annotations

import json

import numpy as np
import pytest

from app.contract.pixel import PixelObstacle
from app.contract.values import json_text
from app.engine.errors import NotNow
from app.engine.explaining import ego_motion_facts, explain
from app.engine.observed import Observed
from observer.errors import InputError
from observer.observer import Observer
from observer.opening import open_source
from observer.parameters import Parameters
from observer.trace import FullTrace
from observer.types import Observation, StereoFrame

FRAMES = 14


def observe(parameters: Parameters, count: int = FRAMES) -> Observed:
    """Return the last of some frames in which a robot crosses in front of a moving camera."""
    source = open_source("simulated:lateral").source
    calibration = source.calibration
    assert calibration is not None
    observer = Observer(calibration, parameters)
    observation: Observation | None = None
    trace = FullTrace()
    frame: StereoFrame | None = None
    for _ in range(count):
        item = source.read()
        assert isinstance(item, StereoFrame)
        frame, trace = item, FullTrace()
        observation = observer.observe(frame, trace)
    source.close()
    assert frame is not None
    assert observation is not None
    return Observed(frame, observation, trace, observer.camera, parameters, segment=3)


@pytest.fixture(scope="module")
def planar() -> Observed:
    return observe(Parameters().changed({"ego_motion.model": "affine"}))


def test_pixels_on_the_obstacle_are_dynamic_and_name_it(planar: Observed) -> None:
    (obstacle, *_) = planar.observation.reported
    members = planar.trace["motions"].px_current
    low, high = np.split(np.array(obstacle.box_px), 2)
    inside = ((members >= low) & (members <= high)).all(axis=1)
    answers = [explain(planar, float(u), float(v)) for u, v in members[inside]]
    dynamic = [answer for answer in answers if answer.verdict == "dynamic"]
    assert len(dynamic) >= 0.9 * len(answers) > 3
    for answer in dynamic:
        assert answer.obstacle == PixelObstacle(obstacle.id, True, obstacle.reason)
        assert (answer.frame, answer.segment) == (FRAMES - 1, 3)
        assert answer.numbers["speed_mps"] == pytest.approx(obstacle.speed, rel=0.01)


def test_every_pixel_has_a_json_serialisable_answer(planar: Observed) -> None:
    verdicts = set()
    for v in range(0, planar.camera.height, 32):
        for u in range(0, planar.camera.width, 32):
            answer = explain(planar, u, v)
            json.loads(json_text(answer))
            for sentence in (answer.sentence, answer.would_change):
                assert sentence.endswith("."), sentence
                assert "nan" not in sentence, sentence
            verdicts.add(answer.verdict)
    assert "static" in verdicts
    assert "too_few_features" in verdicts


def test_a_missing_frame_and_pixels_outside_are_refused() -> None:
    with pytest.raises(NotNow, match="no frame"):
        explain(None, 1.0, 1.0)
    first = observe(Parameters(), 1)
    assert explain(first, 1.0, 1.0).verdict == "undecided"
    with pytest.raises(InputError, match="outside the image"):
        explain(first, -1.0, 1.0)


def test_a_planar_motion_is_decomposed(planar: Observed) -> None:
    facts = ego_motion_facts(planar.trace, planar.parameters)
    assert facts is not None
    json.loads(json_text(facts))
    ego = planar.trace["ego_motion"]
    assert facts.model == "affine"
    assert facts.inliers == ego.inliers.sum() <= facts.matches == len(ego.inliers)
    assert facts.dt == pytest.approx(2 / 15, abs=1e-3)
    # Composed again by table I: rotation times scale with shear.
    parts = facts.decomposition
    c, s = np.cos(parts.rotation_rad), np.sin(parts.rotation_rad)
    (sx, sy), shear = parts.scale, parts.shear
    linear = np.array([[c, s], [-s, c]]) @ np.array([[sx, shear * sy], [0, sy]])
    np.testing.assert_allclose(linear, ego.homography[:2, :2], atol=1e-9)
    np.testing.assert_allclose(parts.translation_px, ego.homography[:2, 2], atol=1e-9)
    pose = ego.T_current_previous.inverse()
    np.testing.assert_allclose(facts.motion.translation_m, pose.translation)


def test_a_first_frame_has_no_camera_motion() -> None:
    assert ego_motion_facts({"left": np.zeros((4, 4))}, Parameters()) is None
