"""Middlebury's calib.txt: millimetres, and principal points that differ by doffs."""

from __future__ import annotations

import numpy as np
import pytest

from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import NamedFile, UnderstoodCalibration
from observer.errors import CalibrationError
from observer.vision.rectification import Rectification

FOCAL, DOFFS, BASELINE_MM = 3979.911, 124.343, 193.001
TEXT = (
    f"cam0=[{FOCAL} 0 1244.772; 0 {FOCAL} 1019.507; 0 0 1]\n"
    f"cam1=[{FOCAL} 0 {1244.772 + DOFFS}; 0 {FOCAL} 1019.507; 0 0 1]\n"
    f"doffs={DOFFS}\nbaseline={BASELINE_MM}\nwidth=2964\nheight=1988\nndisp=280\nisint=0\n"
    "vmin=31\nvmax=257\ndyavg=0.918\ndymax=1.516\n"
)


def read(text: str) -> UnderstoodCalibration:
    return read_any([NamedFile("calib.txt", text.encode())])


def test_depth_follows_the_documented_formula() -> None:
    understood = read(TEXT)
    made = understood.calibration
    assert (made.width, made.height) == (2964, 1988)
    assert made.T.tolist() == pytest.approx([-0.193001, 0, 0])
    # Z = B f / (d + doffs), pixel by pixel through our own rectification.
    rectification = Rectification(made)
    left, right = np.array([[1500.0, 900.0]]), np.array([[1400.0, 900.0]])
    a, b = rectification.rectify_points(left, right)
    depth = rectification.camera.triangulate(a, a[:, 0] - b[:, 0])[0, 2]
    assert depth == pytest.approx(BASELINE_MM / 1000 * FOCAL / (100 + DOFFS), rel=1e-6)
    assert a[0, 1] == pytest.approx(b[0, 1], abs=1e-6)
    assert "the principal points are 124.343 px apart (doffs), which is compensated" in (
        understood.notes
    )
    assert understood.notes[-1] == "baseline converted from millimetres: baseline 0.193 m"


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("cam1=", "cam2=", "cam1 is missing"),
        ("doffs=124.343", "doffs=12.4", "doffs is 12.4, but the principal points of cam0 and cam1"),
        ("baseline=193.001", "baseline=0", "baseline must not be zero"),
        (
            "baseline=193.001",
            "baseline=0.193",
            r"outside 0.001 to 2 m; .*in metres \(193 mm\)",
        ),
        ("baseline=193.001", "baseline=-193", "must be negative.*swap left and right"),
        ("baseline=193.001", "baseline=wide", "baseline must contain numbers only, not 'wide'"),
        ("width=2964", "width=29.5", "width must be a whole number"),
        ("width=2964", "width=3", "between 8 and 16384 pixels"),
        ("; 0 0 1]\ncam1", "]\ncam1", "cam0 must have three rows, not 2"),
        ("; 0 0 1]\ncam1", "; 0 0 1\ncam1", "cam0 must be a matrix"),
        ("; 0 0 1]\ncam1", "; 0 1]\ncam1", "cam0 must have three numbers in each row"),
        (f"cam0=[{FOCAL}", "cam0=[nan", "cam0 must contain finite numbers only"),
    ],
)
def test_refuses(old: str, new: str, expected: str) -> None:
    assert old in TEXT
    with pytest.raises(CalibrationError, match=rf"^calib\.txt: .*{expected}"):
        read(TEXT.replace(old, new, 1))
