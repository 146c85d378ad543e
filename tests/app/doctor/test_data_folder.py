"""The data folder and its database: examined, never changed."""

from __future__ import annotations

import os
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from app.doctor.data_folder import examine_data
from app.doctor.finding import Finding
from app.settings import Settings
from app.storage.storage import Storage


def levels(findings: list[Finding]) -> list[str]:
    return [finding.level for finding in findings]


def data_findings(folder: Path, **settings: object) -> list[Finding]:
    return list(examine_data(Settings(data=folder, **settings)))  # type: ignore[arg-type]


def test_a_missing_folder_is_not_created(tmp_path: Path) -> None:
    findings = data_findings(tmp_path / "new" / "folder")
    assert levels(findings) == ["ok", "ok", "ok"]
    assert "will be kept in" in findings[0].text
    assert list(tmp_path.iterdir()) == []


def test_an_intact_database_is_left_unchanged(tmp_path: Path) -> None:
    with Storage(tmp_path / "observer.sqlite"):
        pass
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    assert data_findings(tmp_path)[-1].text == "the database is intact"
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_a_database_opened_by_the_server_is_ok(tmp_path: Path) -> None:
    with Storage(tmp_path / "observer.sqlite"):
        assert data_findings(tmp_path)[-1].level == "ok"


def test_a_damaged_database_is_reported_but_not_moved(tmp_path: Path) -> None:
    (tmp_path / "observer.sqlite").write_bytes(b"no database at all" * 100)
    finding = data_findings(tmp_path)[-1]
    assert finding.level == "warning"
    assert "restore a backup before that" in finding.text
    assert [file.name for file in tmp_path.iterdir()] == ["observer.sqlite"]


@pytest.mark.parametrize(
    ("script", "part"),
    [
        ("CREATE TABLE recipes (name TEXT)", "belongs to another program"),
        (
            "CREATE TABLE alembic_version (version_num TEXT); "
            "INSERT INTO alembic_version VALUES ('from the future')",
            "was written by a newer version",
        ),
    ],
)
def test_a_foreign_or_newer_database_is_a_problem(tmp_path: Path, script: str, part: str) -> None:
    with closing(sqlite3.connect(tmp_path / "observer.sqlite")) as connection:
        connection.executescript(script)
    finding = data_findings(tmp_path)[-1]
    assert finding.level == "problem"
    assert part in finding.text


def test_a_locked_database_is_a_problem(tmp_path: Path) -> None:
    file = tmp_path / "observer.sqlite"
    with closing(sqlite3.connect(file, isolation_level=None)) as connection:
        connection.execute("CREATE TABLE some (thing TEXT)")
        connection.execute("BEGIN EXCLUSIVE")
        finding = data_findings(tmp_path)[-1]
    assert finding.level == "problem"
    assert "is locked by another program" in finding.text


def test_a_data_folder_that_is_a_file_is_a_problem(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("")
    (finding,) = data_findings(tmp_path / "data")
    assert finding.level == "problem"
    assert "is a file, not a folder" in finding.text


@pytest.mark.skipif(os.getuid() == 0, reason="root may write everywhere")
@pytest.mark.parametrize(
    ("name", "advice"), [("", "sudo chown $USER "), ("data", "sudo install -d -o $USER ")]
)
def test_a_data_folder_without_permission_is_a_problem(
    tmp_path: Path, name: str, advice: str
) -> None:
    tmp_path.chmod(0o500)
    try:
        (finding,) = data_findings(tmp_path / name)
    finally:
        tmp_path.chmod(0o700)
    assert finding.level == "problem"
    assert finding.text.endswith(f"{advice}{tmp_path / name}")


def test_a_database_server_error_does_not_reveal_the_password(
    tmp_path: Path, free_port: int
) -> None:
    url = f"postgresql+nothing://me:secret@127.0.0.1:{free_port}/runs"
    finding = data_findings(tmp_path, database=url)[-1]
    assert finding.level == "problem"
    assert "secret" not in finding.text


@pytest.mark.parametrize("url", ["my://database:x", "sqlite://", "sqlite:///:memory:"])
def test_an_invalid_database_url_is_a_problem(tmp_path: Path, url: str) -> None:
    finding = data_findings(tmp_path, database=url)[-1]
    assert finding.level == "problem"
    assert "sqlite:////folder/file.sqlite" in finding.text


def test_a_database_given_by_url_is_examined(tmp_path: Path) -> None:
    (tmp_path / "other.sqlite").write_bytes(b"no database at all" * 100)
    finding = data_findings(tmp_path, database=f"sqlite:///{tmp_path}/other.sqlite")[-1]
    assert finding.level == "warning"
    assert f"{tmp_path}/other.sqlite is damaged" in finding.text


def test_an_unreachable_server_is_reported_in_one_line(tmp_path: Path, free_port: int) -> None:
    url = f"postgresql://me:secret@127.0.0.1:{free_port}/runs"
    finding = data_findings(tmp_path, database=url)[-1]
    assert finding.level == "problem"
    assert "cannot be reached" in finding.text
    assert "secret" not in finding.text
    assert "\n" not in finding.text
