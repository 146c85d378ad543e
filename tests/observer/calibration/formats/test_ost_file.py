"""ROS ost.txt: two cameras in one file or two, and the baseline's sign."""

from __future__ import annotations

import contextlib
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.calibration.formats.recognition import named_file, read_any
from observer.calibration.formats.understanding import NamedFile
from observer.errors import CalibrationError

SIZE = (640, 480)
K = {"left": np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]),
     "right": np.array([[499.0, 0, 318], [0, 500, 241], [0, 0, 1]])}  # fmt: skip
R = cv2.Rodrigues(np.array([0.02, -0.03, 0.01]))[0]
T = np.array([-0.12, 0.003, -0.002])


def rows(matrix: npt.ArrayLike) -> str:
    return "".join(" ".join(repr(float(v)) for v in row) + "\n" for row in np.atleast_2d(matrix))


def ost(side: str, D: npt.ArrayLike = (0.1, -0.2, 0.001, 0.002, 0.05), name: str = "") -> str:
    """Return one camera's file, with OpenCV's own rectification of the pair."""
    made = cv2.stereoRectify(
        K["left"], np.zeros(5), K["right"], np.zeros(5), SIZE, R, T.reshape(3, 1)
    )
    which = 0 if side == "left" else 1
    return (
        "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n"
        f"[{name or 'narrow_stereo/' + side}]\n\ncamera matrix\n{rows(K[side])}\n"
        f"distortion\n{rows(D)}\nrectification\n{rows(made[which])}\n"
        f"projection\n{rows(made[2 + which])}\n"
    )


LEFT, RIGHT = ost("left"), ost("right")


def files(*contents: str) -> list[NamedFile]:
    return [NamedFile(f"ost{i}.txt", text.encode()) for i, text in enumerate(contents)]


@pytest.mark.parametrize(
    "contents",
    [(LEFT + RIGHT,), (RIGHT + LEFT,), (LEFT, RIGHT), (RIGHT, LEFT)],
    ids=["one file", "one file, right first", "two files", "two files, right first"],
)
def test_both_cameras_are_read_in_any_order(contents: tuple[str, ...]) -> None:
    read = read_any(files(*contents))
    made = read.calibration
    assert read.format == "ROS ost.txt of two cameras"
    assert np.allclose(made.R, R, rtol=0, atol=1e-12)
    assert np.allclose(made.T, T, rtol=0, atol=1e-12)
    assert np.array_equal(made.K1, K["left"])
    assert np.array_equal(made.K2, K["right"])
    assert made.D1.tolist() == [0.1, -0.2, 0.001, 0.002, 0.05]
    assert (made.width, made.height) == SIZE
    assert not any("swapped" in note for note in read.notes)


def test_names_contradicting_the_projection_are_reported() -> None:
    text = ost("left", name="stereo/right") + ost("right", name="stereo/left")
    read = read_any(files(text))
    assert np.allclose(read.calibration.T, T, rtol=0, atol=1e-12)
    assert (
        "ost0.txt [stereo/right] is the left camera (projection_matrix), although the file names "
        "suggest otherwise" in read.notes
    )
    assert any("the cameras are swapped: use the images of ost0.txt [stereo/right] as the "
               "left ones" in note for note in read.notes)  # fmt: skip


def test_rational_lens_is_read() -> None:
    D = np.linspace(0.01, 0.08, 8)
    made = read_any(files(ost("left", D) + ost("right", D))).calibration
    assert np.allclose(made.D1, D, rtol=0, atol=1e-15)


def test_file_written_by_camera_calibration_is_read(shared_data: Path) -> None:
    read = read_any([named_file(shared_data / "wild" / "calibrations" / "ros_ost.txt")])
    made = read.calibration
    # P[3] of "right" is positive: that camera is to the left of the other.
    assert made.baseline == pytest.approx(65.819436 / 817.488589, rel=1e-6)
    assert made.T[0] < 0
    assert made.K1[0, 0] == pytest.approx(805.838428)
    assert (made.width, made.height) == (1264, 800)
    assert any("65.819 in" in note or "is 0 in" in note for note in read.notes)
    assert any("although the file names suggest otherwise" in note for note in read.notes)


@pytest.mark.parametrize(
    ("contents", "expected"),
    [
        ((LEFT,), "ost0.txt: a ROS ost.txt of a stereo pair contains two cameras, but this"),
        ((LEFT + RIGHT, LEFT), "but this one contains 3 cameras"),
        ((LEFT + RIGHT.replace("projection", "p"),), "narrow_stereo/right]: projection is missing"),
        ((LEFT + RIGHT.split("rectification")[0],), "rectification is missing"),
        ((LEFT + ost("right", [0.1, 0, 0, 0]),), "distortion must contain 5 or 8 numbers, not 4"),
        ((LEFT + RIGHT.replace("499.0", "nan"),), "camera_matrix must contain finite numbers only"),
        ((LEFT + RIGHT.replace("499.0", "4a"),), "camera_matrix must contain numbers only, not"),
        ((LEFT + RIGHT.replace("499.0", "1 499.0"),), "camera_matrix must have shape 3 x 3"),
        ((LEFT + RIGHT.replace("640", "320"),), "image_width x image_height is 320x480"),
        ((LEFT + RIGHT.replace("640", "640 2"),), "image_width must"),
        ((LEFT + RIGHT.replace("[image]", ""),), "width appears twice for one camera"),
        ((LEFT + LEFT,), "projection_matrix has the same offset P[3]"),
    ],
)  # fmt: skip
def test_refuses(contents: tuple[str, ...], expected: str) -> None:
    with pytest.raises(CalibrationError) as caught:
        read_any(files(*contents))
    message = str(caught.value)
    assert expected in message
    assert message.startswith("ost")
    assert "truncated" not in message
    assert "\n" not in message


@given(
    part=st.floats(0, 1),
    length=st.integers(0, 200),
    put=st.text(max_size=12)
    | st.sampled_from(["1e308", "-1e200 ", "nan", "\n", "[image]\n", "camera matrix\n", "[", "0"]),
)
@settings(max_examples=300)
def test_damaged_file_is_read_or_refused(part: float, length: int, put: str) -> None:
    whole = LEFT + RIGHT
    at = int(part * len(whole))
    with contextlib.suppress(CalibrationError):
        read_any(files(whole[:at] + put + whole[at + length :]))


_LINES = st.sampled_from(
    ["[image]", "[a]", "width", "height", "640", "camera matrix", "1 0 0", "0 1 0", "0 0 1",
     "distortion", "0 0 0 0 0", "rectification", "projection", "1 0 0 -1", "0 1 0 0", "nan", "-"]
)  # fmt: skip


@given(st.lists(_LINES, max_size=60))
@settings(max_examples=200)
def test_lines_in_any_order_are_read_or_refused(lines: list[str]) -> None:
    with contextlib.suppress(CalibrationError):
        read_any(files("# oST version 5.0 parameters\n" + "\n".join(lines)))
