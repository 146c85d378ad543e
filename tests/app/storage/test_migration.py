from __future__ import annotations

import shutil
import sqlite3
import textwrap
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest
from alembic import command
from alembic.autogenerate import compare_metadata
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Engine, create_engine

from app.storage import IncidentRecord, SpeedRow, Storage, StorageError
from app.storage.engines import database_url, make_engine
from app.storage.migration import MIGRATIONS, upgrade
from app.storage.models import Base

HEAD = ScriptDirectory(str(MIGRATIONS)).get_current_head()


@pytest.fixture
def later(tmp_path: Path) -> Callable[[str], Path]:
    """Makes a copy of the package's migrations with one more revision of the given upgrade."""

    def make(body: str) -> Path:
        folder = tmp_path / "migrations"
        shutil.copytree(MIGRATIONS, folder, ignore=shutil.ignore_patterns("__pycache__"))
        lines = ["from alembic import op", 'revision = "9999"', f'down_revision = "{HEAD}"']
        lines += ["branch_labels = None", "depends_on = None", "def upgrade():"]
        source = "\n".join(lines) + "\n" + textwrap.indent(textwrap.dedent(body), "    ")
        (folder / "versions" / "9999_later.py").write_text(source)
        return folder

    return make


def earlier_migrations(tmp_path: Path, last: int) -> Path:
    """Return a copy of the package's migrations up to a number."""
    folder = tmp_path / f"migrations-{last}"
    shutil.copytree(MIGRATIONS, folder, ignore=shutil.ignore_patterns("__pycache__"))
    for each in (folder / "versions").glob("*.py"):
        if int(each.name[:4]) > last:
            each.unlink()
    return folder


def engine_of(file: Path) -> Engine:
    return make_engine(database_url(file), 1.0)


def test_migrations_create_the_tables_of_the_models(file: Path) -> None:
    with Storage(file):
        pass
    engine = create_engine(f"sqlite:///{file}")
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        differences = compare_metadata(context, Base.metadata)
    engine.dispose()
    assert differences == []


def test_old_incidents_have_no_measured_stops(file: Path, tmp_path: Path) -> None:
    engine = engine_of(file)
    upgrade(engine, file, earlier_migrations(tmp_path, 2))
    engine.dispose()
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute(
            "INSERT INTO runs (id, name, state, source, parameters, started_at, updated_at, frames,"
            " segments, versions) VALUES ('a', 'a', 'finished', 's', '{}', 't', 't', 0, 1, '{}')"
        )
        connection.execute(
            "INSERT INTO incidents (run_id, at, kind, sentence) VALUES ('a', 't', 'stop', 'Stop.')"
        )
    with Storage(file) as storage:
        assert storage.incidents("a") == [IncidentRecord("a", "t", None, "stop", "Stop.", None)]
    assert [each.name for each in file.parent.glob("*.before-migration-from-0002-*")]


def test_a_new_or_current_database_is_not_copied(file: Path) -> None:
    for _ in range(2):
        with Storage(file):
            pass
    assert [each.name for each in file.parent.iterdir()] == ["observer.sqlite"]


def test_the_file_is_copied_before_a_migration(file: Path, later: Callable[[str], Path]) -> None:
    storage = Storage(file).open()
    storage.set_setting("kept", "in the log only")
    # Still open: the last writes are in the write-ahead log, not in the file.
    engine = engine_of(file)
    copy = upgrade(engine, file, later('op.execute("CREATE TABLE more (id INTEGER)")'))
    engine.dispose()
    storage.close()
    assert copy is not None
    assert copy.parent == file.parent
    assert copy.name.startswith(f"observer.before-migration-from-{HEAD}-")
    with Storage(copy) as old:
        assert old.get_setting("kept") == "in the log only"
    with closing(sqlite3.connect(file)) as connection:
        assert connection.execute("SELECT count(*) FROM more").fetchone() == (0,)


def test_a_migration_that_fails_halfway_changes_nothing(
    file: Path, later: Callable[[str], Path]
) -> None:
    with Storage(file) as storage:
        storage.set_setting("kept", 1)
    body = 'op.execute("CREATE TABLE half (id INTEGER)")\nraise RuntimeError("power cut")'
    engine = engine_of(file)
    with pytest.raises(RuntimeError, match="power cut"):
        upgrade(engine, file, later(body))
    engine.dispose()
    with closing(sqlite3.connect(file)) as connection:
        names = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
    assert "half" not in names
    with Storage(file) as storage:
        assert storage.get_setting("kept") == 1


def test_a_database_of_a_newer_version_is_refused(file: Path, later: Callable[[str], Path]) -> None:
    with Storage(file):
        pass
    engine = engine_of(file)
    upgrade(engine, file, later("pass"))
    engine.dispose()
    with pytest.raises(StorageError, match="newer version"):
        Storage(file).open()


def test_runs_from_before_the_history_keep_all_their_rows(file: Path, tmp_path: Path) -> None:
    engine = engine_of(file)
    upgrade(engine, file, earlier_migrations(tmp_path, 3))
    engine.dispose()
    with closing(sqlite3.connect(file)) as connection, connection:
        connection.execute(
            "INSERT INTO runs (id, name, state, source, parameters, started_at, updated_at, frames,"
            " segments, versions) VALUES ('a', 'Größe 1', 'finished', 's', '{}', 't', 't', 3, 1,"
            " '{}')"
        )
        connection.execute(
            "INSERT INTO speeds (run_id, time, role, source, speed, segment)"
            " VALUES ('a', 0.5, 'obstacle', 'truth', 0.25, 0)"
        )
    with Storage(file) as storage:
        (run,) = storage.find_runs("GRÖSSE").runs
        assert (run.tags, run.notes, run.deleted_at, run.alignment) == ((), "", None, None)
        assert (run.record, run.recording_bytes, run.truth_id) == (None, None, None)
        assert storage.speeds("a") == [SpeedRow("a", 0.5, "obstacle", "truth", None, 0.25, None, 0)]


def test_every_migration_can_be_reverted(file: Path) -> None:
    with Storage(file):
        pass
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS))
    engine = engine_of(file)
    for direction, target in ((command.downgrade, "base"), (command.upgrade, "head")):
        with engine.execution_options(writes=True).begin() as connection:
            config.attributes["connection"] = connection
            direction(config, target)
    engine.dispose()
    with Storage(file) as storage:
        assert storage.list_runs() == []
