"""Exports survive a round trip, and other tools' own readers understand them."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.calibration.formats.exporting import ExportKind, export_calibration
from observer.calibration.formats.recognition import read_any
from observer.camera import StereoCalibration
from observer.errors import CalibrationError
from observer.vision.rectification import Rectification

KINDS: tuple[ExportKind, ...] = ("opencv", "ros", "kalibr")
NUMBERS = ("K1", "D1", "K2", "D2", "R", "T")


def rig(**changes: object) -> StereoCalibration:
    values: dict[str, object] = {
        "width": 640,
        "height": 480,
        "K1": [[500.1, 0, 320.123456789012], [0, 501, 240.2], [0, 0, 1]],
        "D1": [-0.1, 0.023, 1e-3, 1e-4],
        "K2": [[499.9, 0, 318], [0, 500, 241], [0, 0, 1]],
        "D2": [-0.2, 0.1, 0, -1e-3],
        "R": cv2.Rodrigues(np.array([0.01, 0.02, -0.03]))[0],
        "T": [-0.12, 0.001, 0.002],
    }
    return StereoCalibration(**(values | changes))  # type: ignore[arg-type]


def fisheye(**changes: object) -> StereoCalibration:
    return rig(**({"distortion_model": "equidistant"} | changes))


def assert_same(a: StereoCalibration, b: StereoCalibration) -> None:
    assert (a.width, a.height, a.distortion_model) == (b.width, b.height, b.distortion_model)
    for key in NUMBERS:
        x, y = (np.ravel(getattr(each, key)) for each in (a, b))
        # Formats with five coefficients pad four with zeros.
        size = max(len(x), len(y))
        x, y = (np.pad(each, (0, size - len(each))) for each in (x, y))
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-9, err_msg=key)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "made", [rig(), fisheye(), StereoCalibration.rectified(512, 256, 443.4, 443.4, 255, 127, 0.12)]
)
def test_round_trip(made: StereoCalibration, kind: ExportKind) -> None:
    files = export_calibration(made, kind, "my rig/1")
    assert_same(read_any(files).calibration, made)
    assert_same(read_any(files[::-1]).calibration, made)
    assert all(file.name.startswith("my_rig_1") for file in files)


# OpenCV's rectification treats rotations of up to 1e-5 rad as none.
ANGLES = st.floats(-0.1, 0.1).map(lambda angle: 0.0 if abs(angle) < 2e-5 else angle)
# Metres, rounded: by an arc cosine near 1, OpenCV cannot resolve angles of 1.5e-8 rad.
OFFSETS = st.floats(-0.01, 0.01).map(lambda metres: round(metres, 6))


@pytest.mark.parametrize("kind", KINDS)
@given(
    rotvec=st.tuples(*[ANGLES] * 3),
    t=st.tuples(st.floats(-1.5, -0.1), OFFSETS, OFFSETS),
    focal=st.floats(300, 900),
    model=st.sampled_from(["radtan", "equidistant"]),
)
@settings(max_examples=15)
def test_round_trip_of_any_rig(
    kind: ExportKind,
    rotvec: tuple[float, ...],
    t: tuple[float, ...],
    focal: float,
    model: str,
) -> None:
    made = rig(
        R=cv2.Rodrigues(np.array(rotvec))[0],
        T=t,
        K1=[[focal, 0, 320.5], [0, focal, 240], [0, 0, 1]],
        D1=[-0.02, 0.01, 0, 0],
        D2=[-0.01, 0.02, 0, 0],
        distortion_model=model,
    )
    assert_same(read_any(export_calibration(made, kind, "a")).calibration, made)


def test_opencv_reads_the_opencv_export() -> None:
    (file,) = export_calibration(fisheye(), "opencv", "a")
    storage = cv2.FileStorage(
        file.content.decode(), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
    )
    assert storage.getNode("image_width").real() == 640
    assert storage.getNode("distortion_model").string() == "equidistant"
    for key in NUMBERS:
        assert np.array_equal(np.ravel(storage.getNode(key).mat()), np.ravel(getattr(rig(), key)))


def parsed(text: str) -> dict[str, Any]:
    import yaml

    return dict(yaml.safe_load(text))


def test_ros_export_contains_our_rectification() -> None:
    left, right = export_calibration(rig(D1=[0.1] * 5, D2=[0.1] * 5), "ros", "a")
    assert (left.name, right.name) == ("a-left.yaml", "a-right.yaml")
    a, b = parsed(left.content.decode()), parsed(right.content.decode())
    rectification = Rectification(rig(D1=[0.1] * 5, D2=[0.1] * 5))
    assert a["camera_name"] == "left"
    assert a["distortion_model"] == "plumb_bob"
    assert np.ravel(rectification.R_rectified_left).tolist() == a["rectification_matrix"]["data"]
    P = np.reshape(b["projection_matrix"]["data"], (3, 4))
    assert np.array_equal(P[:, :3], rectification.camera.K)
    assert -P[0, 3] / P[0, 0] == pytest.approx(rectification.camera.baseline)
    eight = rig(D1=[0.01] * 8, D2=[0.02] * 8)
    assert parsed(export_calibration(eight, "ros", "a")[0].content.decode())[
        "distortion_model"
    ] == "rational_polynomial"  # fmt: skip


def test_kalibr_export_has_all_required_keys() -> None:
    (file,) = export_calibration(fisheye(), "kalibr", "a")
    chain = parsed(file.content.decode())
    assert set(chain) == {"cam0", "cam1"}
    for camera in chain.values():
        assert camera["camera_model"] == "pinhole"
        assert camera["distortion_model"] == "equidistant"
        assert camera["resolution"] == [640, 480]
        assert len(camera["distortion_coeffs"]) == len(camera["intrinsics"]) == 4
        assert "rostopic" in camera
    assert np.array(chain["cam1"]["T_cn_cnm1"]).shape == (4, 4)
    assert "T_cn_cnm1" not in chain["cam0"]


@pytest.mark.parametrize(
    ("made", "kind", "expected"),
    [
        (
            rig(D2=[0.1, 0, 0, 0, 0.3]),
            "kalibr",
            "D2 has k3 = 0.3 .*supports only k1, k2, p1 and p2",
        ),
        (rig(D1=[0.01] * 12), "ros", "D1 holds 12 distortion coefficients, but ROS supports only"),
        (rig(T=[0.12, 0, 0]), "ros", "swap left and right"),
    ],
)
def test_refuses_what_the_format_cannot_represent(
    made: StereoCalibration, kind: ExportKind, expected: str
) -> None:
    with pytest.raises(CalibrationError, match=expected):
        export_calibration(made, kind, "a")
