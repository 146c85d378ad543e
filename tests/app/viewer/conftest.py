"""The source that the 3D scene is tested with."""

from __future__ import annotations

from typing import Any

import pytest

from app.contract.commands import OpenSource


@pytest.fixture
def observed(peer: Any) -> Any:
    peer.start_process()
    peer._open(OpenSource("simulated:lab", None, {}, 0))
    return peer
