"""Damaged image archives: pairs and images, or one sentence."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from hypothesis import example, given

from app.workers.calibration.image_archive import ImageArchive
from observer.errors import CalibrationError

from ....damage import assert_one_sentence, damaged, examples, hostile_bytes, read_or_refused
from .test_image_archive import PAIR, packed

WHOLE = (packed(PAIR), packed(PAIR, zipfile.ZIP_STORED), packed(PAIR, zipfile.ZIP_LZMA),
         packed({"a\nb/left 1.png": b"x", "a\nb/right 1.png": b"y", "note.txt": b""}))  # fmt: skip


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("damage") / "images.zip"


def read(path: Path) -> None:
    with ImageArchive(path) as archive:
        assert archive.pairs
        for sentence in archive.refused:
            assert_one_sentence(sentence)
        for pair in archive.pairs:
            assert len(pair.name.splitlines()) == 1
            for name in (pair.left, pair.right):
                read_or_refused(lambda name=name: archive.read(name), CalibrationError)  # type: ignore[misc]


@examples(100)
@given(damaged(WHOLE, (b"PK\x05\x06", b"PK\x01\x02", b"PK\x06\x06", b"\xff" * 8))
       | hostile_bytes((b"PK\x03\x04", b"PK\x05\x06", *WHOLE)))  # fmt: skip
@example(WHOLE[3])
@example(packed({"/.png": b"", "left/.png": b"", "left/..png": b"", "right/..png": b""}))
def test_a_damaged_archive_is_refused_or_readable(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    read_or_refused(lambda: read(path), CalibrationError)
