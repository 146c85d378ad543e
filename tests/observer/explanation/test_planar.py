"""Answers from residual flow, on arrays with known motion; every promised change is tried."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pytest

from observer.camera import StereoCalibration, StereoCamera
from observer.explanation import PixelAnswer, PixelVerdict, explain_pixel
from observer.geometry import Pose, map_pixels
from observer.methods.planar.clustering import detect_obstacles
from observer.methods.planar.ego_motion import PlanarEgoMotion
from observer.methods.planar.motion import measure_motion
from observer.methods.planar.results import ResidualFlow
from observer.observer import Observer
from observer.parameters import Parameters
from observer.trace import FullTrace
from observer.types import Status, StereoFrame

CAMERA = StereoCamera(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
DT = 2 / 15
# The camera's own motion shifts the image by 5 px to the right.
SHIFT = np.array([[1.0, 0.0, 5.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
MOVED = (200.0, 100.0)
STOOD = (400.0, 180.0)
BLANK = (60.0, 220.0)


@dataclass(frozen=True)
class Scene:
    """Features move around ``MOVED``, rest around ``STOOD``, and are missing at ``BLANK``.

    Attributes:
        residual: px by which the moving ones move. noise: px of the static ones.
        count: number of moving ones. depth: metres, of all; NaN = unknown.
    """

    residual: float = 6.0
    noise: float = 0.4
    count: int = 9
    depth: float = 3.0

    def trace(self, parameters: Parameters) -> FullTrace:
        """The trace that ``observe`` would record with these parameters, built from its stages."""
        grid = np.stack(np.meshgrid([-6, 0, 6], [-6, 0, 6]), axis=-1).reshape(-1, 2)
        # Nearest first, so that a smaller count keeps the inner ones.
        grid = grid[np.argsort(np.hypot(*grid.T), kind="stable")]
        start = np.concatenate([np.add(MOVED, grid[: self.count]), np.add(STOOD, grid)])
        start = (start - [5, 0]).astype(np.float32)
        by = np.where(np.arange(len(start)) < self.count, self.residual, self.noise)
        end = start + np.stack([by, np.zeros_like(by)], axis=1).astype(np.float32)
        dynamic = by > parameters.flow.residual_threshold_px
        flow = ResidualFlow(start, end, dynamic)
        # The camera translation that shifts the image of a plane at this depth by SHIFT.
        drive = Pose(np.eye(3), np.nan_to_num([5 * self.depth / CAMERA.fx, 0, 0]))
        ego = PlanarEgoMotion(
            "affine", Status.OK, (), np.ones(40, np.bool_), np.eye(6), SHIFT,
            drive, np.eye(6) * 1e-8, 0.2,
        )  # fmt: skip
        disparity = CAMERA.fx * CAMERA.baseline / self.depth
        moving = np.full(int(dynamic.sum()), disparity)
        motions = measure_motion(flow, moving, moving, DT, ego, CAMERA, parameters)
        detections = detect_obstacles(motions, DT / 2, parameters.clustering, parameters.motion)
        trace = FullTrace()
        for name, value in {
            "time": DT,
            "previous_time": 0.0,
            "left": np.zeros((256, 512), np.uint8),
            "previous_left": np.zeros((256, 512), np.uint8),
            "features_px": start,
            "ego_motion": ego,
            "disparity": np.full((256, 512), disparity, np.float32),
            "flow_px": flow.px,
            "flow_observed_px": flow.observed_px,
            "flow_residual_px": flow.residual_px,
            "dynamic": flow.dynamic,
            "motions": motions,
            "detections": detections,
        }.items():
            trace.keep(name, value)
        return trace

    def ask(self, px: tuple[float, float], **changes: Any) -> PixelAnswer:
        """The answer with parameters changed; ``flow__window_px`` stands for the dotted name."""
        dotted = {name.replace("__", "."): value for name, value in changes.items()}
        parameters = Parameters().changed(dotted)
        return explain_pixel(self.trace(parameters), CAMERA, parameters, px)


def promised(answer: PixelAnswer) -> tuple[str, float]:
    """The parameter, as a keyword of ``ask``, and the value promised to change the answer."""
    found = re.search(
        r"With (\w+)\.(\w+) at ([\d.]+)(?: \w+)? (?:or (?:below|above))", answer.would_change
    )
    assert found, answer.would_change
    value = float(found[3])
    return f"{found[1]}__{found[2]}", int(value) if value.is_integer() else value


def at_residual_end(px: tuple[float, float]) -> tuple[float, float]:
    """Where a moving feature appears in the newest image: at the residual's end."""
    return px[0] + 6, px[1]


def test_a_moving_feature_is_dynamic_with_its_figures() -> None:
    answer = Scene().ask(at_residual_end(MOVED))
    assert answer.verdict is PixelVerdict.DYNAMIC
    # 6 px at 3 m and 443 px focal length, in 2/15 s.
    assert answer.numbers["speed_mps"] == pytest.approx(6 * 3 / 443 / DT, rel=1e-3)
    assert answer.numbers["residual_px"] == pytest.approx(6.0, abs=1e-4)
    assert answer.numbers["depth_m"] == pytest.approx(3.0, abs=1e-4)
    assert answer.numbers["group_points"] == answer.numbers["features_near"] == 9
    assert answer.numbers["inliers"] == answer.numbers["matches"] == 40
    assert "0.30 m/s" in answer.sentence


@pytest.mark.parametrize("residual", [2.01, 3.0, 6.0, 29.0])
def test_a_moving_feature_is_dynamic_up_to_the_stated_value(residual: float) -> None:
    scene = Scene(residual=residual)
    at = (MOVED[0] + residual, MOVED[1])
    answer = scene.ask(at)
    if answer.verdict is PixelVerdict.DYNAMIC:
        name, value = promised(answer)
        assert scene.ask(at, **{name: value}).verdict is not PixelVerdict.DYNAMIC
        nearly = value - 0.02
        assert scene.ask(at, **{name: nearly}).verdict is PixelVerdict.DYNAMIC
    else:
        assert residual < 3


def test_a_motion_beyond_every_flow_threshold_names_another_parameter() -> None:
    answer = Scene(residual=31.0, depth=8.0).ask((MOVED[0] + 31, MOVED[1]))
    assert answer.verdict is PixelVerdict.DYNAMIC
    assert "flow.residual_threshold_px at" not in answer.would_change


@pytest.mark.parametrize("noise", [1.9, 1.3, 0.4])
def test_a_still_feature_is_static_down_to_the_stated_threshold(noise: float) -> None:
    scene = Scene(noise=noise)
    answer = scene.ask(STOOD)
    assert answer.verdict is PixelVerdict.STATIC
    # 2 px at 3 m.
    assert answer.numbers["least_speed_mps"] == pytest.approx(2 * 3 / 443 / DT, rel=1e-3)
    name, value = promised(answer)
    assert name == "flow__residual_threshold_px"
    assert value == pytest.approx(noise, abs=0.011)
    # Significance is a separate criterion, so it is switched off here.
    changed = scene.ask(STOOD, motion__min_significance=0.0, **{name: value})
    assert changed.verdict is PixelVerdict.DYNAMIC


def test_no_threshold_makes_a_residual_below_its_range_dynamic() -> None:
    answer = Scene(noise=0.05).ask(STOOD)
    assert answer.verdict is PixelVerdict.STATIC
    assert "No value of flow.residual_threshold_px" in answer.would_change


def test_insignificant_motion_is_undecided() -> None:
    scene = Scene(residual=2.5)
    at = (MOVED[0] + 2.5, MOVED[1])
    noisy = {"motion__pixel_sigma_px": 3.0, "motion__noise_correlation": 1.0}
    answer = scene.ask(at, **noisy)
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert answer.numbers["significance"] < answer.numbers["min_significance"] == 3.0
    name, value = promised(answer)
    assert name == "motion__min_significance"
    assert scene.ask(at, **noisy, **{name: value}).verdict is PixelVerdict.DYNAMIC
    assert scene.ask(at, **noisy, **{name: value + 0.02}).verdict is PixelVerdict.UNDECIDED


def test_too_small_a_group_is_undecided() -> None:
    scene = Scene(count=3)
    answer = scene.ask(at_residual_end(MOVED))
    assert answer.verdict is PixelVerdict.UNDECIDED
    assert answer.numbers["group_points"] == 3
    name, value = promised(answer)
    assert (name, value) == ("clustering__min_points", 3)
    assert scene.ask(at_residual_end(MOVED), **{name: value}).verdict is PixelVerdict.DYNAMIC


def test_beyond_the_farthest_depth_is_too_far() -> None:
    scene = Scene(depth=42.34)
    for px in (at_residual_end(MOVED), STOOD):
        answer = scene.ask(px)
        assert answer.verdict is PixelVerdict.TOO_FAR
        assert answer.numbers["depth_m"] == pytest.approx(42.34, abs=1e-3)
        name, value = promised(answer)
        assert name == "stereo__max_depth_m"
        assert scene.ask(px, **{name: value}).verdict is not PixelVerdict.TOO_FAR
    assert "No setting allows that" in Scene(depth=250.0).ask(STOOD).would_change


def test_without_depth_motion_is_undecided_but_a_still_feature_is_static() -> None:
    scene = Scene(depth=float("nan"))
    moved, stood = scene.ask(at_residual_end(MOVED)), scene.ask(STOOD)
    assert moved.verdict is PixelVerdict.UNDECIDED
    assert moved.numbers["depth_m"] is None
    assert "stereo.uniqueness_percent" in moved.would_change
    assert stood.verdict is PixelVerdict.STATIC
    assert stood.numbers["least_speed_mps"] is None


def test_nearer_than_the_nearest_depth_is_undecided() -> None:
    scene = Scene(depth=0.8)
    answer = scene.ask(at_residual_end(MOVED), stereo__min_depth_m=1.0)
    assert answer.verdict is PixelVerdict.UNDECIDED
    name, value = promised(answer)
    assert name == "stereo__min_depth_m"
    changed = scene.ask(at_residual_end(MOVED), **{name: value})
    assert changed.verdict is PixelVerdict.DYNAMIC


def test_a_blank_area_has_too_few_features() -> None:
    answer = Scene().ask(BLANK)
    assert answer.verdict is PixelVerdict.TOO_FEW_FEATURES
    assert answer.numbers["features_near"] == 0
    # The nearest moving feature ends at u = 200.
    assert answer.numbers["nearest_feature_px"] == pytest.approx(np.hypot(140, 114), abs=0.1)
    assert "only more texture or light" in answer.would_change


# --- on images, with the whole method ------------------------------------------------------

_CALIBRATION = StereoCalibration.rectified(512, 256, 443.0, 443.0, 255.5, 127.5, 0.12)
_FAINT = (120.0, 128.0)
# In the texture that surrounds it.
_NEAR_THE_EDGE = (60.0, 60.0)


def _pair(index: int) -> StereoFrame:
    """A static textured plane 4 m away; around ``_FAINT`` it is grey except for a faint spot."""
    noise = np.random.default_rng(5).integers(0, 256, (256, 560)).astype(np.float32)
    plane = cv2.GaussianBlur(noise, (0, 0), 1.5)
    plane = (plane - plane.mean()) * 4 + 128
    u, v = (round(c) for c in _FAINT)
    plane[v - 40 : v + 41, u - 40 : u + 41] = 128
    spot = cv2.getGaussianKernel(13, 1.5)
    plane[v - 6 : v + 7, u - 6 : u + 7] += 10 * (spot @ spot.T) / spot.max() ** 2
    image = np.clip(plane, 0, 255).astype(np.uint8)
    # 13 px of disparity: 4.09 m.
    return StereoFrame(index, index / 15, image[:, :512], image[:, 13:525], received=0.0)


def _traced(changes: dict[str, Any]) -> tuple[FullTrace, StereoCamera, Parameters]:
    parameters = Parameters().changed({k.replace("__", "."): v for k, v in changes.items()})
    observer = Observer(_CALIBRATION, parameters, clock=lambda: 0.0)
    trace = FullTrace()
    for index in range(2):
        trace = FullTrace()
        observer.observe(_pair(index), trace)
    return trace, observer.camera, parameters


def _observed(**changes: Any) -> PixelAnswer:
    return explain_pixel(*_traced(changes), _FAINT)


def test_the_stated_changes_give_a_feature() -> None:
    """Doing only what the answer says, a feature is first found and then tracked."""
    changes: dict[str, Any] = {"ego_motion__model": "affine", "features__detector": "fast"}
    answer = _observed(**changes)
    assert answer.verdict is PixelVerdict.TOO_FEW_FEATURES
    name, value = promised(answer)
    assert name == "features__fast_threshold"
    assert 2 < value < 12
    # The spot is fainter than the texture around it, whose corners use up the whole count.
    count = re.search(r"and features.max_count at (\d+) or above", answer.would_change)
    assert count
    changes["features__max_count"] = int(count[1])
    still = _observed(**changes, **{name: value + 1})
    assert promised(still) == (name, value)

    changes[name] = value
    found = _observed(**changes)
    assert found.verdict is PixelVerdict.TOO_FEW_FEATURES
    assert "1 feature within 10 px of here could not be tracked" in found.sentence
    name, value = promised(found)
    assert name == "flow__min_texture"
    assert _observed(**changes, **{name: value + 0.02}).verdict is found.verdict
    assert _observed(**changes, **{name: value}).verdict is PixelVerdict.STATIC


@pytest.mark.parametrize("detector", ["shi_tomasi", "harris"])
def test_the_stated_quality_gives_a_corner(detector: str) -> None:
    changes: dict[str, Any] = {"ego_motion__model": "affine", "features__detector": detector}
    # All corners are kept; only their quality decides.
    changes |= {"features__max_count": 4000, "features__quality": 0.5}
    answer = explain_pixel(*_traced(changes), _NEAR_THE_EDGE)
    assert answer.verdict is PixelVerdict.TOO_FEW_FEATURES
    name, value = promised(answer)
    assert name == "features__quality"
    assert 0.0005 <= value < 0.5
    found = explain_pixel(*_traced(changes | {name: value}), _NEAR_THE_EDGE)
    assert found.verdict is PixelVerdict.STATIC


def test_features_are_located_in_the_newest_image() -> None:
    """The camera's motion shifted the image by 5 px; a click refers to the newest image."""
    trace = Scene().trace(Parameters())
    shown = map_pixels(SHIFT, trace["flow_observed_px"])
    answer = explain_pixel(trace, CAMERA, Parameters(), tuple(shown[12]))
    assert answer.numbers["nearest_feature_px"] == pytest.approx(0.0, abs=1e-4)
