"""``observe --calibration``: one file or a pair, of any format."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli.observe import observe
from observer.calibration.formats.exporting import ExportKind, export_calibration
from observer.calibration.formats.opencv_file import calibration_text
from observer.camera import StereoCalibration
from observer.errors import CalibrationError, InputError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Stereo images of noise without a calibration, and calibrations of them beside it."""
    folder = tmp_path_factory.mktemp("observed")
    noise = np.random.default_rng(0).integers(0, 255, (120, 200), dtype=np.uint8)
    image = cv2.GaussianBlur(noise, (0, 0), 1.5)
    for side, shift in (("left", 10), ("right", 18)):
        (folder / "images" / side).mkdir(parents=True)
        for number in range(2):
            file = folder / "images" / side / f"{number}.png"
            cv2.imwrite(str(file), image[:, shift : shift + 160])
    (folder / "images" / "times.txt").write_text("0\n0.1\n")
    K = np.array([[150.0, 0, 80], [0, 150, 60], [0, 0, 1]])
    R = np.asarray(cv2.Rodrigues(np.array([0.0, 0.01, 0.0]))[0], np.float64)
    D = np.array([-0.1, 0.01, 0, 0])
    calibration = StereoCalibration(160, 120, K, D, K, D, R, np.array([-0.1, 0.001, 0]))
    kinds: tuple[ExportKind, ...] = ("opencv", "ros", "kalibr")
    for kind in kinds:
        for exported in export_calibration(calibration, kind, kind):
            (folder / exported.name).write_bytes(exported.content)
    (folder / "of,mine.yaml").write_bytes((folder / "opencv.yaml").read_bytes())
    (folder / "wrong.yaml").write_bytes(
        (folder / "opencv.yaml").read_bytes().replace(b"image_width: 160", b"image_width: 320")
    )
    for name, factor in (("millimetres.yaml", 1000), ("squares.yaml", 40)):
        changed = (
            (folder / "opencv.yaml")
            .read_text()
            .replace(
                "data: [ -0.1, 0.001, 0.0 ]", f"data: [ {-0.1 * factor}, {0.001 * factor}, 0.0 ]"
            )
        )
        (folder / name).write_text(changed)
    return folder


@pytest.mark.parametrize(
    ("calibration", "format"),
    [
        (["kalibr-camchain.yaml"], "Kalibr camchain"),
        (["ros-right.yaml,ros-left.yaml"], "ROS camera_info of two cameras"),
        (["ros-left.yaml", "ros-right.yaml"], "ROS camera_info of two cameras"),
        (["of,mine.yaml"], "OpenCV FileStorage"),
    ],
)
def test_any_format_is_accepted_and_named(
    folder: Path,
    calibration: list[str],
    format: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    observe("images", calibration=calibration)
    seen = capsys.readouterr()
    assert len(seen.out.splitlines()) == 2
    assert f"calibration: {format}; " in seen.err
    assert "baseline 0.1 m" in seen.err


@pytest.mark.parametrize(
    ("calibration", "expected"),
    [
        (
            ["ros-left.yaml"],
            "ros-left.yaml: a ROS camera_info contains one camera; supply both files",
        ),
        (["wrong.yaml"], "is for 320x120 images, but the camera delivers 160x120"),
        (["opencv.yaml,absent.yaml"], "absent.yaml cannot be read"),
        ([","], "no calibration file was given"),
    ],
)
def test_unusable_calibrations_are_refused(
    folder: Path, calibration: list[str], expected: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(CalibrationError, match=expected):
        observe("images", calibration=calibration)


@pytest.mark.parametrize(("name", "unit"), [("millimetres", "mm"), ("squares", "25mm")])
def test_a_missing_unit_is_requested_and_an_explicit_one_used(
    folder: Path,
    name: str,
    unit: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(CalibrationError, match=rf"{name}\.yaml: T gives .* --unit {unit}"):
        observe("images", calibration=[f"{name}.yaml"])
    observe("images", calibration=[f"{name}.yaml"], unit=unit)
    assert "baseline 0.1 m" in capsys.readouterr().err


def test_a_replaced_lens_model_in_the_sources_calibration_is_reported(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(folder / "images", tmp_path / "images")
    K = np.array([[150.0, 0, 80], [0, 150, 60], [0, 0, 1]])
    # 1 - s / 0.2495 over 1 - s / 0.25, where s = r^2 is 0.44 in the corners.
    D = np.array([-1 / 0.2495, 0, 0, 0, 0, -1 / 0.25, 0, 0])
    text = calibration_text(
        StereoCalibration(160, 120, K, D, K, np.zeros(4), np.eye(3), np.array([-0.1, 0, 0]))
    )
    (tmp_path / "images" / "calibration.yaml").write_text(text)
    observe(str(tmp_path / "images"))
    told = capsys.readouterr().err
    assert "calibration.yaml: D1 is a rational lens model that folds over" in told
    assert "D2 is" not in told
    observe(str(tmp_path / "images"), calibration=[str(folder / "opencv.yaml")])
    assert "folds over" not in capsys.readouterr().err


def test_a_unit_without_a_file_and_an_unknown_unit_are_refused(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(InputError, match="--unit applies to --calibration FILE; give the file"):
        observe("images", unit="mm")
    with pytest.raises(CalibrationError, match="the unit 'feet' is not known"):
        observe("images", calibration=["opencv.yaml"], unit="feet")
