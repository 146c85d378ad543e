"""The token, its file, the limit on guesses; names and origins."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import IO, Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from app.http.gate.headers import page_policy
from app.http.gate.origins import NetworkName, names_of, parse_host
from app.http.gate.read_only_links import MOST_LINKS, ReadOnlyLinks
from app.http.gate.token import TokenGuard, TokenVerdict, load_token, new_token
from observer.errors import InputError

TOKEN = "t" * 43


def guard(now: list[float]) -> TokenGuard:
    return TokenGuard(TOKEN, lambda: now[0], ReadOnlyLinks(TOKEN))


def test_read_only_links_have_their_own_tokens() -> None:
    links = ReadOnlyLinks(TOKEN)
    first, second = links.newest, links.make()
    assert links.newest is second
    assert first.token != second.token
    assert len(first.token) * 6 >= 256
    assert TOKEN not in first.token
    gate = TokenGuard(TOKEN, lambda: 0.0, links)
    for link in (first, second):
        assert gate.check("1.2.3.4", [link.token]) is link
        assert gate.check("1.2.3.4", [link.token, TOKEN]) is TokenVerdict.OPERATOR
    # Links derived from a read-only token are not valid, and a revoked link stays revoked.
    above = ReadOnlyLinks(first.token)
    above.restore(links.kept())
    assert gate.check("1.2.3.4", [above.newest.token]) is TokenVerdict.WRONG
    links.revoke(first)
    assert gate.check("1.2.3.4", [first.token]) is TokenVerdict.WRONG
    assert gate.check("1.2.3.4", [second.token]) is second


def test_there_is_always_a_link_to_share_and_never_too_many() -> None:
    told: list[int] = []
    links = ReadOnlyLinks(TOKEN)
    links.changed = lambda: told.append(len(links.in_force))
    only = links.newest
    links.revoke(only)
    links.revoke(only)
    assert links.newest.token != only.token
    while len(links.in_force) < MOST_LINKS:
        links.make()
    with pytest.raises(ValueError, match="revoke one"):
        links.make()
    assert told[-1] == MOST_LINKS


def test_the_one_time_token_works_once_within_a_minute() -> None:
    now = [0.0]
    gate = guard(now)
    first = gate.once()
    assert gate.check("1.2.3.4", [first]) is TokenVerdict.OPERATOR
    assert gate.check("1.2.3.4", [first]) is TokenVerdict.WRONG
    late = gate.once()
    now[0] = 61.0
    assert gate.check("1.2.3.5", [late]) is TokenVerdict.WRONG


def test_tokens_have_at_least_128_bits() -> None:
    assert len(new_token()) * 6 >= 128
    assert len({new_token() for _ in range(100)}) == 100


def test_a_token_file_is_created_once_with_private_permissions(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "token"
    token = load_token(path)
    assert load_token(path) == token
    assert stat.S_IMODE(os.stat(path).st_mode) == 0o600
    assert load_token(None) != load_token(None)


@pytest.mark.parametrize(
    "content", [b"", b"short", b"a b c d e f g h i j k l m n", b"\xff" * 40, b"x" * 600]
)
def test_an_unsafe_token_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "token"
    path.write_bytes(content)
    with pytest.raises(InputError, match="token file"):
        load_token(path)


def test_an_unusable_token_file_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="token file"):
        load_token(tmp_path)
    (tmp_path / "file").write_text("x")
    with pytest.raises(InputError, match="token file"):
        load_token(tmp_path / "file" / "token")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_no_incomplete_token_file_is_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "token"

    def full(descriptor: int, mode: str) -> IO[Any]:
        os.close(descriptor)
        return open("/dev/full", mode)

    with monkeypatch.context() as patch:
        patch.setattr(os, "fdopen", full)
        with pytest.raises(InputError, match=r"cannot be written \(No space left"):
            load_token(path)
    assert not path.exists()
    assert load_token(path) == load_token(path)


def test_five_wrong_tokens_are_allowed_per_minute() -> None:
    now = [0.0]
    gate = guard(now)
    assert [gate.check("1.2.3.4", ["wrong"]) for _ in range(6)] == [TokenVerdict.WRONG] * 5 + [
        TokenVerdict.LIMITED
    ]
    assert gate.check("1.2.3.4", [TOKEN]) is TokenVerdict.OPERATOR
    assert gate.check("1.2.3.4", ["wrong", TOKEN]) is TokenVerdict.OPERATOR
    assert gate.check("1.2.3.4", []) is TokenVerdict.MISSING
    assert gate.check("1.2.3.5", ["wrong"]) is TokenVerdict.WRONG
    now[0] = 61.0
    assert gate.check("1.2.3.4", ["wrong"]) is TokenVerdict.WRONG


def test_wrong_tokens_are_counted_per_ipv6_network() -> None:
    gate = guard([0.0])
    for k in range(5):
        assert gate.check(f"2001:db8::{k}", ["wrong"]) is TokenVerdict.WRONG
    assert gate.check("2001:db8::ffff:1", ["wrong"]) is TokenVerdict.LIMITED
    assert gate.check("2001:db8:0:1::1", ["wrong"]) is TokenVerdict.WRONG
    for _ in range(5):
        gate.check("::ffff:9.9.9.9", ["wrong"])
    assert gate.check("9.9.9.9", ["wrong"]) is TokenVerdict.LIMITED
    assert gate.check(None, ["wrong"]) is TokenVerdict.WRONG


def test_counting_uses_bounded_memory() -> None:
    gate = guard([0.0])
    for k in range(10_000):
        gate.check(f"10.{k >> 16}.{(k >> 8) & 255}.{k & 255}", ["wrong"])
    assert len(gate._wrong) <= 4096


@settings(max_examples=200)
@given(st.text(max_size=60))
def test_only_the_exact_token_is_accepted(text: str) -> None:
    assert (guard([0.0]).check("1.1.1.1", [text]) is TokenVerdict.OPERATOR) == (text == TOKEN)


# --- names and origins --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("localhost", NetworkName("localhost", None)),
        ("LocalHost:8080", NetworkName("localhost", 8080)),
        ("[::1]:8080", NetworkName("::1", 8080)),
        ("127.0.0.1:80", NetworkName("127.0.0.1", 80)),
        ("", None),
        ("::1", None),
        ("localhost:", None),
        ("localhost:99999", None),
        ("user@localhost", None),
        ("localhost/path", None),
        ("localhost.", None),
        ("a" * 300, None),
    ],
)
def test_hosts_are_parsed_strictly(text: str, expected: NetworkName | None) -> None:
    assert parse_host(text) == expected


@settings(max_examples=300)
@given(st.text(max_size=40))
def test_no_text_breaks_host_and_origin_parsing(text: str) -> None:
    names = names_of("127.0.0.1", (), tls=False)
    host = parse_host(text)
    if host is not None and names.answers_to(host):
        assert host.name in ("localhost", "127.0.0.1", "::1")
    origin = f"http://{text}"
    if names.accepts_origin(origin, NetworkName("127.0.0.1", 8080)):
        assert text.lower() == "127.0.0.1:8080"


def test_only_the_servers_own_pages_are_accepted() -> None:
    names = names_of("0.0.0.0", ("lab.example", "other.example:8443"), tls=False)
    here = NetworkName("127.0.0.1", 8080)
    accepted = {
        "http://127.0.0.1:8080": True,
        "https://127.0.0.1:8080": True,
        "http://127.0.0.1": False,
        "http://127.0.0.1:8081": False,
        "http://localhost:8080": False,
        "http://127.0.0.1:8080/": False,
        "http://127.0.0.1:8080@evil.example": False,
        "http://evil.example": False,
        "null": False,
        "": False,
        "file://": False,
        "chrome-extension://127.0.0.1:8080": False,
        # A proxy in front may have replaced Host.
        "https://lab.example": True,
        "http://lab.example": True,
        "https://lab.example:9000": False,
        "https://other.example:8443": True,
        "https://other.example": False,
        "https://lab.example.evil.example": False,
    }
    assert {o: names.accepts_origin(o, here) for o in accepted} == accepted
    assert names.accepts_origin("http://127.0.0.1", NetworkName("127.0.0.1", None))
    assert names.answers_to(NetworkName("lab.example", 1234))
    assert names.answers_to(NetworkName("other.example", 8443))
    assert not names.answers_to(NetworkName("other.example", 8080))
    # The wildcard address is not a name.
    assert not names.answers_to(NetworkName("0.0.0.0", 8080))


def test_a_wildcard_server_accepts_numeric_hosts_but_not_other_names() -> None:
    names = names_of("0.0.0.0", (), tls=False)
    assert names.answers_to(NetworkName("192.168.1.5", 8080))
    assert names.answers_to(NetworkName("fd00::2", 8080))
    for name in ("0.0.0.0", "::", "192.168.1.5.evil.example", "evil.example", "0300.0250.1.5"):
        assert not names.answers_to(NetworkName(name, 8080)), name
    here = NetworkName("192.168.1.5", 8080)
    assert names.accepts_origin("http://192.168.1.5:8080", here)
    assert not names.accepts_origin("http://192.168.1.6:8080", here)
    assert not names_of("127.0.0.1", (), tls=False).answers_to(here)
    assert not names_of("192.168.1.6", (), tls=False).answers_to(here)


def test_with_tls_only_https_origins_are_accepted() -> None:
    names = names_of("127.0.0.1", (), tls=True)
    assert names.accepts_origin("https://127.0.0.1:8080", NetworkName("127.0.0.1", 8080))
    assert not names.accepts_origin("http://127.0.0.1:8080", NetworkName("127.0.0.1", 8080))


def test_an_own_page_allows_styles_by_hash_only() -> None:
    policy = page_policy("<style>a{}</style><p>text</p>")
    assert "style-src 'sha256-" in policy
    assert "script-src 'none'" in policy
    assert "unsafe" not in policy
