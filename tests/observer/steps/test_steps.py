"""The nine steps on pairs generated from known motion."""

from __future__ import annotations

import csv
import io
import xml.etree.ElementTree as ElementTree

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from observer.camera import StereoCalibration
from observer.errors import InputError, SourceError
from observer.opening import open_source
from observer.parameters import Parameters, preset
from observer.sources.contract import SkippedFrame, SourceInfo
from observer.steps import (
    COUNT,
    FrameReader,
    ObservedPair,
    frames_before,
    nine_steps,
    observe_pair,
    usual_frame,
)
from observer.steps.formulas import frac, gap, mathml, matrix, row, sub, text
from observer.steps.pictures import step_figure
from observer.steps.tables import step_table
from observer.types import Image, StereoFrame

from ..builders import Texture, as_image

_FX, _BASELINE_M, _DT = 300.0, 0.1, 0.1
_SIZE = (320, 240)
_PAPER = preset("paper")


class _Frames:
    """A source of ready-made frames that only plays forward."""

    def __init__(self, pairs: list[tuple[Image, Image]]) -> None:
        self.pairs = pairs
        self.reads = 0
        self._next = 0
        K = np.array([[_FX, 0, 159.5], [0, _FX, 119.5], [0, 0, 1]])
        none, T = np.zeros(4), np.array([-_BASELINE_M, 0, 0])
        self.calibration = StereoCalibration(*_SIZE, K, none, K, none, np.eye(3), T)
        self.info = SourceInfo("made", "video", *_SIZE, 1 / _DT, len(pairs))

    def read(self) -> StereoFrame | SkippedFrame | None:
        if self._next >= len(self.pairs):
            return None
        index, self._next = self._next, self._next + 1
        self.reads += 1
        return StereoFrame(index, index * _DT, *self.pairs[index], received=0.0)

    def rewind(self) -> None:
        self._next = 0

    def close(self) -> None: ...


def _grey(seed: int, size: tuple[int, int] = _SIZE) -> NDArray[np.float64]:
    return Texture(seed, (size[1], size[0])).moved()


def _pair(left: Image, disparity: float) -> tuple[Image, Image]:
    """A pair whose right image is the left one shifted to the left."""
    shift = np.array([[1, 0, -disparity], [0, 1, 0]], np.float64)
    right = cv2.warpAffine(left, shift, _SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP)
    return left, np.asarray(right, np.uint8)


_AFFINE = np.array([[1.01, -0.008, 1.5], [0.006, 1.008, -2.25]])


@pytest.fixture(scope="module")
def turned() -> ObservedPair:
    """A plane that is seen twice, the second time through a known affine transformation."""
    first = as_image(_grey(1))
    second = cv2.warpAffine(first, _AFFINE, _SIZE, flags=cv2.INTER_CUBIC)
    source = _Frames([_pair(first, 20.0), _pair(np.asarray(second, np.uint8), 20.0)])
    return observe_pair(FrameReader(source), 1, _PAPER)


_STEP_PX, _NEAR_PX, _FAR_PX = 4, 24, 8


@pytest.fixture(scope="module")
def passing() -> ObservedPair:
    """A textured square that passes in front of a wall, seen by a static camera."""
    wall, square = as_image(_grey(2)), as_image(_grey(3, (70, 70)))
    pairs = []
    for k in range(8):
        left, right = _pair(wall, _FAR_PX)
        left, right = left.copy(), right.copy()
        u = 90 + k * _STEP_PX
        left[80:150, u : u + 70] = square
        right[80:150, u - _NEAR_PX : u - _NEAR_PX + 70] = square
        pairs.append((left, right))
    return observe_pair(FrameReader(_Frames(pairs)), 7, _PAPER)


def _numbers(pair: ObservedPair, step: int) -> dict[str, float | None]:
    return {number.name: number.value for number in nine_steps(pair)[step - 1].numbers}


def test_the_matrix_of_step_4_is_the_motion_of_the_image(turned: ObservedPair) -> None:
    found = _numbers(turned, 4)
    names = [["t₁₁", "t₁₂", "t₁₃"], ["t₂₁", "t₂₂", "t₂₃"]]
    matrix_ = np.array([[found[name] for name in line] for line in names], np.float64)
    np.testing.assert_allclose(matrix_[:, :2], _AFFINE[:, :2], atol=0.002)
    np.testing.assert_allclose(matrix_[:, 2], _AFFINE[:, 2], atol=0.4)
    assert found["Rotation"] == pytest.approx(-np.rad2deg(0.006 / 1.01), abs=0.1)
    assert found["Scale along x"] == pytest.approx(1.01, abs=0.002)
    assert (found["Share of the matches"] or 0) > 80


def test_the_transformation_aligns_the_images(turned: ObservedPair) -> None:
    found = _numbers(turned, 5)
    assert (found["Mean difference after"] or 99) < (found["Mean difference before"] or 0) / 3
    assert (_numbers(turned, 6)["Median residual, static"] or 99) < 0.3


def test_the_speed_is_the_displacement_over_dt(passing: ObservedPair) -> None:
    depth = _FX * _BASELINE_M / _NEAR_PX
    speed = _STEP_PX * depth / _FX / _DT
    assert _numbers(passing, 7)["Their median depth"] == pytest.approx(depth, rel=0.03)
    assert _numbers(passing, 8)["Median speed of a point"] == pytest.approx(speed, rel=0.1)
    assert _numbers(passing, 8)["Median displacement"] == pytest.approx(1000 * speed * _DT, rel=0.1)
    found = _numbers(passing, 9)
    assert found["Obstacles reported"] == 1
    assert found["#1: speed"] == pytest.approx(speed, rel=0.1)
    assert passing.truth is None
    assert not any("true" in name for name in found)


def test_every_step_has_a_text_a_figure_and_a_table(passing: ObservedPair) -> None:
    known = set(Parameters().flat())
    for number, step in enumerate(nine_steps(passing), 1):
        assert step.number == number
        assert step.missing is None
        assert set(step.parameters) <= known
        assert step.text.endswith(".")
        assert text(step.formula)
        for part in mathml(step.formula):
            ElementTree.fromstring(part)
        assert step_figure(passing, number, labelled=True).axes
        header, *rows = csv.reader(io.StringIO(step_table(passing, number)))
        assert rows
        assert all(len(line) == len(header) for line in rows)
    assert number == COUNT
    for draw in (step_figure, step_table):
        with pytest.raises(ValueError, match="steps 1 to 9"):
            draw(passing, 10)


def test_without_ego_motion_the_steps_state_what_is_missing() -> None:
    plain = np.full((_SIZE[1], _SIZE[0]), 90, np.uint8)
    pair = observe_pair(FrameReader(_Frames([(plain, plain)] * 3)), 2, _PAPER)
    steps = nine_steps(pair)
    missing = [step.number for step in steps if step.missing]
    assert missing == [4, 5, 6, 8, 9]
    assert "only 0 matches" in (steps[3].missing or "")
    for number in range(1, COUNT + 1):
        step_figure(pair, number)
        step_table(pair, number)


def test_only_the_needed_frames_are_read() -> None:
    source = _Frames([_pair(as_image(_grey(1)), 20.0)] * 30)
    reader = FrameReader(source)
    pair = observe_pair(reader, 20, _PAPER)
    assert pair.first == 20 - frames_before(_PAPER)
    # The source only plays forward; frames already read are kept.
    assert source.reads == 21
    observe_pair(reader, 20, _PAPER.changed({"clustering.min_points": 9}))
    assert source.reads == 21
    assert usual_frame(source) == 20


def test_a_pair_that_cannot_be_observed_is_refused() -> None:
    source = _Frames([_pair(as_image(_grey(1)), 20.0)] * 3)
    reader = FrameReader(source)
    for frame, words in ((0, "no earlier one"), (3, "frames are 0 to 2"), (-1, "no frame -1")):
        with pytest.raises(SourceError, match=words):
            observe_pair(reader, frame, _PAPER)
    with pytest.raises(InputError, match="planar"):
        observe_pair(reader, 1, preset("default"))


def test_a_simulated_frame_is_the_same_however_it_is_reached() -> None:
    opened = open_source("simulated:lab")
    straight = FrameReader(opened.source).get(12)
    later = FrameReader(open_source("simulated:lab").source)
    later.get(20)
    back = later.get(12)
    assert isinstance(straight, StereoFrame)
    assert isinstance(back, StereoFrame)
    assert straight.time == back.time
    assert straight.odometry == back.odometry
    assert np.array_equal(straight.left, back.left)


def test_the_true_speed_is_given_with_the_speed() -> None:
    opened = open_source("simulated:lab")
    pair = observe_pair(FrameReader(opened.source), 40, _PAPER, truth=opened.truth)
    found = _numbers(pair, 9)
    assert found["#1: true speed"] == pytest.approx(0.4, abs=0.01)


def test_a_formula_is_rendered_as_text_and_as_mathml() -> None:
    formula = row("Z =", frac("f b", row("d −", sub("c", "x"))), matrix([["1", "x′"]]))
    assert text(formula) == "Z = f b / (d − cₓ) [1, x′]"
    (whole,) = mathml(formula)
    tags = [each.tag.partition("}")[2] for each in ElementTree.fromstring(whole).iter()]
    assert tags.count("mfrac") == tags.count("mtable") == tags.count("msub") == 1
    apart = row("r = x", gap(), "x > 1")
    assert text(apart) == "r = x      x > 1"
    assert len(mathml(apart)) == 2
