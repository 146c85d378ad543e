"""Valid files, damaged as by disks, editors, transfers and attackers, for every parser.

A parser must either return something valid or refuse in one sentence with its own error, quickly
and without excessive memory; ``read_or_refused`` checks that. ``DAMAGE_EXAMPLES`` sets the number
of examples of each property instead of the few of ordinary runs.
"""

from __future__ import annotations

import copy
import json
import os
import re
import resource
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from hypothesis import HealthCheck, settings
from hypothesis import strategies as st

Value = TypeVar("Value")

# Numbers that cause trouble if taken for ordinary ones.
NUMBERS = (
    b"nan", b"NaN", b".nan", b"inf", b"-inf", b".inf", b"-Infinity", b"1e308", b"-1e308", b"1e999",
    b"5e-324", b"0", b"-0", b"-1", b"1e-12", b"65536", b"2147483648", b"-2147483649",
    b"9007199254740993", b"18446744073709551616", b"9" * 400, b"9" * 5000, b"1_000", b"0x1f",
    b"1,5", b"--1", b"1e", b"+", b".", b"1.5.2", "٣".encode(), "²".encode(), "１".encode(),
)  # fmt: skip
# Pieces that end strings, lines or structures in some format.
PIECES = (
    b"", b"\0", b"\xff\xfe", b"\xef\xbb\xbf", b"\xc3", b"\xed\xa0\x80", b"\r", b"\n", b"\r\n",
    b"\x1a", b"\x85", "\u2028".encode(), b" ", b"\t", b"\"", b"'", b",", b";", b":", b": ", b"=",
    b"#", b"%", b"&a ", b"*a", b"!!python/object:os.system ", b"<<: ", b"- ", b"---\n", b"...\n",
    b"{", b"}", b"[", b"]", b"<", b">", b"&lt;", b"\\", b"\\u0000", b"\\ud800", b"/", b"../", b"~",
    b"null", b"true", b"[" * 2000, b"{\"a\":" * 2000, b"- " * 400, b"<a>" * 400,
    b"2001-99-99", b"\xf0\x9f\xa4\x96",
)  # fmt: skip
# Values that may be put anywhere into JSON by hand; Python's own reader accepts all of them.
JSON_VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1e-12, 2**63, 10**400, float("nan"), float("inf"), "", "x", "a\nb", "\0",
    "\ud800", "1e3", "9" * 5000, "0001-01-01T00:00:00+23:59", "9999-12-31T23:59:59-23:59",
    "2026-11-22T02:09:41", [], {}, [None], [[]], {"": None}, {"\ud800": "\ud800"}, [0.5, "x"],
)  # fmt: skip
_NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
# Far more than the valid sample needs; under load it may take a hundred times as long.
_LONGEST_S = 5.0
_LARGEST_BYTES = 300_000_000
# A path of 4096 characters may be quoted whole.
_LONGEST_SENTENCE = 5000


def examples(count: int) -> settings:
    """Return the settings of a property that normally tries ``count`` examples."""
    given = os.environ.get("DAMAGE_EXAMPLES")
    return settings(
        max_examples=int(given) if given else count,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )


@st.composite
def damaged(
    draw: st.DrawFn, samples: Sequence[bytes], pieces: Sequence[bytes] = (), most: int = 3
) -> bytes:
    """Strategy for one of the samples with one to ``most`` damages.

    Args:
        pieces: meaningful to the parser, inserted in addition to those that trouble any parser.
    """
    content = draw(st.sampled_from(samples))
    for _ in range(draw(st.integers(1, most))):
        change = draw(st.sampled_from(_CHANGES))
        content = change(draw, content, (*PIECES, *pieces))
    return content


def hostile_bytes(pieces: Sequence[bytes] = ()) -> st.SearchStrategy[bytes]:
    """Strategy for arbitrary bytes, and for bytes that resemble the format."""
    known = st.sampled_from((*PIECES, *NUMBERS, *pieces))
    return st.binary(max_size=400) | st.lists(known, max_size=20).map(b"".join)


@st.composite
def damaged_json(draw: st.DrawFn, sample: Any, values: Sequence[Any] = ()) -> bytes:
    """Strategy for the sample as JSON text, changed as by hand: valid JSON of another meaning.

    Args:
        values: inserted in addition to those that trouble any reader.
    """
    whole = [copy.deepcopy(sample)]
    for _ in range(draw(st.integers(1, 2))):
        holder, key = _place(draw, whole)
        if isinstance(holder, dict) and draw(st.booleans()):
            value = holder.pop(key)
            if draw(st.booleans()):
                holder[draw(st.sampled_from((f"{key}x", "", "a.b", "a\nb", "\ud800")))] = value
        else:
            holder[key] = copy.deepcopy(draw(st.sampled_from((*JSON_VALUES, *values))))
    return json.dumps(whole[0]).encode()


def damaged_text(samples: Sequence[str], pieces: Sequence[str] = ()) -> st.SearchStrategy[str]:
    """Strategy for damaged text, for text parsers; invalid UTF-8 becomes lone surrogates."""
    encoded = damaged([each.encode() for each in samples], [each.encode() for each in pieces])
    return encoded.map(_as_text)


def hostile_text(pieces: Sequence[str] = ()) -> st.SearchStrategy[str]:
    """Strategy for arbitrary text, and for text that resembles the format."""
    return st.text(max_size=200) | hostile_bytes([each.encode() for each in pieces]).map(_as_text)


def read_or_refused(read: Callable[[], Value], *errors: type[Exception]) -> Value | None:
    """Return what is read, or None if it is refused; fail for anything in between.

    Args:
        errors: the package's own errors; a refusal must be one of them.
    """
    began, memory = time.process_time(), _peak_bytes()
    value: Value | None = None
    try:
        value = read()
    except errors as error:
        assert_one_sentence(str(error))
    assert time.process_time() - began < _LONGEST_S, "a small input takes long"
    assert _peak_bytes() - memory < _LARGEST_BYTES, "a small input takes much memory"
    return value


def assert_one_sentence(message: str) -> None:
    """Fail unless people can read the message as one sentence, on one line."""
    assert message.strip(), "it says nothing"
    assert len(message.splitlines()) == 1, f"more than one line: {message!r}"
    assert len(message) <= _LONGEST_SENTENCE, f"too long: {message[:200]!r} ..."
    assert not message.endswith(": None"), f"it does not end: {message!r}"
    assert " object at 0x" not in message, f"it shows an object: {message!r}"


def _place(draw: st.DrawFn, whole: list[Any]) -> tuple[Any, Any]:
    """Return the holder and the key of a random value within, at any level."""
    holder: Any = whole
    while True:
        keys = list(holder) if isinstance(holder, dict) else list(range(len(holder)))
        key = draw(st.sampled_from(keys))
        within = holder[key]
        if not isinstance(within, dict | list) or not within or not draw(st.integers(0, 2)):
            return holder, key
        holder = within


def _as_text(content: bytes) -> str:
    return content.decode("utf-8", "surrogateescape")


def _peak_bytes() -> int:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


# --- damages -----------------------------------------------------------------------------------


def _cut_off(draw: st.DrawFn, content: bytes, _: Sequence[bytes]) -> bytes:
    return content[: draw(st.integers(0, len(content)))]


def _flip(draw: st.DrawFn, content: bytes, _: Sequence[bytes]) -> bytes:
    if not content:
        return content
    at = draw(st.integers(0, len(content) - 1))
    return content[:at] + bytes((content[at] ^ draw(st.integers(1, 255)),)) + content[at + 1 :]


def _replace(draw: st.DrawFn, content: bytes, pieces: Sequence[bytes]) -> bytes:
    at, length = draw(st.integers(0, len(content))), draw(st.integers(0, 20))
    piece = draw(st.sampled_from(pieces) | st.sampled_from(NUMBERS) | st.binary(max_size=8))
    return content[:at] + piece + content[at + length :]


def _change_number(draw: st.DrawFn, content: bytes, _: Sequence[bytes]) -> bytes:
    found = list(_NUMBER.finditer(content))
    if not found:
        return content
    number = found[draw(st.integers(0, len(found) - 1))]
    return content[: number.start()] + draw(st.sampled_from(NUMBERS)) + content[number.end() :]


def _change_lines(draw: st.DrawFn, content: bytes, _: Sequence[bytes]) -> bytes:
    lines = content.splitlines(keepends=True)
    if not lines:
        return content
    a, b = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    match draw(st.sampled_from(("remove", "repeat", "exchange", "join", "move"))):
        case "remove":
            del lines[a]
        case "repeat":
            lines.insert(b, lines[a])
        case "exchange":
            lines[a], lines[b] = lines[b], lines[a]
        case "join":
            lines[a] = lines[a].rstrip(b"\r\n")
        case "move":
            lines.insert(b, lines.pop(a))
    return b"".join(lines)


def _repeat_part(draw: st.DrawFn, content: bytes, _: Sequence[bytes]) -> bytes:
    at, length = draw(st.integers(0, len(content))), draw(st.integers(1, 60))
    return content[: at + length] + content[at:]


def _recode(draw: st.DrawFn, content: bytes, _: Sequence[bytes]) -> bytes:
    match draw(st.sampled_from(("utf-16", "utf-8-sig", "latin-1", "crlf", "cr", "nothing"))):
        case "crlf":
            return content.replace(b"\n", b"\r\n")
        case "cr":
            return content.replace(b"\n", b"\r")
        case "nothing":
            return content.replace(b"\n", b"")
        case "latin-1":
            return content + "Größe ±1°".encode("latin-1")
        case encoding:
            return content.decode("latin-1").encode(encoding)


_CHANGES: tuple[Callable[[st.DrawFn, bytes, Sequence[bytes]], bytes], ...] = (
    _cut_off, _flip, _replace, _replace, _change_number, _change_number, _change_lines,
    _repeat_part, _recode,
)  # fmt: skip
