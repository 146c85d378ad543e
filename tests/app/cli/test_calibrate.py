"""``calibrate``: the file it writes, what it says, and how it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from app.cli.command_line import build
from observer.calibration.formats.opencv_file import read_noted_calibration
from observer.errors import InputError

FOCAL, BASELINE = 520.0, 0.1


def calibrate(*arguments: str) -> None:
    """Run it as a shell would, but in this process: new processes take seconds to start."""
    build()(args=["calibrate", *arguments], standalone_mode=False)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine pairs of a 9x6 board of 25 mm squares, seen by two ideal cameras 10 cm apart."""
    folder = tmp_path_factory.mktemp("pictures")
    squares = np.where(np.add.outer(np.arange(9), np.arange(12)) % 2 == 0, 20, 235).astype(np.uint8)
    squares[[0, -1]] = 235
    squares[:, [0, -1]] = 235
    board = np.asarray(np.kron(squares, np.ones((40, 40), np.uint8)), np.uint8)
    step = 0.025 / 40
    middle = np.array([board.shape[1], board.shape[0]]) / 2 - 0.5
    to_board = np.array([[step, 0, -step * middle[0]], [0, step, -step * middle[1]], [0, 0, 1]])
    K = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
    larger = np.array([[2, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    tilts = [(0, 0), (30, 0), (-30, 0), (0, 30), (0, -30), (20, 25), (-25, 20), (25, -20), (10, 5)]
    for number, tilt in enumerate(tilts, 1):
        R = cv2.Rodrigues(np.radians([*tilt, 5.0 * number - 20]))[0]
        across = 0.06 * ((number % 3) - 1) + 0.05
        place = np.array([across, 0.04 * ((number // 3) - 1), 0.5 + 0.02 * number])
        for side, shift in (("left", 0.0), ("right", BASELINE)):
            t = place - [shift, 0, 0]
            H = larger @ K @ np.column_stack([R[:, 0], R[:, 1], t]) @ to_board
            image = cv2.warpPerspective(board, H, (1280, 960), borderValue=128)
            image = cv2.resize(image, (640, 480), interpolation=cv2.INTER_AREA)
            cv2.imwrite(str(folder / f"{side}{number}.png"), image)
    (folder / "left20.png").write_bytes((folder / "left1.png").read_bytes())
    (folder / "left30.png").write_bytes((folder / "left1.png").read_bytes()[:500])
    (folder / "right30.png").write_bytes((folder / "right1.png").read_bytes())
    return folder


def options(folder: Path, output: Path, *more: str) -> list[str]:
    return [
        f"{folder}/left*.png", f"{folder}/right*.png", "--board", "9x6", "--square-mm", "25",
        "--output", str(output), *more,
    ]  # fmt: skip


def test_json_and_file_match_the_simulated_camera_pair(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "pair.yaml"
    calibrate(*options(pictures, output, "--json"))
    done = capsys.readouterr()
    report = json.loads(done.out)
    found = read_noted_calibration(output)[0]
    assert (found.width, found.height) == (640, 480)
    assert found.K1[0, 0] == pytest.approx(FOCAL, rel=0.005)
    assert found.baseline == pytest.approx(BASELINE, rel=0.005)
    assert report["baseline_m"] == pytest.approx(found.baseline)
    assert report["rms_stereo_px"] < 0.2
    assert report["pairs"] == 9
    assert [row["distance_m"] for row in report["verdict"]["rows"]] == [1, 3, 5]
    assert {each["name"] for each in report["refused_images"]} == {"left20.png", "left30, right30"}
    told = done.err.splitlines()
    assert "rejected left20.png: there is no right image with the same name or number" in told
    assert any(
        line.startswith("rejected left30, right30: left30.png is truncated") for line in told
    )
    assert "used 9 pairs of 9 views" in told
    assert told[-1] == f"wrote {output}"


def test_text_output_ends_with_depth_accuracy_in_metres(
    pictures: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibrate(*options(pictures, tmp_path / "pair.yaml"))
    out = capsys.readouterr().out
    (baseline,) = (float(line.split()[1]) for line in out.splitlines() if "baseline" in line)
    assert baseline == pytest.approx(100, abs=0.5)
    assert "At 3 m, depth is accurate to" in out
    assert "epipolar error" in out
    assert [line.split()[:2] for line in out.splitlines() if " m  " in line][-3:] == [
        ["1", "m"], ["3", "m"], ["5", "m"],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"--board": "9by6"}, "COLUMNSxROWS"),
        ({"--square-mm": "0"}, "2 to 500 mm"),
        ({"--output": "/no/such/folder/pair.yaml"}, "/no/such/folder"),
        ({0: "/nothing/left*.png"}, "no image matches"),
    ],
)
def test_invalid_input_is_refused_immediately(
    pictures: Path, tmp_path: Path, change: dict[str | int, str], part: str
) -> None:
    arguments = options(pictures, tmp_path / "pair.yaml")
    for key, value in change.items():
        arguments[key if isinstance(key, int) else arguments.index(key) + 1] = value
    with pytest.raises(InputError) as error:
        calibrate(*arguments)
    assert part in str(error.value)
    assert not list(tmp_path.iterdir())


def test_too_few_views_give_a_one_line_error_and_exit_code_2(
    pictures: Path, tmp_path: Path
) -> None:
    arguments = options(pictures, tmp_path / "pair.yaml")
    arguments[:2] = [f"{pictures}/left[12].png", f"{pictures}/right[12].png"]
    done = subprocess.run(
        [sys.executable, "-m", "app.cli", "calibrate", *arguments],
        capture_output=True,
        text=True,
        timeout=100,
        stdin=subprocess.DEVNULL,
        check=False,
    )
    assert (done.returncode, done.stdout) == (2, "")
    (sentence,) = done.stderr.splitlines()
    assert "2 views in which the left camera sees the board; at least 5" in sentence
    assert not list(tmp_path.iterdir())
