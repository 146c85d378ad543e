"""Textures are painted once for all tests here; equal materials are guaranteed to look equal."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import pytest

from observer.simulation import rendering


@pytest.fixture(scope="module", autouse=True)
def painted_once() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rendering, "paint", lru_cache(maxsize=300)(vars(rendering)["paint"]))
        yield
