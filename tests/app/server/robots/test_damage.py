"""Damaged records of guided checks: listed and read like intact ones, or left out."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import TypeAdapter

from app.contract.robots import CheckEntry
from app.server import NotThere
from app.server.robots.check_records import CheckRecords, advice

from ....damage import (
    assert_one_sentence,
    damaged,
    damaged_json,
    examples,
    hostile_bytes,
    read_or_refused,
)
from .test_guard_check import NOW, circumstances, ended

TODAY = datetime.fromisoformat(NOW) + timedelta(days=3)
DAMAGED = "2026-11-23T0101-observer"
WORDS = ("observer", "obstacle", "given_up", "waiting", "2026-11-22T02:09:41")
PIECES = tuple(f'"{word}"'.encode() for word in WORDS)
AS_ANSWERED = TypeAdapter(list[CheckEntry])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an intact record, older than the damaged ones that are put beside it."""
    folder = tmp_path_factory.mktemp("guard-checks")
    CheckRecords(folder).save(ended())
    return folder


@pytest.fixture(scope="module")
def whole(folder: Path) -> bytes:
    return (folder / "2026-11-22T0209-observer.json").read_bytes()


def hold(folder: Path, content: bytes) -> None:
    (folder / f"{DAMAGED}.json").write_bytes(content)
    records = CheckRecords(folder)
    listed = read_or_refused(records.all)
    assert listed is not None
    assert listed[-1].name == "2026-11-22T0209-observer"
    AS_ANSWERED.dump_json(listed)
    text = read_or_refused(lambda: records.text(DAMAGED, "json"), NotThere)
    assert text is None or text.encode()
    newest = records.newest("observer")
    assert newest is not None
    told = advice(newest, circumstances(), TODAY.astimezone(UTC))
    if told is not None:
        assert_one_sentence(told)


@examples(100)
@given(data=st.data())
def test_a_damaged_record_is_skipped_or_listed(
    folder: Path, whole: bytes, data: st.DataObject
) -> None:
    hold(folder, data.draw(damaged([whole], PIECES) | damaged_json(json.loads(whole), WORDS)))


@pytest.mark.parametrize("time", ["0001-01-01T00:00:00+23:59", "9999-12-31T23:59:59-23:59", "x"])
def test_a_record_with_an_invalid_time_is_skipped(folder: Path, whole: bytes, time: str) -> None:
    hold_none(folder, whole.replace(NOW.encode(), time.encode()))


@examples(40)
@given(content=hostile_bytes(PIECES))
@example(b"[" * 100_000)
@example(b'{"started_at": ' + b"9" * 5000 + b"}")
def test_an_invalid_record_is_skipped(folder: Path, content: bytes) -> None:
    hold_none(folder, content)


def hold_none(folder: Path, content: bytes) -> None:
    hold(folder, content)
    assert [entry.name for entry in CheckRecords(folder).all()] == ["2026-11-22T0209-observer"]
