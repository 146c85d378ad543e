"""Every detector with motion in space: its points are tracked from frame to frame."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from observer.errors import ParameterError
from observer.observer import Observer
from observer.parameters import KltTrackingParameters, Parameters
from observer.trace import FullTrace
from observer.types import Status
from observer.vision.features import strongest_first
from observer.vision.keypoints import grid_cells, new_keypoints, strongest_corners

from ..builders import Texture, as_image
from ..conftest import OpenClip

DETECTORS = next(e["choices"] for e in Parameters.declared() if e["name"] == "features.detector")
SPEC = "simulated:lateral"
FRAMES = 28
IMAGE = as_image(Texture(3).moved(), noise=1.0)
NOWHERE = np.zeros(
    [-(-side // KltTrackingParameters().spacing_px) for side in IMAGE.shape], np.bool_
)
NONE_TAKEN = np.zeros(0, np.intp)


def using(detector: str) -> Parameters:
    return Parameters().changed({"features.detector": detector})


@pytest.mark.parametrize("detector", DETECTORS)
def test_every_detector_finds_the_crossing_robot(detector: str, clip: OpenClip) -> None:
    here = clip(SPEC, FRAMES)
    assert here.truth is not None
    observer = Observer(here.calibration, using(detector))
    for frame in here.frames:
        newest = observer.observe(frame)
    assert newest.status is Status.OK, newest.reasons
    (robot,) = newest.reported
    (true,) = [b for b in here.truth.bodies(newest.time) if b.role != "observer" and b.speed > 0.05]
    assert np.linalg.norm(robot.position - true.position) < 0.35
    assert np.linalg.norm(robot.velocity - true.velocity) < 0.12
    gap = newest.T_world_camera.inverse() @ here.truth.camera_pose(newest.time)
    assert np.linalg.norm(gap.translation) < 0.03


@pytest.mark.parametrize("detector", DETECTORS)
def test_every_empty_square_gets_one_of_the_detectors_points(detector: str) -> None:
    p = using(detector)
    px = new_keypoints(IMAGE, NONE_TAKEN, NOWHERE, p)
    square = grid_cells(px, NOWHERE, p.klt_tracking)
    assert len(px) > 20
    assert len(np.unique(square)) == len(px)
    if detector == "shi_tomasi":
        np.testing.assert_array_equal(
            px, strongest_corners(IMAGE, NONE_TAKEN, NOWHERE, p.klt_tracking)
        )
        return
    found = {tuple(each) for each in strongest_first(IMAGE, p.features, 8 * NOWHERE.size)}
    assert {tuple(each) for each in px} <= found
    some = square[::2]
    left = grid_cells(new_keypoints(IMAGE, some, NOWHERE, p), NOWHERE, p.klt_tracking)
    assert sorted(left) == sorted(set(square) - set(some))


def test_detector_change_takes_effect_at_the_next_frame_in_the_same_world(clip: OpenClip) -> None:
    frames = clip(SPEC, FRAMES).frames
    observer = Observer(clip(SPEC, 1).calibration)
    other = Observer(clip(SPEC, 1).calibration)
    for frame in frames[:8]:
        observer.observe(frame)
        other.observe(frame)
    observer.use(using("orb"), 7)
    for frame in frames[8:]:
        trace, plain = FullTrace(), FullTrace()
        now, then = observer.observe(frame, trace), other.observe(frame, plain)
        assert now.segment == then.segment == 0
        assert now.parameters_revision == 7
        assert now.status is Status.OK
        if frame is not frames[8]:  # New points are tracked from the next frame on.
            assert len(trace["features_px"])
            assert not np.array_equal(trace["features_px"], plain["features_px"])


def test_monocular_tracking_uses_the_detectors_points(clip: OpenClip) -> None:
    frames = clip("simulated:lateral", 3).frames
    seen = []
    for detector in ("shi_tomasi", "kaze"):
        p = using(detector).changed({"ego_motion.model": "monocular", "monocular.height_m": 0.3})
        observer, trace = Observer(clip(SPEC, 1).calibration, p), FullTrace()
        for frame in frames:
            observer.observe(frame, trace)
        seen.append(trace["features_px"])
    assert min(map(len, seen)) > 60
    assert not np.array_equal(*seen)


def test_surf_without_its_extra_is_refused_and_the_current_detector_stays(
    clip: OpenClip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mahotas", None)
    here = clip(SPEC, 3)
    observer = Observer(here.calibration, using("fast"))
    observer.observe(here.frames[0])
    before = observer.parameters
    with pytest.raises(ParameterError, match="pip install 'dynamic-observer"):
        observer.use(before.changed({"features.detector": "surf"}), 2)
    assert observer.parameters is before
    assert observer.observe(here.frames[1]).status is Status.OK
