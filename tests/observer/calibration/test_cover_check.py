"""Which lens a hand covers, tested on textured images of known brightness."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.calibration.cover_check import CoverCheck

RNG = np.random.default_rng(0)
SCENE = cv2.GaussianBlur(RNG.uniform(0, 255, (240, 320)).astype(np.float32), (0, 0), 4)
SCENE = np.clip((SCENE - SCENE.mean()) * 8 + 110, 0, 255)


def seen(gain: float = 1.0, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, 2, SCENE.shape)
    return np.clip(SCENE * gain + noise, 0, 255).astype(np.uint8)


def dark(seed: int = 0) -> np.ndarray:
    """A hand over the lens: only noise is left."""
    return np.clip(np.random.default_rng(seed).normal(6, 2, SCENE.shape), 0, 255).astype(np.uint8)


def glowing() -> np.ndarray:
    """A lit hand and automatic exposure: as bright as before, but without detail."""
    return np.full(SCENE.shape, 115, np.uint8)


def asked(looks: int = 8) -> CoverCheck:
    check = CoverCheck()
    for k in range(looks):
        check.look(seen(seed=k), seen(seed=100 + k))
    check.ask()
    return check


@pytest.mark.parametrize("cover", [dark, glowing])
@pytest.mark.parametrize("side", ["left", "right", "both"])
def test_the_covered_side_is_reported(side: str, cover: object) -> None:
    check = asked()
    for k in range(6):
        left = cover() if side != "right" else seen(seed=k)  # type: ignore[operator]
        right = cover() if side != "left" else seen(seed=k)  # type: ignore[operator]
        assert check.answer is None or k >= 3
        check.look(left, right)
    assert check.answer == side
    # The answer remains after the hand is taken away.
    for k in range(10):
        check.look(seen(seed=k), seen(seed=k))
    assert check.answer == side


def test_colour_images_are_judged_like_grey_ones() -> None:
    check = CoverCheck()
    for _ in range(3):
        check.look(np.asarray(cv2.cvtColor(seen(), cv2.COLOR_GRAY2BGR), np.uint8), seen())
    check.ask()
    for _ in range(5):
        check.look(np.zeros((240, 320, 3), np.uint8), seen())
    assert check.answer == "left"


def test_flickering_light_gives_no_answer() -> None:
    check = CoverCheck()
    # 40 % up and down twice a second at 15 frames a second, with a different phase per camera.
    phases = np.arange(120) * 2 * np.pi * 2 / 15
    pairs = [(1 + 0.4 * np.sin(a), 1 + 0.4 * np.sin(a + 1.0)) for a in phases]
    for k, (left, right) in enumerate(pairs):
        check.look(seen(left, k), seen(right, k))
        if k == 30:
            check.ask()
        assert check.answer is None, k


def test_a_passing_hand_gives_no_answer() -> None:
    check = asked()
    for k in range(30):
        passing = k % 6 < 3
        check.look(dark(k) if passing else seen(seed=k), seen(seed=k))
    assert check.answer is None


def test_dimming_light_gives_no_answer() -> None:
    check = asked()
    for k in range(10):
        check.look(seen(0.6, k), seen(0.55, k))
    assert check.answer is None


def test_nothing_is_reported_without_a_request() -> None:
    check = CoverCheck()
    for k in range(10):
        check.look(dark(k), seen(seed=k))
    assert (check.asked, check.answer) == (False, None)
    # Already covered when asked: that counts as its normal state.
    check.ask()
    for k in range(10):
        check.look(dark(k), seen(seed=k))
    assert (check.asked, check.answer) == (True, None)


def test_asking_again_or_ending_clears_the_answer() -> None:
    check = asked()
    for k in range(5):
        check.look(dark(k), seen(seed=k))
    assert check.answer == "left"
    for k in range(8):
        check.look(seen(seed=k), seen(seed=k))
    check.ask()
    assert check.answer is None
    for k in range(5):
        check.look(seen(seed=k), dark(k))
    assert check.answer == "right"
    check.end()
    assert (check.asked, check.answer) == (False, None)


def test_it_can_be_asked_before_the_first_look() -> None:
    check = CoverCheck()
    check.ask()
    assert check.asked
    check.look(seen(), seen())
    for k in range(5):
        check.look(seen(seed=k), dark(k))
    assert check.answer == "right"
