"""Scenes with served robots, closed after the test."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing

import pytest

from .lab import Lab, MakeLab


@pytest.fixture
def make_lab() -> Iterator[MakeLab]:
    """Labs that are closed after the test, however it ends."""
    with ExitStack() as stack:
        yield lambda *of_it, **named: stack.enter_context(closing(Lab(*of_it, **named)))


@pytest.fixture
def lab(make_lab: MakeLab) -> Lab:
    return make_lab()
