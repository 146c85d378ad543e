"""Pairs of images of a board: which files belong together, and where the board is in them."""

from __future__ import annotations

import glob
import re
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path

from observer.calibration.boards.board import Board, BoardSighting, BoardView
from observer.calibration.boards.detection import detect_board, same_numbering, size_shown
from observer.camera import as_gray
from observer.errors import CalibrationError, InputError
from observer.image_files.listing import natural_order
from observer.image_files.reading import IMAGE_SUFFIXES, decoded_image
from observer.types import Image

# More than any calibration needs, and a sign that the pattern is wrong.
MAX_PAIRS = 500
# Share of all pairs: a board found in fewer is another board that looks like it.
_CHANCE = 0.1
# So many pairs, spread over all, are checked for a board of another size.
_LOOKED_AT = 6
# An image as it came: the content of a file, or already decoded.
RawImage = bytes | Image


@dataclass(frozen=True)
class BoardPair:
    """Two images that were taken at the same time.

    Attributes:
        name: for display. left_name, right_name: of the two files.
        left, right: return the image; called once or twice, on any thread.
    """

    name: str
    left_name: str
    right_name: str
    left: Callable[[], RawImage]
    right: Callable[[], RawImage]


@dataclass(frozen=True)
class RefusedImage:
    """Image or pair that is not used, and why."""

    name: str
    reason: str


@dataclass(frozen=True)
class FoundBoards:
    """Boards found in a sequence of pairs.

    Attributes:
        views: of all pairs that could be read, in their order, also where no board was found.
        width, height: of the images, pixels.
        refused: those that could not be used.
    """

    views: tuple[BoardView, ...]
    width: int
    height: int
    refused: tuple[RefusedImage, ...]


def read_board_pairs(
    left_glob: str, right_glob: str
) -> tuple[tuple[BoardPair, ...], tuple[RefusedImage, ...]]:
    """Pair left and right files by equal names, else by the last number in their names.

    If the names do not match and there are as many left as right, they are paired in order.

    Returns:
        The pairs in natural order, and the files that have no partner.

    Raises:
        InputError: a pattern matches no image, or nothing can be paired.
    """
    left, right = _files(left_glob), _files(right_glob)
    if set(left) & set(right):
        raise InputError(
            f"{left_glob} and {right_glob} share files such as {min(set(left) & set(right))}; "
            f"give one pattern for the left and another for the right images"
        )
    keys = _keys(left, right)
    if keys is None:
        raise InputError(
            f"{len(left)} left and {len(right)} right images cannot be paired: give both images of "
            "a pair the same name in two folders, or the same number, as in left07.jpg and "
            "right07.jpg"
        )
    by_left, by_right = keys
    pairs = [
        _file_pair(path, by_right[key], key) for key, path in by_left.items() if key in by_right
    ]
    alone = [(path, "right") for key, path in by_left.items() if key not in by_right]
    alone += [(path, "left") for key, path in by_right.items() if key not in by_left]
    if not pairs:
        raise InputError(
            f"no left image has the number or name of a right image ({left[0].name}, "
            f"{right[0].name}); left07.jpg and right07.jpg would be a pair"
        )
    if len(pairs) > MAX_PAIRS:
        raise InputError(
            f"{len(pairs)} pairs exceed the limit of {MAX_PAIRS}; 15 to 40 different poses of the "
            "board are enough"
        )
    return tuple(pairs), tuple(
        RefusedImage(path.name, f"there is no {side} image with the same name or number")
        for path, side in alone
    )


def find_boards(
    pairs: Sequence[BoardPair],
    board: Board,
    *,
    workers: int = 2,
    progress: Callable[[str, float], None] | None = None,
) -> FoundBoards:
    """Look for the board in all pairs, on several cores.

    Images of another size than most are refused, as are those that cannot be read.

    Args:
        progress: called with words and the share done, from 0 to 1.

    Raises:
        CalibrationError: no image can be read, left and right differ in size, or no image shows
            the board; the sentence says what they show instead where that can be determined.
    """
    report = progress or (lambda _words, _share: None)
    _refuse_another_size(pairs, board)
    looked: list[tuple[BoardView, tuple[int, int]] | RefusedImage] = []
    with ThreadPoolExecutor(max(1, workers)) as pool:
        for number, each in enumerate(pool.map(lambda pair: _look(pair, board), pairs)):
            looked.append(each)
            report(f"detecting the board in {pairs[number].name}", (number + 1) / len(pairs))
    refused = [each for each in looked if isinstance(each, RefusedImage)]
    seen = [each for each in looked if not isinstance(each, RefusedImage)]
    if not seen:
        why = f": {refused[0].name} {refused[0].reason}" if refused else ""
        raise CalibrationError(f"no image pair could be read{why}")
    (width, height), _ = Counter(size for _, size in seen).most_common(1)[0]
    refused += [
        RefusedImage(
            view.name, f"its images are {own[0]}x{own[1]} pixels, the others {width}x{height}"
        )
        for view, own in seen
        if own != (width, height)
    ]
    views = tuple(view for view, own in seen if own == (width, height))
    found = sum(view.left is not None or view.right is not None for view in views)
    if found == 0 or found < _CHANCE * len(views):
        raise CalibrationError(_nothing_found(pairs, board, found, len(views)))
    return FoundBoards(views, width, height, tuple(refused))


def _look(pair: BoardPair, board: Board) -> tuple[BoardView, tuple[int, int]] | RefusedImage:
    """Return what both images show of the board, and their width and height."""
    found: list[BoardSighting | None] = []
    sizes = []
    for name, read in ((pair.left_name, pair.left), (pair.right_name, pair.right)):
        try:
            image = _gray(name, read())
        except InputError as error:
            return RefusedImage(pair.name, str(error))
        except OSError as error:
            return RefusedImage(pair.name, f"{name} cannot be read: {error.strerror}")
        sizes.append((image.shape[1], image.shape[0]))
        found.append(detect_board(image, board))
    if sizes[0] != sizes[1]:
        (a, b), (c, d) = sizes
        return RefusedImage(
            pair.name,
            f"its left image is {a}x{b} pixels and the right one {c}x{d}; set both cameras to the "
            "same size",
        )
    left, right = found
    if left is not None and right is not None:
        right = same_numbering(left, right, board)
    return BoardView(pair.name, left, right), sizes[0]


def _gray(name: str, raw: RawImage) -> Image:
    if not isinstance(raw, bytes):
        return as_gray(raw)
    return decoded_image(raw, name=name, grey=True)


def _refuse_another_size(pairs: Sequence[BoardPair], board: Board) -> None:
    """Refuse the board if images show one of another size, before all are searched in vain.

    Raises:
        CalibrationError: none of the images checked shows the board, and two show the same other.
    """
    if board.kind != "chessboard":
        return
    agreed: dict[tuple[int, int], str] = {}
    for pair in pairs[:: max(1, len(pairs) // _LOOKED_AT)][:_LOOKED_AT]:
        try:
            image = _gray(pair.left_name, pair.left())
        except (InputError, OSError):
            continue
        if detect_board(image, board, quick=True) is not None:
            return
        shown = size_shown(image)
        if shown is None or shown == (board.columns, board.rows):
            continue
        if shown in agreed:
            raise CalibrationError(
                f"{agreed[shown]} and {pair.left_name} show a chessboard with "
                f"{shown[0]}x{shown[1]} inner corners, not {board.columns}x{board.rows}: enter its "
                "actual size"
            )
        agreed[shown] = pair.left_name


def _nothing_found(pairs: Sequence[BoardPair], board: Board, found: int, count: int) -> str:
    begin = (
        f"{f'only {found}' if found else 'none'} of {count} pairs shows a {board.words} (columns "
        f"and rows of inner corners)"
    )
    if board.kind == "chessboard" and pairs:
        shown = size_shown(_gray(pairs[0].left_name, pairs[0].left()))
        if shown is not None and shown != (board.columns, board.rows):
            return (
                f"{begin}, but {pairs[0].left_name} shows one of {shown[0]}x{shown[1]}: enter this "
                "size"
            )
    return f"{begin}; it must be sharp, evenly lit and completely in the image, with a white margin"


def _files(pattern: str) -> list[Path]:
    found = [Path(name) for name in glob.glob(pattern, recursive=True)]
    images = [path for path in found if path.suffix.lower() in IMAGE_SUFFIXES and path.is_file()]
    if not images:
        raise InputError(
            f"no image matches {pattern!r}; give a quoted pattern such as 'left/*.png' (PNG, JPEG, "
            "BMP, PGM, TIFF or WebP)"
        )
    return sorted(images, key=lambda path: natural_order(path.name))


def _keys(
    left: Sequence[Path], right: Sequence[Path]
) -> tuple[dict[str, Path], dict[str, Path]] | None:
    """Both lists by the key that pairs them; None if no key does."""
    ways: tuple[Callable[[Path], str], ...] = (attrgetter("name"), attrgetter("stem"), _last_number)
    for key in ways:
        a, b = {key(path): path for path in left}, {key(path): path for path in right}
        unique = len(a) == len(left) and len(b) == len(right) and "" not in (a.keys() | b.keys())
        if unique and a.keys() & b.keys():
            return a, b
    if len(left) != len(right):
        return None
    names = [str(number) for number in range(1, len(left) + 1)]
    return dict(zip(names, left, strict=True)), dict(zip(names, right, strict=True))


def _last_number(path: Path) -> str:
    numbers = re.findall(r"\d+", path.stem, re.ASCII)
    return numbers[-1].lstrip("0") or "0" if numbers else ""


def _file_pair(left: Path, right: Path, key: str) -> BoardPair:
    name = Path(key).stem if left.name == right.name else f"{left.stem}, {right.stem}"
    return BoardPair(name, left.name, right.name, left.read_bytes, right.read_bytes)
