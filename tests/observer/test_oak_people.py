"""Recorded frames of two people who walk below a camera above a yard, in low, hard light."""

from __future__ import annotations

from pathlib import Path

import pytest

from observer.calibration.formats.opencv_file import read_noted_calibration
from observer.observer import Observer
from observer.parameters import Parameters
from observer.types import Obstacle, TrackState

from .conftest import OpenClip

FRAMES = 262
# Frames in which each of them is fully in view, judged by eye.
WALKS = ((58, 82), (232, 262))
# Frames in which no one is in view, except for feet at the border.
EMPTY = ((0, 42), (112, 205))

pytestmark = pytest.mark.slow

Reported = list[tuple[Obstacle, ...]]


@pytest.fixture(scope="module")
def reported(shared_data: Path, clip: OpenClip, rigid: Parameters) -> Reported:
    """The obstacles reported in each frame."""
    folder = shared_data / "oak_people"
    if not folder.is_dir():
        pytest.skip(f"recorded data is not here: {folder} is not a folder")
    here = clip(f"video:{folder / 'left.mp4'},{folder / 'right.mp4'}", FRAMES)
    observer = Observer(read_noted_calibration(folder / "calibration.yaml")[0], rigid)
    observed = (observer.observe(frame).obstacles for frame in here.frames)
    return [tuple(o for o in each if o.state is TrackState.CONFIRMED) for each in observed]


@pytest.mark.parametrize(("begin", "end"), WALKS)
def test_each_walker_is_one_box_covering_head_and_trunk(
    reported: Reported, begin: int, end: int
) -> None:
    walk = reported[begin:end]
    alone = [obstacles[0] for obstacles in walk if len(obstacles) == 1]
    assert len(alone) > 0.8 * len(walk)
    sizes = [(o.box_px[2] - o.box_px[0], o.box_px[3] - o.box_px[1]) for o in alone]
    assert all(180 < width < 460 and 180 < height < 460 for width, height in sizes)
    speeds = sorted(o.speed for o in alone)
    assert 0.9 < speeds[len(speeds) // 2] < 1.6


@pytest.mark.parametrize(("begin", "end"), EMPTY)
def test_hardly_anything_else_is_reported(reported: Reported, begin: int, end: int) -> None:
    """The exposure settles, and shadows of leaves move over floor and furniture."""
    wrong = sum(len(obstacles) for obstacles in reported[begin:end])
    assert wrong <= 0.05 * (end - begin)
