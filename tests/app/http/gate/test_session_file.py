"""The file that preserves the session table across restarts."""

from __future__ import annotations

import asyncio
import json
import stat
from pathlib import Path
from typing import Any

import pytest

from app.http.gate import session_file
from app.http.gate.session_file import SessionFile

from ..clock import Clock
from .session_tables import LIFETIME_S, found, table


async def test_the_file_holds_no_ids_and_restores_sessions_after_a_restart(tmp_path: Path) -> None:
    path = tmp_path / "sessions.json"
    clock, wall = Clock(), Clock(1.8e9)
    sessions = table(clock)
    kept, ended = sessions.start(), sessions.start()
    file = SessionFile(path, sessions, wall)
    await file.save()
    sessions.end(found(sessions, ended))
    await file.save()
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert kept not in path.read_text()
    # The next process has another monotonic clock, and 90 s have passed.
    wall.now += 90
    later = table(Clock(3.0))
    SessionFile(path, later, wall).load()
    assert later.find(kept)
    assert later.find(ended) is None
    wall.now += 20
    too_late = table(Clock(3.0))
    SessionFile(path, too_late, wall).load()
    assert too_late.ages() == []


async def test_links_and_their_sessions_survive_a_restart_until_revoked(
    tmp_path: Path,
) -> None:
    path = tmp_path / "sessions.json"
    sessions = table(Clock())
    first, second = sessions.links.newest, sessions.links.make()
    ids = [sessions.start(link) for link in (None, first, second)]
    file = SessionFile(path, sessions, Clock())
    await file.save()
    assert first.token not in path.read_text()
    later = table(Clock())
    SessionFile(path, later, Clock()).load()
    assert [each.token for each in later.links.in_force] == [first.token, second.token]
    links = [found(later, each).link for each in ids]
    assert [link and link.id for link in links] == [None, first.id, second.id]
    # With another token none of them is valid.
    other = table(Clock(), token="u" * 43)
    SessionFile(path, other, Clock()).load()
    assert other.links.find([first.token, second.token]) is None
    assert all(other.find(each) is None for each in ids)
    sessions.revoke(first)
    await file.save()
    SessionFile(path, later, Clock()).load()
    assert later.links.get(first.id) is None
    assert later.find(ids[2])


async def test_a_revoked_link_stays_revoked_when_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    sessions = table(Clock())
    file = SessionFile(tmp_path / "sessions.json", sessions, Clock())
    await file.save()
    monkeypatch.setattr("os.replace", full)
    sessions.revoke(sessions.links.newest)
    await file.save()
    assert list(tmp_path.iterdir()) == []


async def test_a_wall_clock_set_back_ends_no_session(tmp_path: Path) -> None:
    wall = Clock(1.8e9)
    sessions = table(Clock())
    kept = sessions.start()
    await SessionFile(tmp_path / "s", sessions, wall).save()
    wall.now = 0.0
    for unused_s in (99, 101):
        later_clock = Clock()
        later = table(later_clock)
        SessionFile(tmp_path / "s", later, wall).load()
        later_clock.now += unused_s
        assert (later.find(kept) is not None) == (unused_s == 99)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\xff",
        b"[]",
        b'{"sessions": 1}',
        b'{"sessions": [{"digest": "ab", "started": 0, "used": 0}]}',
        b'{"sessions": [{"digest": "' + 64 * b"0" + b'", "started": NaN, "used": 0}]}',
        b'{"sessions": []' + 2_000_000 * b" " + b"}",
    ],
)
def test_a_damaged_file_is_logged_and_restores_no_session(
    tmp_path: Path, content: bytes, capsys: Any
) -> None:
    path = tmp_path / "sessions.json"
    path.write_bytes(content)
    sessions = table(Clock())
    SessionFile(path, sessions, Clock()).load()
    assert sessions.ages() == []
    assert "sessions_not_read" in capsys.readouterr().out


async def test_without_a_path_nothing_is_written(tmp_path: Path) -> None:
    sessions = table(Clock())
    sessions.start()
    file = SessionFile(None, sessions, Clock())
    file.load()
    await file.save()
    assert list(tmp_path.iterdir()) == []


async def test_a_signed_out_session_stays_out_when_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    path = tmp_path / "sessions.json"
    sessions = table(Clock())
    first, second = sessions.start(), sessions.start()
    file = SessionFile(path, sessions, Clock())
    await file.save()
    monkeypatch.setattr("os.replace", full)
    await file.save()
    # Nobody signed out, so the file is still valid.
    assert len(json.loads(path.read_text())["sessions"]) == 2
    sessions.end(found(sessions, first))
    await file.save()
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    await file.save()
    later = table(Clock())
    SessionFile(path, later, Clock()).load()
    assert later.find(second)
    assert later.find(first) is None


async def test_the_file_is_kept_up_to_date_in_the_background(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session_file, "_LOOK_EVERY_S", 0.001)
    clock, wall = Clock(), Clock()
    sessions = table(clock)
    connected = found(sessions, sessions.start())
    closed = asyncio.Event()
    file = SessionFile(tmp_path / "s", sessions, wall)
    keeping = asyncio.create_task(file.keep())
    with connected.connected(closed.set):
        async with asyncio.timeout(10):
            while not (tmp_path / "s").exists():
                await asyncio.sleep(0.001)
            # In constant use, but expired at the end of its lifetime.
            clock.now += LIFETIME_S + 1
            await closed.wait()
    keeping.cancel()
    await asyncio.gather(keeping, return_exceptions=True)
