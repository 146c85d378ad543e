"""Pairing of images, refusals and their reasons, and the board in the remaining images."""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.calibration.boards.board import Board
from observer.calibration.boards.board_images import (
    BoardPair,
    find_boards,
    read_board_pairs,
)
from observer.calibration.fitting.fit import fit_stereo
from observer.errors import CalibrationError, InputError
from observer.types import Image

from .board_pictures import IDEAL, pictures

BOARD = Board()
DATA = Path(__file__).parents[5] / "shared" / "data" / "chessboards"


def pair_of(name: str, left: bytes | Image, right: bytes | Image) -> BoardPair:
    return BoardPair(name, f"{name} left", f"{name} right", lambda: left, lambda: right)


def touched(folder: Path, *names: str) -> None:
    folder.mkdir(exist_ok=True, parents=True)
    for name in names:
        (folder / name).write_bytes(b"x")


def names_of(pairs: tuple[BoardPair, ...]) -> list[tuple[str, str]]:
    return [(pair.left_name, pair.right_name) for pair in pairs]


def test_pairs_by_number_and_reports_unpaired_files(tmp_path: Path) -> None:
    touched(tmp_path, *(f"left{k:02d}.jpg" for k in (1, 2, 3, 10)))
    touched(tmp_path, *(f"right{k}.jpg" for k in (2, 3, 10, 11)), "right_notes.txt")
    pairs, refused = read_board_pairs(f"{tmp_path}/left*", f"{tmp_path}/right*")
    assert names_of(pairs) == [
        ("left02.jpg", "right2.jpg"), ("left03.jpg", "right3.jpg"), ("left10.jpg", "right10.jpg"),
    ]  # fmt: skip
    assert {(r.name, r.reason.split(" with ")[0]) for r in refused} == {
        ("left01.jpg", "there is no right image"),
        ("right11.jpg", "there is no left image"),
    }


def test_pairs_by_equal_names_in_two_folders(tmp_path: Path) -> None:
    for side in ("left", "right"):
        touched(tmp_path / side, "2024_01.png", "2024_02.png", "first.png")
    pairs, refused = read_board_pairs(f"{tmp_path}/left/*", f"{tmp_path}/right/*")
    assert [pair.name for pair in pairs] == ["first", "2024_01", "2024_02"]
    assert all(a == b for a, b in names_of(pairs))
    assert refused == ()


def test_pairs_in_sorted_order_when_names_do_not_match(tmp_path: Path) -> None:
    touched(tmp_path / "l", "a.png", "b.png")
    touched(tmp_path / "r", "x.png", "y.png")
    pairs, _ = read_board_pairs(f"{tmp_path}/l/*", f"{tmp_path}/r/*")
    assert names_of(pairs) == [("a.png", "x.png"), ("b.png", "y.png")]
    touched(tmp_path / "r", "z.png")
    with pytest.raises(InputError, match="2 left and 3 right images cannot be paired"):
        read_board_pairs(f"{tmp_path}/l/*", f"{tmp_path}/r/*")


def test_patterns_matching_nothing_or_the_same_files_are_refused(tmp_path: Path) -> None:
    touched(tmp_path, "left1.png", "right1.png", "right2.txt")
    with pytest.raises(InputError, match="no image matches"):
        read_board_pairs(f"{tmp_path}/left*", f"{tmp_path}/nothing*")
    with pytest.raises(InputError, match="share files such as"):
        read_board_pairs(f"{tmp_path}/*", f"{tmp_path}/right*")


def encoded(image: Image) -> bytes:
    return bytes(cv2.imencode(".png", image)[1])


def test_unusable_images_are_refused_by_name_and_the_rest_is_used() -> None:
    shares: list[float] = []
    good = [pictures(BOARD, seed) for seed in (1, 2, 3)]
    png = encoded(good[0][0])
    small = np.asarray(cv2.resize(good[1][0], (320, 240)), np.uint8)
    blank = np.full((480, 640, 3), 128, np.uint8)
    found = find_boards(
        [
            pair_of("a", *good[0]),
            pair_of("cut", png[: len(png) // 2], png),
            pair_of("b", encoded(good[1][0]), encoded(good[1][1])),
            pair_of("no image", b"hello", png),
            pair_of("uneven", small, good[1][1]),
            pair_of("small", small, small),
            pair_of("half", good[2][0], blank),
            pair_of("blank", blank, blank),
        ],
        BOARD,
        progress=lambda _, share: shares.append(share),
    )
    assert (found.width, found.height) == (640, 480)
    seen = {view.name: (view.left is not None, view.right is not None) for view in found.views}
    assert seen == {
        "a": (True, True), "b": (True, True), "half": (True, False), "blank": (False, False),
    }  # fmt: skip
    reasons = {each.name: each.reason for each in found.refused}
    assert set(reasons) == {"cut", "no image", "uneven", "small"}
    assert "cut left is truncated" in reasons["cut"]
    assert "no image left is damaged or not an image" in reasons["no image"]
    assert "320x240 pixels and the right one 640x480" in reasons["uneven"]
    assert "320x240 pixels, the others 640x480" in reasons["small"]
    assert shares == pytest.approx(np.arange(1, 9) / 8)


def test_board_size_in_images_is_named_when_it_differs() -> None:
    left, right = (
        np.asarray(cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA), np.uint8)
        for image in pictures(BOARD, 1)
    )
    pairs = [pair_of("1", left, right)]
    with pytest.raises(CalibrationError, match=r"none of 1 pairs .* shows one of 9x6: enter this"):
        find_boards(pairs, Board(columns=7, rows=4))
    with pytest.raises(CalibrationError, match="could be read: x x left is empty"):
        find_boards([pair_of("x", b"", b"")], BOARD)


def test_rendered_board_images_recover_the_camera_pair() -> None:
    """Detection and fit together, from pixels to metres, on rendered boards."""
    found = find_boards([pair_of(str(k), *pictures(BOARD, k)) for k in range(9)], BOARD)
    fit = fit_stereo(found.views, BOARD, found.width, found.height)
    assert fit.pairs == 9
    assert fit.rms_stereo < 0.15
    assert fit.calibration.K1[0, 0] == pytest.approx(IDEAL.K1[0, 0], rel=0.003)
    assert fit.calibration.baseline == pytest.approx(0.1, rel=0.005)
    assert fit.held_out is not None
    assert fit.held_out.p95_px < 0.3


@pytest.mark.skipif(not DATA.is_dir(), reason=f"needs {DATA}")
def test_published_chessboards_calibrate() -> None:
    pairs, unpaired = read_board_pairs(f"{DATA}/left[0-9]*.jpg", f"{DATA}/right[0-9]*.jpg")
    assert (len(pairs), unpaired) == (13, ())
    found = find_boards(pairs, BOARD)
    fit = fit_stereo(found.views, BOARD, found.width, found.height)
    assert fit.rms_stereo <= 0.5
    assert fit.calibration.baseline == pytest.approx(0.0836, abs=0.0005)
    assert len(fit.views) == 13
    assert all(view.used or view.reason for view in fit.views)
    assert fit.pairs >= 11
    assert fit.held_out is not None
    assert fit.held_out.p95_px < 0.5


def test_wrong_board_size_is_reported_before_all_images_are_searched(shared_data: Path) -> None:
    folder = shared_data / "chessboards"
    pairs, _ = read_board_pairs(str(folder / "left*.jpg"), str(folder / "right*.jpg"))
    # As many as one collects by holding up the board for a minute.
    many = [replace(pair, name=f"{number} {pair.name}") for number in range(4) for pair in pairs]
    started = time.process_time()
    with pytest.raises(CalibrationError, match=r"show a chessboard with 9x6 .* not 8x6"):
        find_boards(many, Board("chessboard", 8, 6, 0.025))
    spent = time.process_time() - started
    sys.stdout.write(
        f"a wrong board size in 52 pairs is reported after {spent:.1f} s of processor time\n"
    )
    assert spent < 15.0
