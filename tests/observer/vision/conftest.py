"""A rectified pair without faults."""

from __future__ import annotations

import pytest

from .image_pairs import Pair, scene


@pytest.fixture
def pair() -> Pair:
    return scene("lateral")[1][0]
