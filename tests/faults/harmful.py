"""Malicious archives, texts, numbers and paths that a server must refuse."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterator
from typing import Any

BOMB_BYTES = 200_000_000
_BLOCK = bytes(1 << 20)

# --- archives ----------------------------------------------------------------------------------


def bomb() -> bytes:
    """Return a zip archive of zeros."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open("left/1.png", "w", force_zip64=True) as entry:
            for _ in range(BOMB_BYTES // len(_BLOCK)):
                entry.write(_BLOCK)
        archive.writestr("right/1.png", b"x")
    return file.getvalue()


def nested(depth: int = 5) -> bytes:
    """Return archives within archives."""
    content = b"x" * 1000
    for _ in range(depth):
        file = io.BytesIO()
        with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for number in range(10):
                archive.writestr(f"left/{number}.zip", content)
        content = file.getvalue()
    return content


def entry(name: str, content: str, mode: int = 0o100644) -> bytes:
    """Return an archive with one entry."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        info = zipfile.ZipInfo(name)
        info.create_system, info.external_attr = 3, mode << 16
        archive.writestr(info, content)
    return file.getvalue()


ARCHIVES: dict[str, Callable[[], bytes]] = {
    "bomb": bomb,
    "nested": nested,
    "symbolic link": lambda: entry("left/1.png", "/etc/passwd", 0o120777),
    "entry outside": lambda: entry("../../../canary", "x"),
    "absolute entry": lambda: entry("/tmp/canary", "x"),
}

# --- texts -------------------------------------------------------------------------------------

# 9 levels of 9 references: more than 3 billion entries.
YAML_BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join(9 * [f'*a{n - 1}'])}]\n" for n in range(1, 10)
)

MALFORMED: dict[str, bytes] = {
    "nothing": b"",
    "cut": b"{",
    "no text": b"\xff\xfe\x00",
    "lone surrogate": b'"\\ud800',
    "deep object": b'{"a": ' * 20_000,
    "deep list": b"[" * 100_000,
    "long number": b"9" * 100_000,
    "two values": b"{} {}",
    "list": b"[]",
    "text": b'"x"',
}
# WebSocket messages, text or bytes.
GARBAGE: dict[str, str | bytes] = {
    "no JSON": "garbage",
    "deep": "[" * 100_000,
    "list": "[1]",
    "other type": '{"type": ["stop"]}',
    "bytes": b"\x00\xff\x81garbage",
    "two megabytes": "x" * (2 << 20),
}
# Raw frames masked with zeros: broken UTF-8, an unknown opcode, a reserved bit, a length of 2**62
# bytes.
BROKEN_FRAMES: dict[str, bytes] = {
    "broken UTF-8": b"\x81\x82\x00\x00\x00\x00\xff\xfe",
    "unknown kind": b"\x83\x80\x00\x00\x00\x00",
    "reserved bit": b"\xc1\x81\x00\x00\x00\x00x",
    "endless": b"\x82\xff\x40\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00",
}

# --- numbers -----------------------------------------------------------------------------------

# Values in JSON as Python writes it.
NO_NUMBERS = ("NaN", "Infinity", "-Infinity", "1e999", "-1e999", "true", '"2"', "[]", "{}")
# Beyond every range.
HUGE_NUMBERS = ("1e300", "-1e300", "1" + "0" * 400)
_NUMERIC = {"number", "integer"}


def numeric_fields(schema: Any, known: dict[str, Any]) -> Iterator[tuple[str, ...]]:
    """Yield the paths of all numbers in an object of a JSON schema.

    Args:
        known: schemas that others refer to, by name.
    """
    if "$ref" in schema:
        yield from numeric_fields(known[schema["$ref"].rpartition("/")[2]], known)
    for choice in schema.get("anyOf", ()):
        yield from numeric_fields(choice, known)
    if schema.get("type") in _NUMERIC:
        yield ()
    for name, field in schema.get("properties", {}).items():
        yield from ((name, *rest) for rest in numeric_fields(field, known))


def holding(place: tuple[str, ...], value: str) -> str:
    """Return JSON of nested objects with a value at a path."""
    return value if not place else f'{{"{place[0]}": {holding(place[1:], value)}}}'


# --- paths -------------------------------------------------------------------------------------


def paths(canary: str) -> list[str]:
    """Return request targets that would lead to a file outside, in every possible notation.

    Args:
        canary: the file's absolute path.
    """
    inner = canary.lstrip("/")
    escaped = inner.replace("/", "%2f")
    outside = [
        12 * "../" + inner,
        12 * "..%2f" + escaped,
        12 * "%2e%2e/" + inner,
        12 * "%2e%2e%2f" + escaped,
        12 * "%252e%252e%252f" + inner.replace("/", "%252f"),
        12 * "..%5c" + inner.replace("/", "%5c"),
        12 * "..\\" + inner,
        canary,
        f"%2f{escaped}",
        f"file:%2f%2f%2f{escaped}",
        f"%2f{escaped}%00.js",
        "%00",
        "..",
        "%2e%2e",
    ]
    beginnings = [
        *("/static/", "/static/app/", "/viewer/", "/docs/", "/api/runs/", "/api/views/"),
        *("/api/calibrations/", "/api/programmes/", "/api/recording/clips/", "/api/robots/checks/"),
        *("/api/boards/", "/api/calibrating/views/", "/"),
    ]
    endings = ["", "/file", ".jpg"]
    return [f"{a}{b}{c}" for a in beginnings for b in outside for c in endings if a.strip("/") or b]
