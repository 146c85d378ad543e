"""Text files: what is not text is named by the encoding that it begins with."""

from __future__ import annotations

import pytest

from observer.errors import InputError
from observer.text_files import decoded


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_text_of_windows_programs_is_read(encoding: str) -> None:
    assert decoded("größe: 1\r\n".encode(encoding), name="a.yaml") == "größe: 1\r\n"


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("size: 1".encode("utf-16")[:-1], "is UTF-16 text that is truncated or damaged"),
        (b"\xfe\xff\xdc\x00\x00s", "is UTF-16 text that is truncated or damaged"),
        (b"size: \xff", "must be UTF-8 text"),
    ],
)
def test_damaged_text_is_named_by_its_encoding(content: bytes, problem: str) -> None:
    with pytest.raises(InputError, match=f"^a.yaml: the file {problem}$"):
        decoded(content, name="a.yaml")
