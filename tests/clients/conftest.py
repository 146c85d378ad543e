"""A run recorded by a real server, and what the command line makes of it: made once for all."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from app.cli import main
from app.client.server_process import running_server

# By then the moving robot is a confirmed obstacle, and clouds have been stored.
FRAMES = 30


@pytest.fixture(scope="session")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``recording.mcap`` with JPEG images of a finished run in the simulated lab."""
    path = tmp_path_factory.mktemp("clients") / "recording.mcap"
    with running_server("simulated:drive") as server:
        run = server.request("POST", "/api/runs", {"record": "jpeg"})["id"]
        until = time.monotonic() + 60
        while server.request("GET", f"/api/runs/{run}")["frames"] < FRAMES:
            assert time.monotonic() < until, "the run does not go on"
            time.sleep(0.1)
        server.request("POST", f"/api/runs/{run}/stop")
        shutil.copyfile(server.data / "runs" / run / "recording.mcap", path)
    return path


@pytest.fixture(scope="session")
def command() -> Callable[..., None]:
    """``command(*arguments)``: run the command line in this process; it must succeed."""

    def run(*arguments: str | Path) -> None:
        with pytest.raises(SystemExit) as left:
            main([str(each) for each in arguments])
        assert not left.value.code

    return run


@pytest.fixture(scope="session")
def lossless(recording: Path, command: Callable[..., None]) -> Path:
    """The beginning of the run, observed again and recorded losslessly."""
    path = recording.with_name("lossless.mcap")
    lines = recording.with_name("lossless.jsonl")
    command(
        *("observe", recording, "--frames", "4", "--output", lines),
        *("--record", path, "--record-images", "lossless"),
    )
    return path
