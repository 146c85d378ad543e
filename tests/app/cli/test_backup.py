"""Backup and restoration as a shell sees them."""

from __future__ import annotations

from pathlib import Path

import pytest

from app.storage import Storage

from .shell import Shell


@pytest.fixture
def data(tmp_path: Path) -> Path:
    with Storage(tmp_path / "data" / "observer.sqlite") as storage:
        storage.save_preset("mine", {"a": 1})
    return tmp_path / "data"


def test_backup_and_restore_round_trip(shell: Shell, data: Path, tmp_path: Path) -> None:
    file, other = str(tmp_path / "kept.zip"), tmp_path / "other"
    done = shell("backup", file, "--data", str(data))
    assert (done.code, done.out) == (0, "")
    assert "1 file, " in done.err
    assert "without recordings" in done.err
    done = shell("restore", file, "--data", str(other))
    assert (done.code, done.out) == (0, "")
    assert f"UTC is restored in {other}" in done.err
    with Storage(other / "observer.sqlite") as storage:
        assert [each.name for each in storage.list_presets()] == ["mine"]
    done = shell("restore", file, "--data", str(other))
    assert done.code == 2
    assert "already exists; use --replace to put" in done.err
    done = shell("restore", file, "--data", str(other), "--replace")
    assert done.code == 0
    assert "the previous data is kept as" in done.err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("backup", "kept.rar"), "must end in .zip or .tar"),
        (("backup", "kept.zip", "--data", "nothing"), "there is no database"),
        (("restore", "nothing.zip"), "cannot read the backup nothing.zip"),
        (("restore", "data/observer.sqlite"), "is not a backup"),
        (("backup", "kept.zip", "--database", "postgresql+x://a:secret@b/c"), "is not valid"),
    ],
)
def test_impossible_requests_give_a_one_line_error(
    shell: Shell,
    data: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    sentence: str,
) -> None:
    monkeypatch.chdir(data.parent)
    done = shell(*arguments, *([] if "--data" in arguments else ["--data", "data"]))
    assert done.code in (1, 2)
    assert done.out == ""
    assert done.err.count("\n") == 1
    assert sentence in done.err
    assert "secret" not in done.err
