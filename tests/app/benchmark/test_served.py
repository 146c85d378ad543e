"""The measurement from outside, on a real server: short, since only its working is tested."""

from __future__ import annotations

import pytest

from app.benchmark.served import _dense_cloud_rates, _loop_rates
from app.benchmark.server_process import BenchmarkError, running_server


def test_a_served_loop_is_measured_alone_and_with_viewers_that_are_really_served() -> None:
    said: list[str] = []
    with running_server("simulated:lab") as server:
        server.wait_for_frames()
        rates = _loop_rates(server, 1.0, 2.0, 2, said.append)
        with pytest.raises(BenchmarkError, match="PUT /api/source was answered 422"):
            server.request("PUT", "/api/source", {"source": "simulated:moon"})
    assert rates.alone > 0
    assert rates.with_viewers > 0
    assert rates.failures == ()
    assert min(rates.scene_messages, rates.observation_messages, rates.image_messages) > 0
    assert len(said) == 2


def test_the_dense_cloud_is_measured_while_it_is_really_made() -> None:
    with running_server("simulated:lab") as server:
        server.wait_for_frames()
        rates = _dense_cloud_rates(server, 1.0, 2.0, lambda _: None)
    assert rates.without > 0
    assert rates.ratio == pytest.approx(rates.watched / rates.without)
    assert rates.clouds_per_s > 1.0, "a busy machine makes few, but not none"
    assert rates.age_s is not None
    assert rates.coarseness == 1
    assert rates.failures == ()


def test_a_source_that_cannot_be_opened_is_told_with_the_engines_reason() -> None:
    with running_server("simulated:moon") as server, pytest.raises(BenchmarkError, match="moon"):
        server.wait_for_frames(8.0)
