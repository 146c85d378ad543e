"""Archives that people send: pairs by their names, and nothing harmful."""

from __future__ import annotations

import io
import random
import struct
import time
import tracemalloc
import zipfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.workers.calibration import image_archive
from app.workers.calibration.image_archive import ImageArchive, pair_names
from observer.errors import CalibrationError

PAIR = {"left/1.png": b"left", "right/1.png": b"right"}


@pytest.fixture
def zipped(tmp_path: Path) -> Any:
    """Writes an archive of these entries."""

    def write(entries: dict[str, bytes] | bytes, method: int = zipfile.ZIP_DEFLATED) -> Path:
        path = tmp_path / "images.zip"
        path.write_bytes(entries if isinstance(entries, bytes) else packed(entries, method))
        return path

    return write


def packed(entries: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as archive:
        for name, content in entries.items():
            archive.writestr(name, content)
    return file.getvalue()


# --- pairs ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "pairs"),
    [
        (["left/10.png", "left/9.png", "right/9.png", "right/10.png"], ["9", "10"]),
        (["left01.png", "right01.png"], ["01"]),
        (["a/Left_3.PNG", "a/Right_3.jpg"], ["a 3"]),
        (["cam0/7.png", "cam1/7.png"], ["7"]),
        (["12_l.png", "12_r.png", "l.png", "r.png"], ["pair", "12"]),
        (["image_00/data/0.png", "image_01/data/0.png"], ["data 0"]),
        (["links-1.png", "rechts-1.png"], ["1"]),
        # Similar words in folders further up do not count.
        (["left behind/left/1.png", "left behind/right/1.png"], ["left behind 1"]),
        # Two pairs that get the same name are both kept.
        (["left1.png", "right1.png", "left_1.png", "right_1.png"], ["1", "1 (2)"]),
        (["left/1.png", "right1.png"], []),
        (["1.png", "2.png"], []),
        (["left.png", "right.png"], ["pair"]),
    ],
)
def test_images_are_paired_by_their_names(names: list[str], pairs: list[str]) -> None:
    found, alone = pair_names(names)
    assert [pair.name for pair in found] == pairs
    assert len(alone) == len(names) - 2 * len(pairs)
    for pair in found:
        assert names.index(pair.left) != names.index(pair.right)
        assert not set(pair.name) & set("/\\")


def test_long_names_are_shortened_but_stay_distinct() -> None:
    names = [f"{side}/{'x' * 300}{end}.png" for side in ("left", "right") for end in "ab"]
    found, _ = pair_names(names)
    assert len({pair.name for pair in found}) == 2
    assert all(len(pair.name) < 120 for pair in found)


def test_an_archive_lists_pairs_and_skipped_files(zipped: Any) -> None:
    more = {
        "left/2.png": b"alone",
        "notes.txt": b"x",
        "__MACOSX/left/1.png": b"x",
        "left/.DS_Store": b"x",
    }
    with ImageArchive(zipped({**PAIR, **more})) as archive:
        (pair,) = archive.pairs
        assert (pair.name, archive.read(pair.left), archive.read(pair.right)) == (
            "1",
            b"left",
            b"right",
        )
        assert archive.refused == (
            "notes.txt is not an image (PNG, JPEG, BMP, PGM, TIFF or WebP)",
            "left/2.png has no matching image",
        )


# --- what is dangerous ----------------------------------------------------------------------


def link() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, content in PAIR.items():
            archive.writestr(name, content)
        entry = zipfile.ZipInfo("left/2.png")
        entry.create_system, entry.external_attr = 3, 0o120777 << 16
        archive.writestr(entry, "/etc/passwd")
    return file.getvalue()


def encrypted() -> bytes:
    content = bytearray(packed(PAIR))
    for mark, offset in ((b"PK\x01\x02", 8), (b"PK\x03\x04", 6)):
        at = -1
        while (at := content.find(mark, at + 1)) >= 0:
            content[at + offset] |= 1
    return bytes(content)


def listing(count: int, zip64: bool) -> bytes:
    """Return a zip directory of that many entries, none of which exists."""
    one = struct.pack("<4s4B4HL2L5H2L", b"PK\1\2", 20, 3, 20, *[0] * 15)
    one = one[:28] + struct.pack("<H", 1) + one[30:46] + b"a"
    start, size = 31, len(one) * count
    told, some = 0xFFFFFFFF if zip64 else size, min(count, 0xFFFF)
    end = struct.pack("<4s4H2LH", b"PK\5\6", 0, 0, some, some, told, start, 0)
    if zip64:
        end = (
            struct.pack("<4sQ2H2L4Q", b"PK\6\6", 44, 45, 45, 0, 0, count, count, size, start)
            + struct.pack("<4sLQL", b"PK\6\7", 0, start + size, 1)
            + end
        )
    return bytes(start) + one * count + end


DANGEROUS: dict[str, tuple[Any, str]] = {
    "up": ({**PAIR, "../left/2.png": b"x"}, "points outside it"),
    "absolute": ({**PAIR, "/etc/left2.png": b"x"}, "points outside it"),
    "backslash": ({**PAIR, "a\\..\\..\\left2.png": b"x"}, "points outside it"),
    "link": (link, "symbolic link"),
    "encrypted": (encrypted, "encrypted; upload one without a password"),
    "nested": ({**PAIR, "more.ZIP": packed(PAIR)}, "contains another archive, more.ZIP"),
    "bomb": ({**PAIR, "left/2.png": bytes(30_000_000)}, "would expand more than 100 times, which"),
    "many": ({f"left/{i}.png": b"" for i in range(1001)}, "1001 entries; at most 1000"),
    "listing": (lambda: listing(400_000, False), "far more than 1000 entries"),
    "listing of 64 bits": (lambda: listing(400_000, True), "far more than 1000 entries"),
    "none": (b"hello", "not a ZIP archive; put the images into left/ and right/"),
    "empty": (b"", "not a ZIP archive"),
    "cut": (packed(PAIR)[:-30], "not a ZIP archive"),
    "no pairs": ({"a.txt": b"x"}, "no image pairs (a.txt is not an image"),
    "nothing in it": ({}, "no image pairs"),
}


@pytest.mark.parametrize("name", DANGEROUS)
def test_dangerous_or_useless_archives_are_refused(name: str, zipped: Any) -> None:
    entries, words = DANGEROUS[name]
    path = zipped(entries() if callable(entries) else entries)
    tracemalloc.start()
    begin = time.monotonic()
    try:
        with pytest.raises(CalibrationError) as refused:
            ImageArchive(path)
        # The limit is 2 s; nothing was expanded, and no listing of millions kept.
        assert time.monotonic() - begin < 2
        assert tracemalloc.get_traced_memory()[1] < 20_000_000
    finally:
        tracemalloc.stop()
    assert words in str(refused.value)
    assert len(str(refused.value)) < 300


def test_many_moderately_compressed_entries_are_refused_by_their_sum(
    zipped: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(image_archive, "MAX_EXPANDED_BYTES", 2**20)
    # Each is below the ratio limit: only their sum gives them away.
    content = b"".join(i.to_bytes(4, "big") + bytes(200) for i in range(500))
    entries = {f"{side}/{i}.png": content for side in ("left", "right") for i in range(6)}
    with pytest.raises(CalibrationError, match="would expand to 1 MB; at most 1 MB"):
        ImageArchive(zipped(entries))


def test_reading_stops_at_an_entry_larger_than_an_image(
    zipped: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(image_archive, "MAX_IMAGE_BYTES", 2**20)
    content = b"".join(i.to_bytes(4, "big") + bytes(200) for i in range(6000))
    with ImageArchive(zipped({**PAIR, "left/1.png": content})) as archive:
        with pytest.raises(CalibrationError, match="larger than 1 MB"):
            archive.read("left/1.png")
        assert archive.read("right/1.png") == b"right"


@pytest.mark.parametrize(
    "method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA]
)
def test_damaged_entries_are_refused_one_by_one(zipped: Any, method: int) -> None:
    noise = random.Random(0).randbytes(5000)
    content = bytearray(packed({**PAIR, "left/1.png": noise}, method))
    for at in range(60, 400):
        content[at] ^= 0x5A
    with (
        ImageArchive(zipped(bytes(content))) as archive,
        pytest.raises(CalibrationError, match=r"left/1.png cannot be unpacked"),
    ):
        archive.read("left/1.png")


WHOLE = packed({"left/1.png": bytes(range(200)), "right/1.png": b"right" * 50})


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, len(WHOLE)), st.integers(0, 40), st.binary(max_size=40))
def test_damage_anywhere_is_read_or_refused(
    tmp_path: Path, at: int, length: int, put: bytes
) -> None:
    path = tmp_path / "damaged.zip"
    path.write_bytes(WHOLE[:at] + put + WHOLE[at + length :])
    try:
        with ImageArchive(path) as archive:
            for pair in archive.pairs:
                archive.read(pair.left)
                archive.read(pair.right)
    except CalibrationError:
        pass
