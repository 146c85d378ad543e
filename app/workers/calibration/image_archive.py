"""Image pairs from an uploaded ZIP archive: nothing is written to disk, nothing is trusted."""

from __future__ import annotations

import lzma
import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from observer.errors import CalibrationError
from observer.image_files.listing import natural_order
from observer.image_files.reading import IMAGE_SUFFIXES

MAX_ENTRIES = 1000
MAX_IMAGE_BYTES = 40 * 1024 * 1024
# Images are compressed already, so a legitimate archive hardly grows.
MAX_EXPANDED_BYTES = 1024 * 1024 * 1024
_MAX_RATIO = 100
# All other exceptions that Python's decompressors raise on damaged archives.
_DAMAGES = (OSError, ValueError, RuntimeError, EOFError, struct.error, zlib.error, lzma.LZMAError)
# The archive's end record, and the 64 bit one with its locator before it (APPNOTE.TXT 4.3.14-16).
_RECORD, _RECORD_64, _LOCATOR = b"PK\x05\x06", b"PK\x06\x06", b"PK\x06\x07"
_RECORD_BYTES, _LOCATOR_BYTES, _RECORD_64_BYTES = 22, 20, 56
_LONGEST_COMMENT = 65535
# Size of one entry in the directory: its name, and what the packing program adds.
_ENTRY_BYTES = 1024
_LONGEST_NAME = 100
# Names of the two cameras in folders and file names; the rest of the path is the pair's name.
_SIDES = (
    (r"left", r"right"),
    (r"links", r"rechts"),
    (r"cam_?0?0(?!\d)", r"cam_?0?1(?!\d)"),
    (r"camera_?0?0(?!\d)", r"camera_?0?1(?!\d)"),
    (r"image_?0?0(?!\d)", r"image_?0?1(?!\d)"),
    (r"l", r"r"),
)
# A short name counts only if it stands alone, as in 12_l.png.
_EDGE = r"(?:^|(?<=[^a-z]))"
_END = r"(?:$|(?=[^a-z]))"


@dataclass(frozen=True)
class ArchivedPair:
    """Two entries that belong together.

    Attributes:
        name: common part of both names.
        left, right: names within the archive.
    """

    name: str
    left: str
    right: str


class ImageArchive:
    """Opened archive, for use in a ``with`` block.

    Attributes:
        pairs: image pairs in the order of their names.
        refused: one sentence for each entry that could not be used.

    Raises:
        CalibrationError: the file is not a ZIP archive, is dangerous, or holds no image pairs.
    """

    def __init__(self, path: Path) -> None:
        try:
            _refuse_long_directory(path)
            self._zip = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, *_DAMAGES):
            raise CalibrationError(
                "the file is not a ZIP archive; put the images into left/ and right/ and zip both "
                "folders"
            ) from None
        try:
            self.pairs, self.refused = self._understand()
        except BaseException:
            self._zip.close()
            raise

    def __enter__(self) -> ImageArchive:
        return self

    def __exit__(self, *_: object) -> None:
        self._zip.close()

    def read(self, name: str) -> bytes:
        """Return the bytes of one entry.

        Raises:
            CalibrationError: the entry is damaged, encrypted or too large.
        """
        try:
            with self._zip.open(name) as file:
                content = file.read(MAX_IMAGE_BYTES + 1)
        except (zipfile.BadZipFile, *_DAMAGES) as error:
            raise CalibrationError(f"{name} cannot be unpacked: {error}") from None
        if len(content) > MAX_IMAGE_BYTES:
            raise CalibrationError(f"{name} is larger than {MAX_IMAGE_BYTES // 2**20} MB")
        return content

    def _understand(self) -> tuple[tuple[ArchivedPair, ...], tuple[str, ...]]:
        entries = self._zip.infolist()
        _refuse_dangerous(entries)
        refused: list[str] = []
        names: list[str] = []
        for entry in entries:
            path = PurePosixPath(entry.filename)
            # Files that macOS adds to archives look like images but are not.
            if entry.is_dir() or path.name.startswith(".") or "__MACOSX" in path.parts:
                continue
            if path.suffix.lower() in IMAGE_SUFFIXES:
                names.append(entry.filename)
            elif path.suffix.lower() == ".zip":
                raise CalibrationError(
                    f"the archive contains another archive, {path.name}; put all images into one"
                )
            else:
                refused.append(f"{path.name} is not an image (PNG, JPEG, BMP, PGM, TIFF or WebP)")
        pairs, alone = pair_names(names)
        refused.extend(alone)
        if not pairs:
            why = f" ({refused[0]})" if refused else ""
            raise CalibrationError(
                f"the archive contains no image pairs{why}; put them into left/ and right/ with "
                "the same names, or name them left01.png and right01.png"
            )
        return pairs, tuple(refused)


def check_archive(path: Path) -> None:
    """Refuse an archive by its directory, before a worker is started for it.

    Raises:
        CalibrationError: as ``ImageArchive``.
    """
    with ImageArchive(path):
        pass


def _refuse_long_directory(path: Path) -> None:
    """Refuse millions of entries before they are listed, which takes gigabytes and minutes."""
    with path.open("rb") as file:
        length = file.seek(0, 2)
        file.seek(max(0, length - _RECORD_BYTES - _LONGEST_COMMENT - _LOCATOR_BYTES))
        tail = file.read()
        sizes = []
        # Whichever record a reader takes for the end record, its directory must be short.
        for found in re.finditer(re.escape(_RECORD), tail):
            end = tail[found.start() : found.start() + _RECORD_BYTES]
            if len(end) == _RECORD_BYTES:
                sizes.append(int.from_bytes(end[12:16], "little"))
        for found in re.finditer(re.escape(_LOCATOR), tail):
            at = int.from_bytes(tail[found.start() + 8 : found.start() + 16], "little")
            for place in (at, length - len(tail) + found.start() - _RECORD_64_BYTES):
                if 0 <= place < length:
                    file.seek(place)
                    end = file.read(_RECORD_64_BYTES)
                    if end.startswith(_RECORD_64):
                        sizes.append(int.from_bytes(end[40:48], "little"))
    # A size of all ones means that the 64 bit record holds it.
    if any(MAX_ENTRIES * _ENTRY_BYTES < size != 0xFFFFFFFF for size in sizes):
        raise CalibrationError(
            f"the archive has far more than {MAX_ENTRIES} entries; twenty pairs are enough"
        )


def pair_names(names: list[str]) -> tuple[tuple[ArchivedPair, ...], tuple[str, ...]]:
    """Return the names that belong together, and one sentence for each that has no partner."""
    for left, right in _SIDES:
        sides = dict(_sorted_by_side(names, left, right))
        keys = sorted({key for key, _ in sides}, key=natural_order)
        both = [key for key in keys if (key, 0) in sides and (key, 1) in sides]
        pairs = tuple(
            ArchivedPair(name, sides[key, 0], sides[key, 1])
            for key, name in zip(both, _view_names(both), strict=True)
        )
        if pairs:
            paired = {name for pair in pairs for name in (pair.left, pair.right)}
            alone = tuple(f"{name} has no matching image" for name in names if name not in paired)
            return pairs, alone
    return (), tuple(f"{name} has no matching image" for name in names)


def _view_names(keys: list[str]) -> list[str]:
    """Return a name for each key that people recognise and that is valid in a URL."""
    names: list[str] = []
    for key in keys:
        plain = re.sub(r"[\\/\s_.-]+", _plain_separator, key).strip("_-. ")
        plain = plain[:_LONGEST_NAME] or "pair"
        name, number = plain, 1
        # "1" and "_1" are two pairs.
        while name in names:
            number += 1
            name = f"{plain} ({number})"
        names.append(name)
    return names


def _plain_separator(found: re.Match[str]) -> str:
    # A slash would end the name in a URL.
    return " " if re.search(r"[\\/\s]", found[0]) else found[0]


def _sorted_by_side(
    names: list[str], left: str, right: str
) -> Iterator[tuple[tuple[str, int], str]]:
    for name in names:
        stem = str(PurePosixPath(name).with_suffix("")).lower()
        # Take the last match: a folder further up may have such a name by chance.
        last: tuple[int, int, int] | None = None
        for side, word in enumerate((left, right)):
            short = f"{_EDGE}{word}{_END}" if len(word) == 1 else word
            for found in re.finditer(short, stem):
                last = max(last or (-1, 0, 0), (found.start(), found.end(), side))
        if last is not None:
            start, end, side = last
            yield (f"{stem[:start]}{stem[end:]}", side), name


def _refuse_dangerous(entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MAX_ENTRIES:
        raise CalibrationError(
            f"the archive has {len(entries)} entries; at most {MAX_ENTRIES} are allowed, and "
            "twenty pairs are enough"
        )
    for entry in entries:
        path = PurePosixPath(entry.filename.replace("\\", "/"))
        if path.is_absolute() or ".." in path.parts or "\x00" in entry.filename:
            raise CalibrationError("the archive has an entry that points outside it")
        # The upper half holds the Unix mode; 0xA000 is a symbolic link.
        if (entry.external_attr >> 16) & 0xF000 == 0xA000:
            raise CalibrationError("the archive contains a symbolic link; include only image files")
        if entry.flag_bits & 0x1:
            raise CalibrationError("the archive is encrypted; upload one without a password")
        if entry.file_size > _MAX_RATIO * max(entry.compress_size, 1024):
            raise CalibrationError(
                f"{path.name} would expand more than {_MAX_RATIO} times, which no image does"
            )
    total = sum(entry.file_size for entry in entries)
    if total > MAX_EXPANDED_BYTES:
        raise CalibrationError(
            f"the archive would expand to {total // 2**20} MB; at most "
            f"{MAX_EXPANDED_BYTES // 2**20} MB are allowed"
        )
