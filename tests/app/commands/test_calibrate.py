"""``calibrate`` as a shell sees it: the file it writes, what it says, and how it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.calibration.formats.opencv_file import read_calibration_file

FOCAL, BASELINE = 520.0, 0.1


def calibrate(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "app.cli", "calibrate", *arguments],
        capture_output=True,
        text=True,
        timeout=100,
        stdin=subprocess.DEVNULL,
        check=False,
    )


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine pairs of a 9x6 board of 25 mm squares, by two ideal cameras 10 cm apart."""
    folder = tmp_path_factory.mktemp("pictures")
    squares = np.where(np.add.outer(np.arange(9), np.arange(12)) % 2 == 0, 20, 235)
    squares[[0, -1]] = 235
    squares[:, [0, -1]] = 235
    board = np.kron(squares.astype(np.uint8), np.ones((40, 40), np.uint8))
    step = 0.025 / 40
    middle = np.array([board.shape[1], board.shape[0]]) / 2 - 0.5
    to_board = np.array([[step, 0, -step * middle[0]], [0, step, -step * middle[1]], [0, 0, 1]])
    K = np.array([[FOCAL, 0, 319.5], [0, FOCAL, 239.5], [0, 0, 1]])
    larger = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]])
    tilts = [(0, 0), (30, 0), (-30, 0), (0, 30), (0, -30), (20, 25), (-25, 20), (25, -20), (10, 5)]
    for number, tilt in enumerate(tilts, 1):
        R = cv2.Rodrigues(np.radians([*tilt, 5.0 * number - 20]))[0]
        across = 0.06 * ((number % 3) - 1) + 0.05
        place = np.array([across, 0.04 * ((number // 3) - 1), 0.5 + 0.02 * number])
        for side, shift in (("left", 0.0), ("right", BASELINE)):
            t = place - [shift, 0, 0]
            H = larger @ K @ np.column_stack([R[:, 0], R[:, 1], t]) @ to_board
            image = cv2.warpPerspective(board, H, (2560, 1920), borderValue=128)
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


def test_json_and_file_hold_the_pair_that_took_the_pictures(
    pictures: Path, tmp_path: Path
) -> None:
    output = tmp_path / "pair.yaml"
    done = calibrate(*options(pictures, output, "--json"))
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    found = read_calibration_file(output)
    assert (found.width, found.height) == (640, 480)
    assert found.K1[0, 0] == pytest.approx(FOCAL, rel=0.005)
    assert found.baseline == pytest.approx(BASELINE, rel=0.005)
    assert report["baseline_m"] == pytest.approx(found.baseline)
    assert report["rms_stereo_px"] < 0.2
    assert report["pairs"] == 9
    assert [row["distance_m"] for row in report["verdict"]["rows"]] == [1, 3, 5]
    assert {each["name"] for each in report["refused_images"]} == {"left20.png", "left30, right30"}
    told = done.stderr.splitlines()
    assert "refused left20.png: it has no right image of the same name or number" in told
    assert any(line.startswith("refused left30, right30: left30.png is cut off") for line in told)
    assert "used 9 pairs of 9 views" in told
    assert told[-1] == f"wrote {output}"


def test_words_end_in_metres(pictures: Path, tmp_path: Path) -> None:
    done = calibrate(*options(pictures, tmp_path / "pair.yaml"))
    assert done.returncode == 0, done.stderr
    assert "baseline        100." in done.stdout or "baseline        99." in done.stdout
    assert "At 3 m depth is right to" in done.stdout
    assert "rows agree to" in done.stdout
    assert [line.split()[:2] for line in done.stdout.splitlines() if " m  " in line][-3:] == [
        ["1", "m"], ["3", "m"], ["5", "m"],
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "code", "part"),
    [
        ({"--board": "9by6"}, 2, "COLUMNSxROWS"),
        ({"--board": "7x5"}, 2, "shows one of 9x6"),
        ({"--square-mm": "0"}, 2, "2 to 500 mm"),
        ({"--output": "/no/such/folder/pair.yaml"}, 2, "/no/such/folder"),
        ({0: "/nothing/left*.png"}, 2, "no image fits"),
    ],
)
def test_wrong_input_is_one_sentence_and_nothing_is_written(
    pictures: Path, tmp_path: Path, change: dict[str | int, str], code: int, part: str
) -> None:
    arguments = options(pictures, tmp_path / "pair.yaml")
    for key, value in change.items():
        arguments[key if isinstance(key, int) else arguments.index(key) + 1] = value
    done = calibrate(*arguments)
    assert (done.returncode, done.stdout) == (code, ""), done.stderr
    sentences = [line for line in done.stderr.splitlines() if line.startswith("dynamic-observer:")]
    assert len(sentences) == 1
    assert part in sentences[0]
    assert not list(tmp_path.iterdir())
