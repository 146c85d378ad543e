"""Rational lenses with a pole: harmless outside the image, reported and replaced within it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.calibration.formats.opencv_file import calibration_text
from observer.calibration.formats.rational_lens import fold_px, without_pole
from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile, UnderstoodCalibration
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.geometry import Float64Array
from observer.vision.rectification import Rectification

SIZE = (1280, 800)
K = np.array([[800.0, 0, 640], [0, 800, 400], [0, 0, 1]])
# The corners lie at r^2 = 0.89; this lens moves them by 4 %.
SMOOTH = np.array([-0.06, 0.02, 0.0002, -0.0003, 0.0])


def with_pole(at: float, apart: float = 0.001) -> Float64Array:
    """SMOOTH times (1 - s / zero) / (1 - s / at), where s = r^2 and zero is beside ``at``."""
    zero = at * (1 - apart)
    k1, k2, p1, p2, _ = SMOOTH
    return np.array(
        [k1 - 1 / zero, k2 - k1 / zero, p1, p2, -k2 / zero, -1 / at, 0, 0]
    )  # fmt: skip


def read(D: Float64Array) -> UnderstoodCalibration:
    pair = StereoCalibration(*SIZE, K, D, K, D, np.eye(3), np.array([-0.1, 0, 0]))
    # Written with the lens unchanged; reading replaces it.
    return read_any([NamedFile("c.yaml", calibration_text(pair).encode())])


@pytest.mark.parametrize("at", [1.2, 1.6, 3.0])
def test_pole_outside_the_image_is_harmless(at: float) -> None:
    D = with_pole(at)
    assert fold_px(K, D, SIZE) is None
    assert without_pole(K, D, SIZE) is None
    understood = read(D)
    assert np.array_equal(understood.calibration.D1, D)
    assert not any("folds over" in note for note in understood.notes)
    camera = Rectification(understood.calibration).camera
    plain = StereoCalibration(*SIZE, K, SMOOTH, K, SMOOTH, np.eye(3), np.array([-0.1, 0, 0]))
    assert camera.fx == pytest.approx(Rectification(plain).camera.fx, rel=0.01)


@pytest.mark.parametrize("at", [0.55, 0.65, 0.8])
def test_cancelling_pole_within_the_image_is_replaced_and_reported(at: float) -> None:
    D = with_pole(at)
    fold = fold_px(K, D, SIZE)
    assert fold is not None
    assert 0.8 * np.sqrt(at) < fold / 800 < np.sqrt(at)
    understood = read(D)
    made = understood.calibration.D1
    assert made.size == 5
    assert made[2:4].tolist() == D[2:4].tolist()
    reported = [note for note in understood.notes if "folds over" in note]
    assert [note[:2] for note in reported] == ["D1", "D2"]
    assert f"folds over {fold:.0f} px from the centre, within the image" in reported[0]
    Rectification(understood.calibration)
    # It matches the lens without the pole, up to the radius in the note and beyond.
    s = np.linspace(0, 0.75 * at, 50)
    off = (made[[0, 1, 4]] @ [s, s**2, s**3] - SMOOTH[[0, 1, 4]] @ [s, s**2, s**3]) * np.sqrt(s)
    assert np.abs(off).max() * 800 < 4.0


def test_lens_that_really_folds_within_the_image_is_refused() -> None:
    for D in (np.array([-0.6, 0, 0, 0, 0]), np.array([-0.6, 0, 0, 0, 0, 0.1, 0, 0]),
              with_pole(0.5, apart=0.2)):  # fmt: skip
        assert fold_px(K, D, SIZE) is not None
        assert without_pole(K, D, SIZE) is None
        calibration = read(D).calibration
        assert np.array_equal(calibration.D1, D)
        with pytest.raises(CalibrationError, match="cannot be rectified"):
            Rectification(calibration)


def test_thin_prism_and_tilt_terms_are_retained() -> None:
    D = np.concatenate([with_pole(0.65), [0.001, 0, 0, 0, 0.002, 0]])
    smooth = without_pole(K, D, SIZE)
    assert smooth is not None
    assert smooth.D.size == 14
    assert smooth.D[8:].tolist() == D[8:].tolist()
    assert not smooth.D[5:8].any()


@given(st.lists(st.floats(-1e3, 1e3) | st.floats(allow_nan=False, allow_infinity=False),
                min_size=8, max_size=8))  # fmt: skip
@settings(max_examples=150)
def test_any_coefficients_give_a_one_to_one_lens_or_none(D: list[float]) -> None:
    found = without_pole(K, np.array(D), SIZE)
    assert found is None or fold_px(K, found.D, SIZE) is None
