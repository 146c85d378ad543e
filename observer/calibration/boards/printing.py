"""Printable sheets of boards, true to scale: millimetres in SVG, exact vectors in PDF."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args
from xml.sax.saxutils import escape

import numpy as np

from observer.calibration.boards.board import MARKER_SHARE, Board
from observer.calibration.boards.detection import charuco_board
from observer.errors import CalibrationError

Paper = Literal["A4", "A3", "Letter"]
# Portrait, millimetres.
PAPERS_MM: dict[Paper, tuple[float, float]] = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "Letter": (215.9, 279.4),
}
# Length of the bar that shows whether a sheet was printed true to scale.
BAR_MM = 100.0

# White margin that detection needs around the squares, in squares.
MARGIN_SQUARES = 1
# Unprintable edge of most printers.
_EDGE_MM = 6.0
# Below the board and its margin: the bar and three lines of text.
_FOOT_MM = 15.0
_BAR_HEIGHT_MM = 2.5
_LINE_MM, _TEXT_MM = 3.8, 2.9
_POINTS_PER_MM = 72 / 25.4


@dataclass(frozen=True)
class _Rectangle:
    """Rectangle in millimetres from the sheet's upper left; painted over earlier ones."""

    x: float
    y: float
    width: float
    height: float
    black: bool = True


@dataclass(frozen=True)
class _Sheet:
    width: float
    height: float
    rectangles: tuple[_Rectangle, ...]
    # Left end of the text's baseline, and words.
    lines: tuple[tuple[float, float, str], ...]


def board_svg(board: Board, paper: Paper) -> str:
    """A sheet as SVG whose unit is the millimetre.

    Raises:
        CalibrationError: the paper is unknown, or the board does not fit on it.
    """
    sheet = _laid_out(board, paper)
    size = f"{sheet.width:g}", f"{sheet.height:g}"
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{size[0]}mm" height="{size[1]}mm" '
        f'viewBox="0 0 {size[0]} {size[1]}" shape-rendering="crispEdges">',
        f"<title>{escape(board.words)}</title>",
        f'<rect x="0" y="0" width="{size[0]}" height="{size[1]}" fill="white"/>',
    ]
    parts += [
        f'<rect x="{r.x:.6g}" y="{r.y:.6g}" width="{r.width:.6g}" height="{r.height:.6g}" '
        f'fill="{"black" if r.black else "white"}"/>'
        for r in sheet.rectangles
    ]
    parts += [
        f'<text x="{x:g}" y="{y:g}" font-family="Helvetica, Arial, sans-serif" '
        f'font-size="{_TEXT_MM:g}">{escape(words)}</text>'
        for x, y, words in sheet.lines
    ]
    return "\n".join([*parts, "</svg>", ""])


def board_pdf(board: Board, paper: Paper) -> bytes:
    """A sheet as PDF 1.4 of one page.

    Raises:
        CalibrationError: the paper is unknown, or the board does not fit on it.
    """
    sheet = _laid_out(board, paper)
    scale = _POINTS_PER_MM
    content = ["q", f"{scale:.9f} 0 0 {-scale:.9f} 0 {sheet.height * scale:.6f} cm"]
    content += [
        f"{0 if r.black else 1} g {r.x:.6f} {r.y:.6f} {r.width:.6f} {r.height:.6f} re f"
        for r in sheet.rectangles
    ]
    # Text is upright in the page's own axes, y upwards.
    content += ["Q", "BT 0 g", f"/F1 {_TEXT_MM * scale:.4f} Tf"]
    for x, y, words in sheet.lines:
        text = words.replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
        up = (sheet.height - y) * scale
        content.append(f"1 0 0 1 {x * scale:.4f} {up:.4f} Tm ({text}) Tj")
    content.append("ET")
    stream = "\n".join(content).encode("latin-1")
    box = f"[0 0 {sheet.width * scale:.6f} {sheet.height * scale:.6f}]"
    return _pdf_file(
        [
            # Readers that know this print at 100 % by themselves.
            b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
            b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
            f"<< /Type /Page /Parent 2 0 R /MediaBox {box} /Contents 4 0 R "
            "/Resources << /Font << /F1 5 0 R >> >> >>".encode(),
            f"<< /Length {len(stream)} >>\nstream\n".encode() + stream + b"\nendstream",
            b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
        ]
    )


def _pages(paper: Paper) -> list[tuple[float, float]]:
    """Width and height of a sheet in landscape and in portrait, mm."""
    if paper not in get_args(Paper):
        raise CalibrationError(
            f"a board can be printed on {', '.join(PAPERS_MM)}, not on {paper!r}"
        )
    width, height = PAPERS_MM[paper]
    return [(height, width), (width, height)]


def _largest_mm(board: Board, width: float, height: float) -> int:
    across = board.columns + 1 + 2 * MARGIN_SQUARES
    down = board.rows + 1 + 2 * MARGIN_SQUARES
    return math.floor(min(width / across, (height - _FOOT_MM - _EDGE_MM) / down) + 1e-9)


def _laid_out(board: Board, paper: Paper) -> _Sheet:
    square = 1e3 * board.square_m
    pages = _pages(paper)
    across = (board.columns + 1 + 2 * MARGIN_SQUARES) * square
    down = (board.rows + 1 + 2 * MARGIN_SQUARES) * square + _FOOT_MM + _EDGE_MM
    fitting = [page for page in pages if across <= page[0] + 1e-6 and down <= page[1] + 1e-6]
    if not fitting:
        largest = max(_largest_mm(board, *page) for page in pages)
        advice = f"squares of up to {largest} mm fit" if largest >= 2 else "use fewer squares"
        raise CalibrationError(
            f"the {board.words} does not fit on {paper} with a white margin of one square; {advice}"
        )
    width, height = fitting[0]
    left = (width - (board.columns + 1) * square) / 2
    top = (height - _FOOT_MM - _EDGE_MM - (board.rows + 1) * square) / 2
    foot = height - _EDGE_MM - _FOOT_MM
    start = max(_EDGE_MM, (width - 1.8 * BAR_MM) / 2)
    bar = _Rectangle(start, foot, BAR_MM, _BAR_HEIGHT_MM)
    words = (
        f"This bar must measure {BAR_MM:g} mm. If it does not, print at 100 % (no scaling to fit "
        "the page), or enter the length you measure.",
        f"{board.words[0].upper()}{board.words[1:]} squares ({board.columns} by {board.rows} "
        "inner corners, counted between the squares).",
        "Glue the sheet to something flat and stiff, such as glass or an aluminium plate: a board "
        "that bends spoils the calibration.",
    )
    lines = tuple(
        (start, foot + _BAR_HEIGHT_MM + (k + 1) * _LINE_MM, text) for k, text in enumerate(words)
    )
    squares = [
        _Rectangle(left + column * square, top + row * square, square, square)
        for row in range(board.rows + 1)
        for column in range(board.columns + 1)
        if (row + column) % 2 == 0
    ]
    markers = _markers(board, left, top) if board.kind == "charuco" else []
    return _Sheet(width, height, (*squares, *markers, bar), lines)


def _markers(board: Board, left: float, top: float) -> list[_Rectangle]:
    """The markers in the white squares: each a black square with white rectangles upon it."""
    square = 1e3 * board.square_m
    side = MARKER_SHARE * square
    drawn = charuco_board(board)
    dictionary = drawn.getDictionary()
    modules = dictionary.markerSize + 2
    step = side / modules
    out = []
    white_squares = [
        (row, column)
        for row in range(board.rows + 1)
        for column in range(board.columns + 1)
        if (row + column) % 2 == 1
    ]
    for marker, (row, column) in zip(np.ravel(drawn.getIds()).tolist(), white_squares, strict=True):
        x = left + column * square + (square - side) / 2
        y = top + row * square + (square - side) / 2
        out.append(_Rectangle(x, y, side, side))
        white = np.asarray(dictionary.generateImageMarker(marker, modules)) > 127
        # Runs along rows and again along columns, so that no seam between two runs shows as a line.
        for v, first, length in _runs(white):
            out.append(_Rectangle(x + first * step, y + v * step, length * step, step, False))
        for u, first, length in _runs(white.T):
            if length > 1:
                out.append(_Rectangle(x + u * step, y + first * step, step, length * step, False))
    return out


def _runs(cells: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> list[tuple[int, int, int]]:
    """Row, first column and length of each run of set cells in a row."""
    out = []
    for row, line in enumerate(np.pad(cells, ((0, 0), (1, 1))).astype(np.int8)):
        edges = np.diff(line)
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        out += [(row, int(a), int(b - a)) for a, b in zip(starts, ends, strict=True)]
    return out


def _pdf_file(objects: list[bytes]) -> bytes:
    """A PDF of these objects, numbered from 1; the first is its catalogue."""
    out = bytearray(b"%PDF-1.4\n")
    offsets = []
    for number, body in enumerate(objects, start=1):
        offsets.append(len(out))
        out += f"{number} 0 obj\n".encode() + body + b"\nendobj\n"
    table = len(out)
    out += f"xref\n0 {len(objects) + 1}\n0000000000 65535 f \n".encode()
    out += b"".join(f"{offset:010d} 00000 n \n".encode() for offset in offsets)
    out += f"trailer\n<< /Size {len(objects) + 1} /Root 1 0 R >>\n".encode()
    return bytes(out + f"startxref\n{table}\n%%EOF\n".encode())
