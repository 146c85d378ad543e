"""Every parameter acts with the methods that it names, and with no others.

Each is set to a far end of its range and must change the results on a short simulated scene;
all that do not name a method are changed together and must not change that method's results.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from observer.camera import as_gray
from observer.jsonl import observation_line
from observer.observer import Observer
from observer.parameters import MODELS, Parameters, ParameterValue, StereoParameters
from observer.simulation.scenarios import scenario_from_text
from observer.simulation.source import SimulatedSource
from observer.simulation.world import World
from observer.types import StereoFrame
from observer.vision.stereo import disparity_map, point_cloud

MODEL = "ego_motion.model"
DECLARED = {entry["name"]: entry for entry in Parameters.declared() if entry["name"] != MODEL}
GROUPS = tuple(dict.fromkeys(entry["group"] for entry in DECLARED.values()))
SCENE = """
based_on: lateral
camera: {width: 320, height: 160, hfov_deg: 60}
robots:
  - x: 2.6
    y: 0.6
    heading_deg: -90
    motion: {kind: course, legs: [{kind: drive, distance_m: 2.2, speed: 0.5}]}
observer: {motion: {kind: course, legs: [{kind: drive, distance_m: 3, speed: 0.3}]}}
"""
# FROZEN frames repeat the images of two frames before, so that no obstacle is seen; in BLACK
# ones the pose is lost as well.
FRAMES, FROZEN, BLACK = 26, range(14, 16), range(19, 22)
# What a parameter needs to have an effect, apart from the scene.
SITUATIONS: Mapping[str, Mapping[str, ParameterValue]] = {
    "ego_motion.ransac_iterations": {"ego_motion.ransac_threshold_px": 0.1},
    "features.fast_threshold": {"features.detector": "fast"},
    "matching.ratio": {"matching.method": "descriptor"},
    "monocular.tilt_deg": {"monocular.height_m": 0.3},
    # Loose settings make false clusters, which tracks may be matched to.
    "tracking.gate": {"motion.min_significance": 0.0, "flow.residual_threshold_px": 0.5},
}
# Parameters that need the two exposures apart, or a camera without a known mount.
SKEWED, NO_MOUNT = {"klt_tracking.skew_sigma_s"}, {"monocular.parallax_deg"}


@pytest.mark.parametrize("group", GROUPS)
@pytest.mark.parametrize("model", MODELS)
def test_a_parameter_acts_with_the_methods_it_names(model: str, group: str) -> None:
    named = [e for e in DECLARED.values() if e["group"] == group and model in e["models"]]
    idle = [entry["name"] for entry in named if not acts(entry, model)]
    assert not idle, f"without effect with {model}"


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize(
    ("which", "detector", "kind"),
    [(0, "shi_tomasi", {}), (-1, "harris", {"skewed": True, "mounted": False})],
)
def test_parameters_do_not_affect_methods_they_do_not_name(
    model: str, which: int, detector: str, kind: dict[str, bool]
) -> None:
    base = basis(model).changed({"features.detector": detector})
    others = [entry for entry in DECLARED.values() if model not in entry["models"]]
    values = base.flat()
    changes = {e["name"]: far_values(e, values[e["name"]])[which] for e in others}
    assert changes
    assert list(lines(base.changed(changes), **kind)) == list(expected(base, **kind))


@pytest.mark.parametrize("name", [e["name"] for e in DECLARED.values() if e.get("cloud")])
def test_a_cloud_parameter_changes_the_cloud(name: str) -> None:
    entry = DECLARED[name]
    now = cloud(StereoParameters())
    for value in far_values(entry, entry["default"]):
        if not np.array_equal(cloud(Parameters().changed({name: value}).stereo), now):
            return
    pytest.fail(f"{name} does not change the cloud")


def acts(entry: Mapping[str, Any], model: str) -> bool:
    """Return whether any far value of a parameter changes the results."""
    name = entry["name"]
    base = basis(model).changed(SITUATIONS.get(name, {}))
    kind = {"skewed": name in SKEWED, "mounted": name not in NO_MOUNT}
    for value in far_values(entry, base.flat()[name]):
        changed = base.changed({name: value})
        if any(a != b for a, b in zip(lines(changed, **kind), expected(base, **kind), strict=True)):
            return True
    return False


def basis(model: str) -> Parameters:
    # Block matching is the faster matcher.
    return Parameters().changed({MODEL: model, "stereo.matcher": "bm"})


def far_values(entry: Mapping[str, Any], value: Any) -> list[ParameterValue]:
    """Return values that differ clearly from ``value``, the farthest first."""
    if entry["type"] == "boolean":
        return [not value]
    if entry["type"] == "choice":
        # SURF is an optional extra.
        return [each for each in entry["choices"] if each not in (value, "surf")]
    ends = [end for end in (entry["minimum"], entry["maximum"]) if end != value]
    return sorted(ends, key=lambda end: -abs(end - value))


def lines(parameters: Parameters, *, skewed: bool = False, mounted: bool = True) -> Iterator[str]:
    """Yield the results frame by frame, without timings."""
    source, frames = scene()
    mount = source.info.mount if mounted else None
    observer = Observer(source.calibration, parameters, mount=mount, clock=lambda: 0.0)
    for frame in frames:
        if skewed:
            frame = replace(frame, right_time=frame.time + 0.004)
        line = observation_line(observer.observe(frame), tentative=True)
        yield json.dumps(line | {"timings_ms": {}})


@cache
def expected(
    parameters: Parameters, *, skewed: bool = False, mounted: bool = True
) -> tuple[str, ...]:
    return tuple(lines(parameters, skewed=skewed, mounted=mounted))


@cache
def scene() -> tuple[SimulatedSource, tuple[StereoFrame, ...]]:
    cv2.setNumThreads(1)
    source = SimulatedSource(World(scenario_from_text(SCENE, "acts with"), 3))
    frames: list[StereoFrame] = []
    for k in range(FRAMES):
        frame = source.read()
        assert isinstance(frame, StereoFrame)
        frame = replace(frame, received=0.0)
        if k in FROZEN:
            frame = replace(frame, left=frames[k - 2].left, right=frames[k - 2].right)
        if k in BLACK:
            black = np.zeros_like(frame.left)
            frame = replace(frame, left=black, right=black)
        frames.append(frame)
    return source, tuple(frames)


def cloud(stereo: StereoParameters) -> Any:
    source, frames = scene()
    camera = Observer(source.calibration).camera
    left, right = frames[0].left, frames[0].right
    disparity = disparity_map(as_gray(left), as_gray(right), stereo)
    points, _ = point_cloud(disparity, left, camera, stereo, 100_000)
    return points
