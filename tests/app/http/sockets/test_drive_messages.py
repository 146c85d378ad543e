from __future__ import annotations

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.http.sockets.connections import BadMessage
from app.http.sockets.drive_messages import (
    Command,
    Pong,
    Release,
    Stop,
    Take,
    Unusable,
    read_message,
)

DRIVE: dict[str, Any] = {
    "type": "drive",
    "role": "observer",
    "sequence": 3,
    "time": 1500.5,
    "speed_mps": 0.2,
    "turn_rate_radps": -1,
}


def read(**changes: Any) -> Any:
    return read_message(json.dumps({**DRIVE, **changes}))


def test_messages_from_a_page_are_parsed() -> None:
    assert read() == Command("observer", 3, 1.5005, (0.2, -1.0))
    assert read(type="present") == Command("observer", 3, 1.5005, None)
    assert read_message('{"type": "take", "role": "obstacle"}') == Take("obstacle", False)
    assert read_message('{"type": "take", "role": "obstacle", "takeover": true}') == Take(
        "obstacle", True
    )
    assert read_message('{"type": "release", "role": "obstacle"}') == Release("obstacle")
    assert read_message('{"type": "stop"}') == Stop()
    assert read_message('{"type": "pong", "id": 4, "time": 250}') == Pong(4, 0.25)


@pytest.mark.parametrize("key", ["sequence", "time", "speed_mps", "turn_rate_radps"])
@pytest.mark.parametrize(
    "value", ["NaN", "Infinity", "-Infinity", "1e999", "true", '"1"', "null", "[]", "1" * 400]
)
def test_a_command_with_an_invalid_number_is_unusable(key: str, value: str) -> None:
    text = json.dumps({**DRIVE, key: "HERE"}).replace('"HERE"', value)
    found = read_message(text)
    assert isinstance(found, Unusable)
    assert key in found.sentence
    assert found.role == "observer"
    assert found.sequence == (None if key == "sequence" else 3)
    missing = {name: each for name, each in DRIVE.items() if name != key}
    assert isinstance(read_message(json.dumps(missing)), Unusable)


@pytest.mark.parametrize("role", [None, "driver", 1, ["observer"], {}])
def test_a_command_without_a_valid_role_is_unusable(role: Any) -> None:
    assert read(role=role) == Unusable(None, 3, "role must be observer or obstacle")


@pytest.mark.parametrize("sequence", [-1, 1.5, 2**53 + 1])
def test_an_invalid_sequence_is_unusable(sequence: float) -> None:
    assert isinstance(read(sequence=sequence), Unusable)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "stop",
        "[1]",
        "null",
        '{"type": "other"}',
        '{"type": ["stop"]}',
        '{"type": "take", "role": "driver"}',
        '{"type": "take", "role": "observer", "takeover": 1}',
        '{"type": "release"}',
        '{"type": "pong", "id": 1}',
        '{"type": "pong", "id": true, "time": 1}',
        '{"type": "pong", "id": 1, "time": NaN}',
        "[" * 900,
        " " * 1001,
    ],
)
def test_garbage_is_a_bad_message(text: str) -> None:
    with pytest.raises(BadMessage):
        read_message(text)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(list(DRIVE)), inner, max_size=4)
    ),
    max_leaves=8,
)


@given(
    st.dictionaries(st.sampled_from(list(DRIVE)), _JSON),
    st.sampled_from(["drive", "present", "take", "release", "pong", "stop", "x"]),
)
def test_every_parsed_command_is_finite(more: dict[str, Any], kind: str) -> None:
    try:
        found = read_message(json.dumps({**more, "type": kind}))
    except BadMessage:
        return
    if isinstance(found, Command):
        numbers = (found.stamp, *(found.velocity or ()))
        assert all(isinstance(number, float) and math.isfinite(number) for number in numbers)
        assert found.role in ("observer", "obstacle")
