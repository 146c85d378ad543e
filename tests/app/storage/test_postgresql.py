"""How PostgreSQL differs from a file: locks, a server that goes and comes back, migrations."""

from __future__ import annotations

import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from app.doctor.data_folder import examine_data
from app.settings import Settings
from app.storage import Storage, StorageBusy, StorageError, StorageMissing
from app.storage.engines import database_url, make_engine
from app.storage.errors import StorageUnreachable
from app.storage.migration import upgrade
from app.storage.models import Base

from ...postgresql import PrivateServer, private_server
from .test_migration import earlier_migrations

NewDatabase = Callable[[], str]


def test_migrations_create_the_tables_of_the_models(
    new_database: NewDatabase, tmp_path: Path
) -> None:
    url = new_database()
    with Storage(url, folder=tmp_path) as storage:
        assert storage.file is None
        assert storage.list_runs() == []
    engine = make_engine(database_url(url), 1.0)
    with engine.connect() as connection:
        context = MigrationContext.configure(connection, opts={"compare_type": True})
        differences = compare_metadata(context, Base.metadata)
    engine.dispose()
    assert differences == []
    assert list(tmp_path.iterdir()) == []


def test_the_database_is_copied_before_a_migration(
    new_database: NewDatabase, tmp_path: Path, server: PrivateServer
) -> None:
    url = new_database()
    engine = make_engine(database_url(url), 1.0)
    upgrade(engine, None, earlier_migrations(tmp_path, 3))
    engine.dispose()
    name = database_url(url).database or ""
    server.run(
        "INSERT INTO runs (id, name, state, source, parameters, started_at, updated_at, frames,"
        " segments, versions) VALUES ('a', 'Größe', 'finished', 's', '{\"a\": 0.1}', 't', 't', 0,"
        " 1, '{}')",
        name,
    )
    server.run(
        "INSERT INTO speeds (run_id, time, role, source, speed, segment) SELECT 'a', i / 10.0,"
        " 'obstacle', 'truth', 0.1, 0 FROM generate_series(1, 5000) AS i",
        name,
    )
    data = tmp_path / "data"
    with Storage(url, folder=data) as storage:
        now = storage.get_run("a")
        assert [run.name for run in storage.find_runs("grösse").runs] == ["Größe"]
    (copy,) = data.iterdir()
    assert copy.name.startswith("observer.before-migration-from-0003-")
    with Storage(copy) as old:
        assert old.get_run("a") == now
        assert [row.time for row in old.speeds("a")] == [i / 10 for i in range(1, 5001)]


def test_two_servers_starting_together_migrate_without_conflict(
    new_database: NewDatabase, tmp_path: Path
) -> None:
    url = new_database()
    problems: list[Exception] = []

    def begin() -> None:
        try:
            Storage(url, folder=tmp_path).open().close()
        except StorageError as error:
            problems.append(error)

    threads = [threading.Thread(target=begin) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert problems == []


def test_another_programs_database_is_refused(
    new_database: NewDatabase, tmp_path: Path, server: PrivateServer
) -> None:
    url = new_database()
    server.run("CREATE TABLE recipes (name text)", database_url(url).database or "")
    with pytest.raises(StorageError, match="another program"):
        Storage(url, folder=tmp_path).open()


def test_a_locked_table_is_busy_and_works_afterwards(
    new_database: NewDatabase, tmp_path: Path
) -> None:
    url = new_database()
    with Storage(url, folder=tmp_path, busy_timeout_s=0.2) as storage:
        storage.set_setting("a", 1)
        other = make_engine(database_url(url), 1.0)
        with other.begin() as connection:
            connection.exec_driver_sql("LOCK TABLE settings IN EXCLUSIVE MODE")
            with pytest.raises(StorageBusy, match="locked by another program"):
                storage.set_setting("a", 2)
            assert storage.get_setting("a") == 1
        other.dispose()
        storage.set_setting("a", 3)
        assert storage.get_setting("a") == 3


def test_a_restarted_database_server_is_used_again(tmp_path: Path, server: PrivateServer) -> None:
    del server
    with private_server() as mine:
        mine.run("CREATE DATABASE kept")
        with Storage(mine.url("kept"), folder=tmp_path) as storage:
            run = storage.create_run(name="r", source="s", parameters={}, versions={})
            stop(mine)
            with pytest.raises(StorageUnreachable, match="cannot be reached") as caught:
                storage.update_run(run.id, frames=1)
            assert "\n" not in str(caught.value)
            with pytest.raises(StorageUnreachable):
                storage.list_runs()
            mine.start()
            assert storage.update_run(run.id, frames=2).frames == 2
        stop(mine)
        with pytest.raises(StorageUnreachable):
            Storage(mine.url("kept"), folder=tmp_path).open()


def stop(server: PrivateServer) -> None:
    command = [str(server.bin / "pg_ctl"), "-D", str(server.folder / "data"), "-m", "fast", "stop"]
    subprocess.run(command, check=True, capture_output=True, **server.user, extra_groups=[])
    assert server.process is not None
    server.process.wait(10)


def test_a_wrong_url_gives_one_line_without_the_password(
    new_database: NewDatabase, tmp_path: Path, server: PrivateServer
) -> None:
    for url in (server.url("nothing"), new_database().replace("observer@", "nobody:secret@")):
        with pytest.raises(StorageError) as caught:
            Storage(url, folder=tmp_path).open()
        assert "\n" not in str(caught.value)
        assert "secret" not in str(caught.value)
    with pytest.raises(StorageError, match="is needed"):
        Storage(server.url("nothing"))


@pytest.mark.parametrize(("count", "problem"), [(0, StorageMissing), (201, StorageError)])
def test_an_error_of_the_database_server_becomes_a_storage_error(
    new_database: NewDatabase, tmp_path: Path, count: int, problem: type[Exception]
) -> None:
    with Storage(new_database(), folder=tmp_path) as storage:
        given: dict[str, Any] = {"calibration_id": "nothing"} if count == 0 else {}
        with pytest.raises(problem):
            storage.create_run(name="n" * count, source="s", parameters={}, versions={}, **given)
        assert storage.list_runs() == []


def test_the_doctor_examines_the_server_without_changes(
    new_database: NewDatabase, tmp_path: Path, server: PrivateServer
) -> None:
    url = new_database()
    name = database_url(url).database or ""

    def told() -> tuple[str, str]:
        finding = list(examine_data(Settings(data=tmp_path, database=url)))[-1]
        return finding.level, finding.text

    assert told()[0] == "ok"
    assert server.run("SELECT count(*) FROM pg_tables WHERE schemaname = 'public'", name) == "0"
    with Storage(url, folder=tmp_path):
        level, text = told()
    assert level == "ok"
    assert text.startswith("the database is intact; it is postgresql")
    server.run("UPDATE alembic_version SET version_num = '9999'", name)
    level, text = told()
    assert level == "problem"
    assert "newer version" in text
