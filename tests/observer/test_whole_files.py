"""Files written completely or not at all."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from observer.whole_files import whole_file


def test_a_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    with whole_file(path) as part:
        part.write_text("{}")
        assert not path.exists()
        assert part.name == path.name
    assert path.read_text() == "{}"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("error", [OSError, ValueError, KeyboardInterrupt])
def test_a_failed_block_leaves_the_earlier_file_alone(
    tmp_path: Path, error: type[BaseException]
) -> None:
    path = tmp_path / "table.json"
    path.write_text("before")

    def fail() -> None:
        with whole_file(path) as part:
            part.write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_two_writers_do_not_share_an_incomplete_file(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    with whole_file(path) as first, whole_file(path) as second:
        first.write_text("first")
        second.write_text("second")
    assert path.read_text() == "first"


def test_a_file_that_cannot_be_moved_into_place_is_deleted(tmp_path: Path) -> None:
    path = tmp_path / "folder"
    (path / "inside").mkdir(parents=True)
    with pytest.raises(OSError, match="directory"), whole_file(path) as part:
        part.write_text("{}")
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with whole_file(path) as part:
        part.mkdir()
        (part / "metadata.yaml").touch()
        assert not path.exists()
    assert [each.name for each in path.iterdir()] == ["metadata.yaml"]
    assert list(tmp_path.iterdir()) == [path]


def test_a_private_file_is_its_owner_s_from_the_first_moment_on(tmp_path: Path) -> None:
    path = tmp_path / "sessions.json"
    path.touch(mode=0o644)
    with whole_file(path, private=True) as part:
        assert stat.S_IMODE(part.stat().st_mode) == 0o600
        part.write_text("{}")
    assert stat.S_IMODE(path.stat().st_mode) == 0o600


def test_a_durable_file_is_on_the_disk_before_it_replaces_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "rig.yaml"
    flushed = []
    real = os.fsync

    def fsync(descriptor: int) -> None:
        flushed.append((stat.S_ISDIR(os.fstat(descriptor).st_mode), path.exists()))
        real(descriptor)

    monkeypatch.setattr("os.fsync", fsync)
    with whole_file(path, durable=True) as part:
        part.write_text("mount:")
    is_folder, is_in_place = True, True
    assert flushed == [(not is_folder, not is_in_place), (is_folder, is_in_place)]


def test_an_unfinished_file_is_kept_on_request(tmp_path: Path) -> None:
    path = tmp_path / "tracks.jsonl"

    def fail() -> None:
        with whole_file(path, keep_unfinished=True) as part:
            part.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fail()
    unfinished = tmp_path / "tracks.jsonl.part"
    assert unfinished.read_text() == "half"
    with whole_file(path, keep_unfinished=True) as part:
        part.write_text("all")
    assert path.read_text() == "all"
    assert list(tmp_path.iterdir()) == [path]
