"""One server for one data folder and one database."""

from __future__ import annotations

import multiprocessing
import os
import socket
import threading
import time
from collections.abc import Callable
from multiprocessing.synchronize import Event
from pathlib import Path

import pytest
from sqlalchemy.exc import InvalidRequestError
from structlog.testing import capture_logs

from app.storage import StorageError
from app.storage.engines import database_url
from app.storage.errors import StorageUnreachable
from app.storage.occupancy import occupied
from app.storage.server_locks import ServedDatabase
from observer.errors import InputError

from ...postgresql import PrivateServer, private_server
from ...waiting import until

NewDatabase = Callable[[], str]
HERE = f"process {os.getpid()} on {socket.gethostname()}"


def test_a_folder_is_locked_by_one_server(tmp_path: Path) -> None:
    refusal = rf"another server \(process {os.getpid()}\) is using the folder .* --data$"
    with occupied(tmp_path), pytest.raises(InputError, match=refusal), occupied(tmp_path):
        pytest.fail("held twice")
    with occupied(tmp_path / "made" / "for it"):
        pass


def test_nothing_is_locked_when_locking_is_impossible(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with occupied(tmp_path / "file"), occupied(tmp_path / "file"):
        pass


def test_a_separate_database_file_is_locked_across_folders(tmp_path: Path) -> None:
    shared = f"sqlite:///{tmp_path / 'shared.sqlite'}"
    beside = f"sqlite:///{tmp_path / 'beside.sqlite'}"
    with occupied(tmp_path / "a", shared):
        with (
            pytest.raises(InputError, match=r"shared\.sqlite; stop it.* --database$"),
            occupied(tmp_path / "b", shared),
        ):
            pytest.fail("held twice")
        with occupied(tmp_path / "b", beside):
            pass
    with occupied(tmp_path / "b", shared):
        pass


def test_the_database_of_another_servers_folder_is_locked(tmp_path: Path) -> None:
    own, link = tmp_path / "a" / "observer.sqlite", tmp_path / "link.sqlite"
    link.symlink_to(own)
    with occupied(tmp_path / "a"):
        for file in (own, link):
            with (
                pytest.raises(
                    InputError, match=r"is using the database .*a/observer\.sqlite; stop"
                ),
                occupied(tmp_path / "b", str(file)),
            ):
                pytest.fail("held twice")


def test_each_database_on_a_server_is_locked_separately(
    new_database: NewDatabase, tmp_path: Path
) -> None:
    url = new_database()
    with occupied(tmp_path / "a", url):
        with (
            pytest.raises(StorageError, match=rf"\({HERE}\) .* --database$") as caught,
            occupied(tmp_path / "b", url),
        ):
            pytest.fail("held twice")
        assert "\n" not in str(caught.value)
        with occupied(tmp_path / "b", new_database()):
            pass
    with occupied(tmp_path / "b", url):
        pass


def test_a_killed_server_leaves_no_lock(new_database: NewDatabase) -> None:
    url = new_database()
    context = multiprocessing.get_context("spawn")
    held = context.Event()
    process = context.Process(target=hold, args=(url, held))
    process.start()
    try:
        assert held.wait(30)
        with pytest.raises(StorageError, match=f"process {process.pid} on"), ServedDatabase(url):
            pytest.fail("held twice")
    finally:
        process.kill()
        process.join()
    with ServedDatabase(url):
        pass


def hold(url: str, held: Event) -> None:
    with ServedDatabase(url):
        held.set()
        time.sleep(60)


def test_the_lock_is_reacquired_after_a_lost_connection(
    new_database: NewDatabase, server: PrivateServer
) -> None:
    url = new_database()
    of_it = connections(url)
    with ServedDatabase(url, look_s=0.05):
        before = server.run(of_it.format("pid"))
        server.run(of_it.format("pg_terminate_backend(pid)"))
        until(lambda: server.run(of_it.format("pid")) not in ("", before))
        with pytest.raises(StorageError, match=HERE), ServedDatabase(url):
            pytest.fail("held twice")
    with ServedDatabase(url):
        pass


def connections(url: str) -> str:
    return f"SELECT {{}} FROM pg_stat_activity WHERE datname = '{database_url(url).database}'"


def test_losing_the_lock_to_another_server_is_logged_once(
    new_database: NewDatabase, server: PrivateServer
) -> None:
    url = new_database()
    # Whatever log output another test of this process has set up.
    with capture_logs() as said, ServedDatabase(url, look_s=0.3):
        server.run(connections(url).format("pg_terminate_backend(pid)"))
        with ServedDatabase(url):
            time.sleep(1.2)
    assert [each["event"] for each in said].count("database_served_by_another") == 1


def test_the_lock_is_looked_after_whatever_fails(
    new_database: NewDatabase, monkeypatch: pytest.MonkeyPatch
) -> None:
    take, failed, again = ServedDatabase._take, threading.Event(), threading.Event()

    def take_later(self: ServedDatabase) -> bool:
        if not failed.is_set():
            failed.set()
            raise InvalidRequestError("on purpose")
        taken = take(self)
        again.set()
        return taken

    url = new_database()
    with capture_logs() as said, ServedDatabase(url, look_s=0.05):
        monkeypatch.setattr(ServedDatabase, "_take", take_later)
        assert again.wait(10)
        with pytest.raises(StorageError, match=HERE), ServedDatabase(url):
            pytest.fail("held twice")
    assert [each["event"] for each in said].count("database_lock_check_failed") == 1


def test_a_missing_database_server_is_reported_and_a_lost_one_awaited(
    tmp_path: Path, server: PrivateServer
) -> None:
    del server
    with private_server() as mine:
        mine.run("CREATE DATABASE kept")
        url = mine.url("kept")
        with ServedDatabase(url, look_s=0.05):
            mine.stop()
            time.sleep(0.3)
            mine.start()
            locks = "SELECT count(*) FROM pg_locks WHERE locktype = 'advisory'"
            until(lambda: mine.run(locks) == "1")
        mine.stop()
        with pytest.raises(StorageUnreachable, match="cannot be reached"), occupied(tmp_path, url):
            pytest.fail("held without a server")
