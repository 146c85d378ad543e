from pathlib import Path

import cv2
import numpy as np
import pytest

from observer.calibration.boards.board import Board, BoardSighting
from observer.calibration.boards.detection import (
    detect_board,
    same_numbering,
    size_shown,
    turns_alike,
)
from observer.types import Image

from .drawn_boards import SIZE, board_to_image, draw

CHESSBOARD = Board()
CHARUCO = Board("charuco")
# None is aligned with the pixels: there all samples of a drawn edge would miss it equally.
TILTS = [(0.1, -0.1, 0.12), (0.5, -0.3, 0.2), (-0.4, 0.5, -0.25)]
RECORDED = Path(__file__).parents[5] / "shared/data/chessboards"


def rms(sighting: BoardSighting, truth: np.ndarray) -> float:
    return float(np.sqrt(((sighting.px - truth[sighting.ids]) ** 2).sum(axis=1).mean()))


def clutter(seed: int) -> np.ndarray:
    """Edges and boxes of all sizes, no board among them."""
    rng = np.random.default_rng(seed)
    image = np.full(SIZE[::-1], 128, np.uint8)
    for _ in range(300):
        corner = rng.integers(0, SIZE)
        box = (*corner.tolist(), *rng.integers(8, 120, 2).tolist())
        cv2.rectangle(image, box, int(rng.integers(0, 255)), -1 if rng.random() < 0.5 else 2)
    return image


@pytest.mark.parametrize("quick", [False, True])
@pytest.mark.parametrize(
    ("board", "width", "most"),
    [
        (CHESSBOARD, 80, 0.15),
        (CHESSBOARD, 150, 0.12),
        (CHESSBOARD, 400, 0.07),
        (CHARUCO, 220, 0.20),
        (CHARUCO, 400, 0.15),
    ],
    ids=lambda value: value.kind if isinstance(value, Board) else str(value),
)
def test_corners_are_detected_where_they_were_drawn(
    board: Board, width: float, most: float, quick: bool
) -> None:
    for seed, tilt in enumerate(TILTS):
        image, truth = draw(board, board_to_image(board, width, tilt), seed=seed)
        found = detect_board(image, board, quick=quick)
        assert found is not None
        assert len(found) >= (54 if board.kind == "chessboard" else 30)
        assert rms(found, truth) < most


def test_origin_is_the_centre_of_the_upper_left_pixel() -> None:
    # A convention that differs by half a pixel would show in the mean over all corners.
    offsets = []
    for seed, centre in enumerate([(319.5, 239.5), (300.2, 200.8), (340.7, 260.1)]):
        image, truth = draw(
            CHESSBOARD, board_to_image(CHESSBOARD, 300, (0.2, 0.1, 0.05), centre), seed=seed
        )
        found = detect_board(image, CHESSBOARD, quick=True)
        assert found is not None
        offsets.append((found.px - truth).mean(axis=0))
    assert np.abs(np.mean(offsets, axis=0)).max() < 0.02


def test_color_and_grey_images_give_the_same_corners() -> None:
    image, _ = draw(CHESSBOARD, board_to_image(CHESSBOARD, 250))
    grey = detect_board(image, CHESSBOARD)
    colored = np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), np.uint8)
    color = detect_board(colored, CHESSBOARD)
    assert grey is not None
    assert color is not None
    np.testing.assert_allclose(color.px, grey.px, atol=0.02)


@pytest.mark.parametrize("turn", [0.0, 90.0, 180.0, -90.0])
@pytest.mark.parametrize("board", [CHESSBOARD, CHARUCO], ids=["chessboard", "charuco"])
def test_corner_numbering_follows_the_board_in_any_orientation(board: Board, turn: float) -> None:
    pose = board_to_image(board, 240, (0.2, -0.2, np.deg2rad(turn)))
    image, truth = draw(board, pose)
    found = detect_board(image, board)
    assert found is not None
    assert rms(found, truth) < 0.2


@pytest.mark.parametrize(
    ("columns", "rows", "alike"), [(9, 6, False), (9, 7, True), (8, 6, True), (7, 7, True)]
)
def test_boards_with_half_turn_symmetry_are_recognised(
    columns: int, rows: int, alike: bool
) -> None:
    assert turns_alike(Board("chessboard", columns, rows)) is alike
    assert not turns_alike(Board("charuco", columns, rows))


@pytest.mark.parametrize(("columns", "rows"), [(8, 6), (7, 7), (6, 6)])
def test_right_camera_uses_the_left_cameras_numbering(columns: int, rows: int) -> None:
    board = Board("chessboard", columns, rows)
    # Turned so far that each image by itself could be numbered either way.
    sightings = []
    for turn in (85.0, 95.0):
        image, _ = draw(board, board_to_image(board, 200, (0.1, 0.2, np.deg2rad(turn))))
        found = detect_board(image, board)
        assert found is not None
        sightings.append(found)
    left, right = sightings
    turned = BoardSighting(right.ids, np.ascontiguousarray(right.px[::-1]))
    for other in (right, turned):
        agreed = same_numbering(left, other, board)
        assert np.linalg.norm(agreed.px - left.px, axis=1).max() < 60


def test_numbering_fixed_by_colours_is_unchanged() -> None:
    # The right camera is upside down: its image is rotated, the numbering is correct.
    image, _ = draw(CHESSBOARD, board_to_image(CHESSBOARD, 240))
    left = detect_board(image, CHESSBOARD)
    right = detect_board(np.ascontiguousarray(image[::-1, ::-1]), CHESSBOARD)
    assert left is not None
    assert right is not None
    np.testing.assert_allclose(np.subtract(SIZE, 1) - right.px, left.px, atol=0.1)
    assert same_numbering(left, right, CHESSBOARD) is right


def test_partial_charuco_board_is_detected_but_not_a_partial_chessboard() -> None:
    for board in (CHARUCO, CHESSBOARD):
        image, truth = draw(board, board_to_image(board, 400, (0.2, 0.3, 0.1), (610.0, 240.0)))
        found = detect_board(image, board, quick=True)
        if board is CHESSBOARD:
            assert found is None
        else:
            assert found is not None
            assert 8 <= len(found) < 40
            assert rms(found, truth) < 0.2


def test_too_small_part_of_a_charuco_board_is_not_detected() -> None:
    image, _ = draw(CHARUCO, board_to_image(CHARUCO, 400, centre=(800.0, 240.0)))
    assert detect_board(image, CHARUCO) is None


@pytest.mark.parametrize("quick", [False, True])
def test_nothing_is_detected_without_a_board(quick: bool) -> None:
    for board in (CHESSBOARD, CHARUCO):
        assert detect_board(clutter(1), board, quick=quick) is None
        assert detect_board(np.zeros(SIZE[::-1], np.uint8), board, quick=quick) is None


def test_part_of_a_larger_board_is_not_mistaken_for_the_board() -> None:
    image, _ = draw(CHESSBOARD, board_to_image(CHESSBOARD, 300, (0.3, 0.2, 0.1)))
    for quick in (False, True):
        assert detect_board(image, Board("chessboard", 8, 6), quick=quick) is None
    assert size_shown(image) == (9, 6)


def test_highlight_over_a_corner_misplaces_no_corner() -> None:
    image, truth = draw(CHESSBOARD, board_to_image(CHESSBOARD, 300, (0.3, 0.2, 0.1)))
    # OpenCV places it 5 pixels off; only the other corners reveal that.
    hidden = truth[22]
    v, u = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    glare = 220 * np.exp(-((u - hidden[0]) ** 2 + (v - hidden[1]) ** 2) / (2 * 9.0**2))
    found = detect_board(np.clip(image + glare, 0, 255).astype(np.uint8), CHESSBOARD)
    if found is not None:
        assert np.linalg.norm(found.px - truth, axis=1).max() < 2


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> Image:
    image = cv2.imread(str(path), flags)
    assert image is not None
    return np.asarray(image, np.uint8)


@pytest.mark.skipif(not RECORDED.is_dir(), reason=f"needs {RECORDED}")
@pytest.mark.parametrize("quick", [False, True])
def test_all_recorded_chessboards_are_detected(quick: bool) -> None:
    missed = [
        path.name
        for path in sorted(RECORDED.glob("*.jpg"))
        if detect_board(read_image(path), CHESSBOARD, quick=quick) is None
    ]
    assert not missed


@pytest.mark.skipif(not RECORDED.is_dir(), reason=f"needs {RECORDED}")
def test_part_of_a_recorded_board_is_not_mistaken_for_the_board() -> None:
    image = read_image(RECORDED / "left02.jpg", cv2.IMREAD_GRAYSCALE)
    assert cv2.findChessboardCorners(image, (8, 6))[0], "OpenCV no longer finds a part of it"
    for quick in (False, True):
        assert detect_board(image, Board("chessboard", 8, 6), quick=quick) is None
