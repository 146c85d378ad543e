"""A server with a drive process."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import Any

import pytest

from app.server import Server
from app.storage import Storage

from ..servers import started


@pytest.fixture
async def server(peer: Any, drive: Any, storage: Storage) -> AsyncIterator[Server]:
    """A server with a drive process, over a source without robots."""
    async with started(peer, storage, drive=drive) as server:
        yield server
