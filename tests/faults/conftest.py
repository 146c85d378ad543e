"""Everything together, for the tests of one file."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from ..leftovers import no_process_left_behind
from .system import System


@pytest.fixture(scope="module", autouse=True)
def _nothing_left_behind() -> Iterator[None]:
    """In place of the check after every test: the system outlives the single test."""
    with no_process_left_behind():
        yield


@pytest.fixture(scope="module")
def system(
    tmp_path_factory: pytest.TempPathFactory, _nothing_left_behind: None
) -> Iterator[System]:
    with System(tmp_path_factory.mktemp("faults")).running() as system:
        yield system
