"""Bodies of which hardly any part is in front of the camera."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from observer.simulation import visibility
from observer.simulation.scenarios import load_scenario
from observer.simulation.visibility import visible_parts
from observer.simulation.world import World


@pytest.mark.parametrize("high", [(0.1, 0.2), (0.3, 0.1), (0.1, 0.1)])
def test_a_body_with_only_an_edge_in_view_is_not_seen(
    monkeypatch: pytest.MonkeyPatch, high: Any
) -> None:
    world = World(load_scenario("lab"))
    assert any(part.share > 0 for part in visible_parts(world, 1.0).values())
    edge = (np.array([0.1, 0.1]), np.array(high))
    monkeypatch.setattr(visibility._SeenBody, "window", lambda _: edge)
    for part in visible_parts(world, 1.0).values():
        assert (part.share, part.box_px) == (0.0, None)
