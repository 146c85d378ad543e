import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from observer.calibration.boards.board import Board
from observer.calibration.boards.detection import detect_board
from observer.calibration.boards.printing import (
    PAPERS_MM,
    Paper,
    board_pdf,
    board_svg,
)
from observer.errors import CalibrationError

PX_PER_MM = 6
BOARDS: list[tuple[Board, Paper]] = [
    (Board(square_m=0.021), "A4"),
    (Board(), "A3"),
    (Board("charuco", 9, 6, 0.02), "Letter"),
    (Board("charuco", 5, 8, 0.02), "A4"),
]


@dataclass
class Printed:
    """Content of a printed sheet: rectangles in millimetres from the upper left, and words."""

    size: tuple[float, float]
    rectangles: list[tuple[float, float, float, float, bool]]
    words: str

    @property
    def image(self) -> np.ndarray:
        image = np.full([round(side * PX_PER_MM) for side in self.size[::-1]], 255, np.uint8)
        for x, y, width, height, black in self.rectangles:
            ends = np.rint(np.array([x, x + width, y, y + height]) * PX_PER_MM).astype(int)
            image[ends[2] : ends[3], ends[0] : ends[1]] = 0 if black else 255
        return image


def read_svg(board: Board, paper: Paper) -> Printed:
    root = ElementTree.fromstring(board_svg(board, paper))
    size = tuple(float(root.attrib[side].removesuffix("mm")) for side in ("width", "height"))
    assert root.attrib["viewBox"] == f"0 0 {size[0]:g} {size[1]:g}", "its unit is not mm"
    rectangles, words = [], []
    for element in root:
        if element.tag.endswith("rect"):
            x, y, width, height = (float(element.attrib[k]) for k in ("x", "y", "width", "height"))
            rectangles.append((x, y, width, height, element.attrib["fill"] == "black"))
        elif element.tag.endswith("text"):
            words.append(element.text or "")
    return Printed((size[0], size[1]), rectangles, " ".join(words))


def read_pdf(board: Board, paper: Paper) -> Printed:
    data = board_pdf(board, paper).decode("latin-1")
    number = r"(-?[\d.]+)"
    box = re.search(rf"/MediaBox \[0 0 {number} {number}\]", data)
    matrix = re.search(rf"{number} 0 0 {number} 0 {number} cm", data)
    assert box
    assert matrix
    points = 25.4 / 72
    assert float(matrix[1]) * points == pytest.approx(1, abs=1e-8)
    assert float(matrix[2]) * points == pytest.approx(-1, abs=1e-8)
    assert float(matrix[3]) == pytest.approx(float(box[2]))
    rectangles = []
    for grey, *sides in re.findall(rf"([01]) g {number} {number} {number} {number} re f", data):
        x, y, width, height = map(float, sides)
        rectangles.append((x, y, width, height, grey == "0"))
    words = [text.replace("\\", "") for text in re.findall(r"\((.*)\) Tj", data)]
    return Printed((float(box[1]) * points, float(box[2]) * points), rectangles, " ".join(words))


@pytest.mark.parametrize("read", [read_svg, read_pdf])
@pytest.mark.parametrize(
    ("board", "paper"), BOARDS, ids=lambda value: getattr(value, "words", value)
)
def test_printed_board_is_detected_at_true_scale(
    read: Callable[[Board, Paper], Printed], board: Board, paper: Paper
) -> None:
    sheet = read(board, paper)
    assert sorted(sheet.size) == pytest.approx(PAPERS_MM[paper])
    found = detect_board(sheet.image, board)
    assert found is not None
    assert len(found) == board.corner_count
    expected = 1e3 * board.object_points[:, :2]
    corners = (found.px + 0.5) / PX_PER_MM
    # Not only the spacing matters: corner 0 is at the upper left of the printed sheet.
    assert corners - corners[0] == pytest.approx(expected, abs=0.2)


@pytest.mark.parametrize("read", [read_svg, read_pdf])
@pytest.mark.parametrize(
    ("board", "paper"), BOARDS, ids=lambda value: getattr(value, "words", value)
)
def test_squares_are_exact_and_surrounded_by_white(
    read: Callable[[Board, Paper], Printed], board: Board, paper: Paper
) -> None:
    sheet = read(board, paper)
    side = 1e3 * board.square_m
    squares = [
        r for r in sheet.rectangles if r[4] and r[2:4] == pytest.approx((side, side), abs=1e-3)
    ]
    assert len(squares) == ((board.columns + 1) * (board.rows + 1) + 1) // 2
    left, top = min(r[0] for r in squares), min(r[1] for r in squares)
    for x, y, *_ in squares:
        for place, start in ((x, left), (y, top)):
            assert (place - start) / side == pytest.approx(round((place - start) / side), abs=1e-3)
    right, bottom = left + 1e3 * board.size_m[0], top + 1e3 * board.size_m[1]
    assert min(left, top, sheet.size[0] - right, sheet.size[1] - bottom) >= side - 1e-6
    (bar,) = [r for r in sheet.rectangles if r[4] and r[2] == pytest.approx(100, abs=1e-6)]
    assert bar[1] >= bottom + side - 1e-6, "the bar is in the board's margin"
    assert 5 <= bar[0] <= sheet.size[0] - 105


@pytest.mark.parametrize("read", [read_svg, read_pdf])
def test_sheet_states_what_to_measure_and_which_board_it_is(
    read: Callable[[Board, Paper], Printed],
) -> None:
    words = read(Board("charuco", 9, 6, 0.02), "A4").words
    assert (
        "This bar must measure 100 mm. If it does not, print at 100 % (no scaling to fit the "
        "page), or enter the length you measure."
    ) in words
    assert "ChArUco board 9x6, 20 mm" in words
    assert "flat" in words


def test_pdf_xref_table_points_at_its_objects() -> None:
    data = board_pdf(Board(square_m=0.02), "A4")
    start = int(data.split(b"startxref\n")[1].split(b"\n")[0])
    assert data[start : start + 4] == b"xref"
    offsets = [int(line[:10]) for line in data[start:].split(b"\n")[3:8]]
    for number, offset in enumerate(offsets, start=1):
        assert data[offset:].startswith(f"{number} 0 obj".encode())
    stream = re.search(rb"/Length (\d+) >>\nstream\n(.*?)\nendstream", data, re.DOTALL)
    assert stream is not None
    assert int(stream[1]) == len(stream[2])


def test_oversized_board_is_refused_naming_the_largest_that_fits() -> None:
    with pytest.raises(CalibrationError, match=r"does not fit on A4.* up to 21 mm fit"):
        board_svg(Board(), "A4")
    assert board_pdf(Board(square_m=0.021), "A4")
    with pytest.raises(CalibrationError, match="does not fit"):
        board_pdf(Board(square_m=0.022), "A4")


def test_unknown_paper_size_is_refused_by_name() -> None:
    with pytest.raises(CalibrationError, match="A4, A3, Letter, not on 'A5'"):
        board_svg(Board(square_m=0.01), "A5")  # type: ignore[arg-type]
