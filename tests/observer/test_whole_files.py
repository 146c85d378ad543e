"""Files written completely or not at all."""

from __future__ import annotations

from pathlib import Path

import pytest

from observer.whole_files import whole_file


def test_a_file_appears_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "table.json"
    with whole_file(path) as part:
        part.write_text("{}")
        assert not path.exists()
        assert part.parent == path.parent
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
