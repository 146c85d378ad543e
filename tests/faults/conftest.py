"""The whole system, shared by the tests of one file."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from ..leftovers import no_process_left_behind
from .bench import served, wait_until
from .system import System
from .web import CANARY, Web, living


@pytest.fixture(scope="module", autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    """Replace the check after every test: the system outlives the single test."""
    with no_process_left_behind():
        yield


@pytest.fixture(scope="module")
def system(
    tmp_path_factory: pytest.TempPathFactory, _nothing_left_behind: None
) -> Iterator[System]:
    with System(tmp_path_factory.mktemp("faults")).running() as system:
        yield system


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The server's data folder, with a canary file beside it."""
    folder = tmp_path_factory.mktemp("web")
    (folder / "canary").write_text(CANARY)
    return folder / "data"


@pytest.fixture(scope="module")
def web(data: Path, _nothing_left_behind: None) -> Iterator[Web]:
    """A server of the simulated lab; the same processes must still serve in the end."""
    with served(data, "simulated:lab") as server:
        web = Web(server)

        def ready() -> bool:
            observed = web.http.get("/api/status").json()["frames_observed"] > 20
            return observed and web.http.get("/viewer/").is_success

        wait_until("a preview and the viewer", ready, 60.0)
        processes = living(web)
        with contextlib.closing(web):
            yield web
            assert living(web) == processes
            assert "Traceback" not in (data / "server.log").read_text()
