"""Lines of a custom robot: what is accepted, and that nothing else does harm."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.robots.contract import RobotLimits
from observer.robots.network.messages import (
    LONGEST_LINE,
    BadMessage,
    Lines,
    Permit,
    parse_hello,
    parse_odometry,
    permit_line,
)

HELLO: dict[str, Any] = {
    "type": "hello", "protocol": 1, "name": "Robbie", "mode": "guarded", "key": "k",
    "limits": {"speed_mps": 0.5, "turn_rate_radps": 1, "acceleration_mps2": 0.4,
               "turn_acceleration_radps2": 2.0},
    "outline": {"radius_m": 0.3, "width_m": 0.4, "length_m": 0.5},
}  # fmt: skip
ODOMETRY: dict[str, Any] = {
    "type": "odometry", "sequence": 7, "time": 1.5, "x": 0.1, "y": -2, "yaw": 0.3,
    "speed_mps": 0.2, "turn_rate_radps": 0.0, "enabled": True, "permit": 3,
}  # fmt: skip


def line(message: dict[str, Any], **changes: Any) -> bytes:
    return json.dumps({**message, **changes}).encode()


def test_hello_and_odometry_are_parsed() -> None:
    hello = parse_hello(line(HELLO, more="is ignored"))
    assert (hello.name, hello.mode, hello.key) == ("Robbie", "guarded", "k")
    assert hello.limits == RobotLimits(0.5, 1.0, 0.4, 2.0)
    assert (hello.radius_m, hello.width_m, hello.length_m) == (0.3, 0.4, 0.5)
    told = parse_odometry(line(ODOMETRY))
    assert (told.sequence, told.time, told.x, told.y, told.yaw) == (7, 1.5, 0.1, -2, 0.3)
    assert (told.wanted, told.battery_v, told.fault) == (None, None, None)
    wanted = {"speed_mps": 0.4, "turn_rate_radps": -1}
    more = parse_odometry(line(ODOMETRY, wanted=wanted, battery_v=12.1, fault="a bumper"))
    assert (more.wanted, more.battery_v, more.fault) == ((0.4, -1.0), 12.1, "a bumper")


def without(message: dict[str, Any], key: str) -> bytes:
    return json.dumps({k: v for k, v in message.items() if k != key}).encode()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (line(HELLO, type="odometry"), 'expected a message with "type": "hello"'),
        (line(HELLO, protocol=2), "protocol must be 1"),
        (line(HELLO, protocol=True), "protocol must be 1"),
        (line(HELLO, mode="free"), "driven or guarded"),
        (line(HELLO, key=5), "key must be text"),
        (line(HELLO, name="a\nb"), "name must be 1 to 200 printable"),
        (line(HELLO, name=""), "name must be 1 to 200 printable"),
        (line(HELLO, limits=[]), "limits must be an object"),
        (line(HELLO, limits={**HELLO["limits"], "speed_mps": 0}), "speed_mps must be above 0"),
        (line(HELLO, limits={"speed_mps": 1}), "turn_rate_radps must be a finite number"),
        (line(HELLO, outline={**HELLO["outline"], "width_m": True}), "width_m must be a finite"),
        (b"[]", "expected a message"),
        (b"nonsense", "one JSON object on one line"),
        (b"\xff\xfe", "one JSON object on one line"),
        (2000 * b"[", "one JSON object on one line"),
        (b'{"type": "hello", "protocol": ' + 4000 * b"9" + b"}", "protocol must be 1"),
    ],
)
def test_an_invalid_hello_is_refused(text: bytes, sentence: str) -> None:
    with pytest.raises(BadMessage, match=sentence):
        parse_hello(text)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        *((without(ODOMETRY, key), key) for key in ODOMETRY),
        (line(ODOMETRY, sequence=-1), "sequence must be a whole number"),
        (line(ODOMETRY, sequence=1.5), "sequence must be a whole number"),
        (line(ODOMETRY, sequence=True), "sequence must be a whole number"),
        (line(ODOMETRY, x=float("nan")), "x must be a finite number"),
        (line(ODOMETRY, x="1"), "x must be a finite number"),
        (line(ODOMETRY).replace(b"0.1", b"1e999"), "x must be a finite number"),
        (line(ODOMETRY, yaw=10**400), "yaw must be a finite number"),
        (line(ODOMETRY, speed_mps=101), r"speed_mps must be a finite number within ±100"),
        (line(ODOMETRY, enabled=1), "enabled must be true or false"),
        (line(ODOMETRY, wanted=[1, 2]), "wanted must be an object"),
        (line(ODOMETRY, wanted={"speed_mps": 1}), "wanted: turn_rate_radps must be"),
        (line(ODOMETRY, fault=3), "fault must be 1 to 200"),
    ],
)
def test_invalid_odometry_is_refused(text: bytes, sentence: str) -> None:
    with pytest.raises(BadMessage, match=sentence):
        parse_odometry(text)


@given(st.binary(max_size=300))
def test_arbitrary_bytes_are_refused(data: bytes) -> None:
    for parse in (parse_hello, parse_odometry):
        with pytest.raises(BadMessage):
            parse(data)


scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.just([]),
    st.just({}),
)  # fmt: skip


@given(st.sampled_from(sorted(ODOMETRY)), scalars)
def test_a_damaged_value_is_refused_or_finite(key: str, value: Any) -> None:
    try:
        told = parse_odometry(line(ODOMETRY, **{key: value}))
    except BadMessage:
        return
    assert all(abs(each) <= 1e6 for each in (told.x, told.y, told.yaw, told.speed_mps))


@given(st.lists(st.binary(min_size=1, max_size=20).filter(lambda b: b.strip() and b"\n" not in b)),
       st.lists(st.integers(1, 7)))  # fmt: skip
def test_lines_are_reassembled_however_they_are_split(sent: list[bytes], cuts: list[int]) -> None:
    data = b"".join(each + b"\n" for each in sent)
    lines, taken = Lines(), []
    for cut in (*cuts, len(data) + 1):
        taken += list(lines.feed(data[:cut]))
        data = data[cut:]
    assert taken == sent


def test_an_endless_line_is_refused() -> None:
    lines = Lines()
    assert list(lines.feed(b"x" * LONGEST_LINE)) == []
    with pytest.raises(BadMessage, match="at most 4096 bytes"):
        list(lines.feed(b"x"))


def test_a_permit_is_written_with_all_its_fields() -> None:
    text = permit_line(Permit(0.2, -0.1, False, "half a metre left"), 12, 34.5678901, 0.25)
    assert text.endswith(b"\n")
    assert json.loads(text) == {
        "type": "permit", "sequence": 12, "time": 34.56789, "speed_mps": 0.2,
        "turn_rate_radps": -0.1, "stop": False, "reason": "half a metre left", "expires_ms": 250,
    }  # fmt: skip
