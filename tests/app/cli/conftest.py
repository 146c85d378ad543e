"""The command line in the test's own process, and a scripted server for commands that need one."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from .scripted_server import ScriptedServer, running
from .shell import Shell


@pytest.fixture
def server() -> Iterator[ScriptedServer]:
    with running(ScriptedServer()) as script:
        yield script


@pytest.fixture
def shell(capsys: pytest.CaptureFixture[str]) -> Shell:
    """``shell(*arguments)``: run a command and return how it ended."""
    return Shell(capsys)
