"""Events are noted once, in sentences, and the newest ones are kept."""

from __future__ import annotations

from typing import Any

import pytest

from app.server import Server
from app.server.journal import Journal


@pytest.fixture
def journal(server: Server) -> Any:
    journal = Journal(server, lambda: 1_700_000_000.0, most=20)
    unfollow = journal.follow()
    yield journal
    unfollow()


def texts(journal: Journal, after: int = 0) -> list[str]:
    return [entry.text for entry in journal.since(after)]


async def test_start_and_source_are_logged(journal: Journal) -> None:
    assert texts(journal)[0] == "Server started."
    assert "Source simulated:lab was opened." in texts(journal)
    assert {entry.time for entry in journal.since(0)} == {1_700_000_000.0}


async def test_a_lost_engine_is_logged_once(journal: Journal, peer: Any) -> None:
    before = journal.newest
    peer.lose("the engine ended with exit code 1")
    failed = [entry for entry in journal.since(before) if entry.severity == "error"]
    assert [entry.text for entry in failed] == [
        "The engine ended with exit code 1; it is restarting."
    ]
    journal.status_changed()
    assert len([e for e in journal.since(before) if e.severity == "error"]) == 1


async def test_a_warning_with_changing_figures_is_logged_once(
    journal: Journal, server: Server
) -> None:
    before = journal.newest
    server.shared.warnings.append("the disk has 3.2 MB left")
    journal.status_changed()
    server.shared.warnings[-1] = "the disk has 2.9 MB left"
    journal.status_changed()
    assert texts(journal, before) == ["The disk has 3.2 MB left."]
    # A warning that went away and came back is new.
    server.shared.warnings.pop()
    journal.status_changed()
    server.shared.warnings.append("the disk has 1.0 MB left")
    journal.status_changed()
    assert texts(journal, before)[-1] == "The disk has 1.0 MB left."


async def test_only_the_newest_entries_are_kept_and_numbering_continues(journal: Journal) -> None:
    calls: list[int] = []
    journal.changed = lambda: calls.append(journal.newest)
    for number in range(100):
        journal.note("info", f"entry {number}!")
    entries = journal.since(0)
    assert len(entries) == 20
    assert entries[-1].number == journal.newest == calls[-1]
    assert entries[-1].text == "Entry 99!"
    assert journal.since(journal.newest) == []
    journal.note("info", "x" * 10_000)
    assert len(journal.since(journal.newest - 1)[0].text) <= 501
    journal.note("info", "many words, " * 100)
    assert texts(journal, journal.newest - 1)[0].endswith((" many…", " words…"))
    journal.note("info", "y" * 500)
    assert texts(journal, journal.newest - 1)[0] == "Y" + "y" * 499 + "."
