"""ZED's factory files: directions, sections, older spellings."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from observer.calibration.formats.recognition import read_any
from observer.calibration.formats.understanding import Choice, NamedFile, UnderstoodCalibration
from observer.errors import CalibrationError

ROTVEC = np.array([-0.0042, 0.0085, -0.0015])
R = cv2.Rodrigues(ROTVEC)[0]


def camera(side: str, resolution: str, scale: float, lens: str = "") -> str:
    lens = lens or "k1=-0.175286\nk2=0.0283094\np1=6.7e-05\np2=-0.00015\nk3=4.1e-11\n"
    return (
        f"[{side}_CAM_{resolution}]\nfx={700 * scale}\nfy={701 * scale}\ncx={640 * scale}\n"
        f"cy={360 * scale}\n{lens}\n"
    )


def conf(resolutions: dict[str, float], ty_tz: str | None = None) -> str:
    text = "".join(
        camera(side, each, scale)
        for each, scale in resolutions.items()
        for side in ("LEFT", "RIGHT")
    )
    text += "[STEREO]\nBaseline=119.978\n"
    for each in resolutions:
        text += f"CV_{each}={ROTVEC[1]}\nRX_{each}={ROTVEC[0]}\nRZ_{each}={ROTVEC[2]}\n"
        if ty_tz is None:
            text += f"TY_{each}=0.35\nTZ_{each}=-0.21\n"
    return text + (ty_tz or "") + "[MISC]\nSensor_ID=0\n"


ALL = conf({"2K": 2.0, "FHD": 2.0, "HD": 1.0, "VGA": 0.5})


def read(text: str, **choices: object) -> UnderstoodCalibration:
    return read_any([NamedFile("SN1.conf", text.encode())], **choices)  # type: ignore[arg-type]


def test_directions_and_units_follow_opencv() -> None:
    understood = read(conf({"HD": 1.0}))
    made = understood.calibration
    # ZED's Baseline is positive and in millimetres; OpenCV's T[0] is negative.
    assert np.allclose(made.T, [-0.119978, 0.00035, -0.00021], rtol=0, atol=1e-12)
    assert np.allclose(made.R, R, rtol=0, atol=1e-12)
    assert np.array_equal(made.K1, [[700, 0, 640], [0, 701, 360], [0, 0, 1]])
    assert made.D1.tolist() == [-0.175286, 0.0283094, 6.7e-05, -0.00015, 4.1e-11]
    assert (made.width, made.height) == (1280, 720)
    assert understood.choices == ()
    assert understood.notes == (
        "using section HD: 1280x720 images",
        "rotation given as rotation vector RX, CV, RZ",
        "[STEREO] Baseline converted from millimetres: baseline 0.11998 m",
    )


@pytest.mark.parametrize(
    ("size", "focal"), [((2208, 1242), 1400), ((1920, 1080), 1400), ((672, 376), 350)]
)
def test_size_selects_the_section(size: tuple[int, int], focal: float) -> None:
    made = read(ALL, size=size).calibration
    assert (made.width, made.height) == size
    assert made.K1[0, 0] == focal
    assert read(ALL, expected_size=size).calibration.K1[0, 0] == focal


def test_size_choices_are_listed_when_none_is_given() -> None:
    understood = read(ALL)
    assert understood.choices == (
        Choice("size", ("1280x720", "1920x1080", "2208x1242", "672x376"), "1280x720"),
    )


def test_letter_case_blanks_and_older_keys_are_accepted() -> None:
    older = conf({"HD": 1.0}, ty_tz="TY=0.35\nTZ=-0.21\n")
    assert np.allclose(
        read(older).calibration.T, [-0.119978, 0.00035, -0.00021], rtol=0, atol=1e-12
    )
    spaced = ALL.lower().replace("=", " = ").replace("[", "[ ").replace("\n", "\r\n")
    assert np.allclose(read(spaced).calibration.R, R, rtol=0, atol=1e-12)
    without_tangential = older.replace("p1=6.7e-05\np2=-0.00015\nk3=4.1e-11\n", "")
    assert read(without_tangential).calibration.D1.tolist() == [-0.175286, 0.0283094, 0, 0, 0]


def test_coefficients_in_a_separate_section_are_read() -> None:
    bare = conf({"FHD1200": 1.0}).replace(
        "k1=-0.175286\nk2=0.0283094\np1=6.7e-05\np2=-0.00015\nk3=4.1e-11\n", ""
    )
    rational = "".join(
        f"{key} = {value}\n"
        for key, value in zip(("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), range(8),
                              strict=True)
    )  # fmt: skip
    both = "".join(f"[{side}_DISTO]\n{rational}" for side in ("LEFT", "RIGHT"))
    made = read(bare + both).calibration
    assert made.D1.tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    fisheye = "".join(
        f"[{side}_DISTO]\nk1=.01\nk2=.02\nk3=.03\nk4=.04\n" for side in ("LEFT", "RIGHT")
    )
    understood = read(bare + fisheye)
    assert understood.calibration.distortion_model == "equidistant"
    assert understood.calibration.D2.tolist() == [0.01, 0.02, 0.03, 0.04]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[RIGHT_CAM_HD]", "[RIGHT_CAM_XX]", r"the section \[RIGHT_CAM_HD\] is missing"),
        ("[STEREO]", "[S]", r"the section \[STEREO\] is missing"),
        ("Baseline=", "Bs=", r"\[STEREO\] baseline is missing"),
        ("Baseline=119.978", "Baseline=-119.978", "Baseline is -119.978, but it must be positive"),
        ("Baseline=119.978", "Baseline=0\nTY_HD=0\nTZ_HD=0", r"\[STEREO\] Baseline must not be ze"),
        ("Baseline=119.978", "Baseline=0.119978", r"outside 0.001 to 2 m; .*in metres \(120 mm\)"),
        ("Baseline=119.978", "Baseline=119978", "119.978 m when read in millimetres, which is ou"),
        ("RX_HD=", "RY_HD=", r"\[STEREO\] rx_hd is missing"),
        ("RX_HD=-0.0042", "RX_HD=nan", r"\[STEREO\] rx_hd must contain finite numbers only"),
        ("fx=700.0", "fx=", r"\[LEFT_CAM_HD\] fx must contain 1 numbers, not 0"),
        ("fx=700.0", "fx=-700.0", r"\[LEFT_CAM_HD\] must be a camera matrix with positive"),
        ("k1=-0.175286", "", r"\[LEFT_CAM_HD\] k1 is missing"),
        ("[STEREO]", "[LEFT_CAM_HD]\nfx=1\n[STEREO]", r"the section \[LEFT_CAM_HD\] appears twice"),
    ],
)
def test_refuses(old: str, new: str, expected: str) -> None:
    text = conf({"HD": 1.0}, ty_tz="")
    assert old in text
    with pytest.raises(CalibrationError, match=rf"^SN1\.conf: .*{expected}"):
        read(text.replace(old, new, 1))


def test_refuses_a_size_without_a_section() -> None:
    with pytest.raises(CalibrationError, match=r"no section is for 640x480 images; the "
                                               r"file has 1280x720 \(HD\), 1920x1080"):  # fmt: skip
        read(ALL, size=(640, 480))
    with pytest.raises(CalibrationError, match="none of its sections has a known resolution"):
        read(camera("LEFT", "8K", 4.0))
