"""Bodies with wrong values, invalid JSON or numbers out of range: refused, and nothing changes."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
import time
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from app.contract.commands import SetParameters
from app.http.api.values import MOST_CHANGES
from observer.navigation.parameters import AllParameters

from ..wire import JSON

THRESHOLD = "ego_motion.ransac_threshold_px"
NO_NUMBERS = [
    *("NaN", "Infinity", "-Infinity", "1e999", "-1e999", "true", "1e5", "-1", '"2"'),
    *("null", "[]", "{}"),
]


async def test_values_that_are_not_numbers_in_range_are_refused(http: Any, peer: Any) -> None:
    before = (await http.get("/api/parameters")).json()
    for value in NO_NUMBERS:
        body = f'{{"{THRESHOLD}": {value}, "flow.window_px": 21}}'
        answer = await http.patch("/api/parameters", content=body, headers=JSON)
        assert answer.status_code == 422, value
        problems = answer.json()["detail"]
        assert all(set(problem) == {"loc", "msg", "type"} for problem in problems)
        assert any(THRESHOLD in problem["loc"] for problem in problems), value
        assert (await http.get("/api/parameters")).json() == before
    assert not any(isinstance(command, SetParameters) for command in peer.commands)


async def test_a_refused_parameter_is_reported_with_its_range(http: Any) -> None:
    answer = await http.patch("/api/parameters", json={THRESHOLD: 25.0, "flow.x": 1})
    detail = {problem["loc"][-1]: problem for problem in answer.json()["detail"]}
    assert detail[THRESHOLD] == {
        "loc": ["body", THRESHOLD],
        "msg": "must be a finite number from 0.1 to 20 px",
        "type": "parameter",
    }
    assert "no such parameter" in detail["flow.x"]["msg"]


async def test_a_missing_extra_is_reported_and_the_old_parameters_stay(
    serve: Any, peer: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "mahotas", None)

    async with serve() as served:
        before = (await served.http.get("/api/parameters")).json()
        change = {"features.detector": "surf", THRESHOLD: 2.5}
        answer = await served.http.patch("/api/parameters", json=change)
        assert answer.status_code == 422
        (problem,) = answer.json()["detail"]
        assert problem["loc"] == ["body", "features.detector"]
        assert "pip install 'dynamic-observer[surf]'" in problem["msg"]
        assert (await served.http.get("/api/parameters")).json() == before
        started = await served.http.post("/api/runs", json={"parameters": change})
        assert started.status_code == 422
        assert not any(isinstance(command, SetParameters) for command in peer.commands)


@pytest.mark.parametrize(
    ("method", "path", "wrap"),
    [
        ("PATCH", "/api/parameters", lambda changes: changes),
        ("POST", "/api/runs", lambda changes: {"parameters": changes}),
    ],
)
@pytest.mark.parametrize("count", [7000, MOST_CHANGES])
async def test_any_number_of_unknown_parameters_is_refused_quickly(
    http: Any, method: str, path: str, wrap: Any, count: int
) -> None:
    changes = {f"flow.window_pixels_{number}": 1 for number in range(count)}
    started = time.monotonic()
    asking = asyncio.create_task(http.request(method, path, json=wrap(changes)))
    stopping = http.post("/api/robots/stop")
    assert (await stopping).status_code == 200
    stopped = time.monotonic()
    assert (await asking).status_code == 422
    # Guessing the intended name for each of them took 8 s.
    assert stopped - started < 4.0


def test_all_parameters_may_be_changed_at_once() -> None:
    assert len(AllParameters().flat()) <= MOST_CHANGES


async def test_an_unread_body_is_cut_off_after_the_response(served: Any) -> None:
    reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
    token = served.http.headers["Authorization"]
    head = (
        f"POST /api/parameters HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: {token}\r\n"
        "Content-Type: application/json\r\nTransfer-Encoding: chunked\r\n\r\n"
    )
    writer.write(head.encode())
    chunk, sent = b"10000\r\n" + b"x" * 0x10000 + b"\r\n", 0
    async with asyncio.timeout(10.0):
        writer.write(chunk)
        answer = (await reader.readuntil(b"\r\n\r\n")).decode()
        with contextlib.suppress(ConnectionError):
            while sent < 200 * 2**20:
                writer.write(chunk)
                await writer.drain()
                sent += len(chunk)
    writer.close()
    assert answer.startswith("HTTP/1.1 405")
    assert "connection: close" in answer.lower()
    assert sent < 100 * 2**20


BAD_VALUES = [
    ("/api/playback", "POST", '{"rate": NaN}'),
    ("/api/playback", "POST", '{"rate": 1e999}'),
    ("/api/playback", "POST", '{"rate": true}'),
    ("/api/playback", "POST", '{"rate": 9}'),
    ("/api/playback", "POST", '{"rate": "1"}'),
    ("/api/playback", "POST", '{"step": -1}'),
    ("/api/playback", "POST", '{"step": 1.5}'),
    ("/api/playback", "POST", '{"paused": 1}'),
    ("/api/playback", "POST", '{"unknown": 1}'),
    ("/api/runs", "POST", '{"parameters": {"flow.window_px": NaN}}'),
    ("/api/runs", "POST", '{"parameters": {"flow.window_px": 10000}}'),
    ("/api/runs", "POST", '{"preset": "none of this name"}'),
    ("/api/runs", "POST", '{"name": ""}'),
    ("/api/runs", "POST", '{"name": "two\\nlines"}'),
    ("/api/runs", "POST", '{"name": "\\ud800"}'),
    ("/api/runs", "POST", '{"\\ud800": 1}'),
    ("/api/runs", "POST", '{"source": "missing"}'),
    ("/api/runs", "POST", '{"calibration": "none"}'),
    ("/api/source", "PUT", '{"source": "missing"}'),
    ("/api/source", "PUT", '{"source": "a\\u0000b"}'),
    ("/api/source", "PUT", '{"source": "simulated:lab", "calibration": "none"}'),
    ("/api/source", "PUT", "{}"),
    ("/api/source", "PUT", "[]"),
    ("/api/source", "PUT", "null"),
    ("/api/source", "PUT", ""),
    ("/api/presets", "POST", '{"name": "\\u0000"}'),
    ("/api/presets", "POST", '{"name": 1}'),
    ("/api/presets", "POST", '{"name": Infinity}'),
    ("/api/calibrations", "POST", "{}"),
]


async def test_bad_values_are_answered_with_422(http: Any, peer: Any) -> None:
    opened = peer.opened
    for path, method, body in BAD_VALUES:
        answer = await http.request(method, path, content=body, headers=JSON)
        assert answer.status_code == 422, (path, body, answer.text)
        assert answer.json()["detail"][0]["loc"][0] == "body", body
        assert peer.opened == opened
        assert (await http.get("/api/runs")).json() == []
    assert (await http.get("/api/parameters")).json()["revision"] == 0


MALFORMED = {
    "cut": b"{",
    "no text": b"\xff\xfe\x00",
    "deep object": b'{"a": ' * 20_000,
    "deep list": b"[" * 100_000,
    "long number": b"9" * 100_000,
    "huge rate": b'{"rate": 1' + b"0" * 5000 + b"}",
    "long key": b'{"' + b"a" * 50_000 + b'": 1}',
}


async def test_malformed_and_deeply_nested_json_is_a_client_error(http: Any) -> None:
    for name, body in MALFORMED.items():
        for method, path in (("PATCH", "/api/parameters"), ("POST", "/api/playback")):
            answer = await http.request(method, path, content=body, headers=JSON)
            assert 400 <= answer.status_code < 500, (name, answer.text)
            assert len(answer.content) < 5000
    assert (await http.get("/api/status")).is_success


ANY_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.deferred(lambda: st.sampled_from(KNOWN_KEYS)) | st.text(max_size=10),
            inner,
            max_size=4,
        )
    ),
    max_leaves=8,
)
TAKE_JSON = [
    ("PATCH", "/api/parameters"),
    ("POST", "/api/playback"),
    ("POST", "/api/presets"),
    ("POST", "/api/runs"),
    ("PUT", "/api/source"),
    ("POST", "/api/calibrating"),
    ("PATCH", "/api/calibrating"),
    ("POST", "/api/calibrating/compute"),
    ("POST", "/api/calibrating/save"),
    ("PATCH", "/api/calibrations/none"),
    ("POST", "/api/calibrations/none/tape-checks"),
    ("PUT", "/api/rig"),
    ("PUT", "/api/rig/file"),
]
KNOWN_KEYS: list[str] = [
    *("name", "source", "rate", "step", "preset", "parameters", THRESHOLD),
    *("square_mm", "columns", "capture", "remove", "automatic", "activate", "u", "v"),
    *("measured_m", "mount", "height_m", "value", "sigma", "models", "text"),
]


@settings(
    max_examples=100,
    # All examples go to the same server.
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(route=st.sampled_from(TAKE_JSON), value=ANY_JSON)
async def test_no_json_causes_a_server_error(http: Any, route: tuple[str, str], value: Any) -> None:
    body = json.dumps(value)
    answer = await http.request(*route, content=body, headers=JSON)
    assert answer.status_code < 500, (route, body, answer.text)
