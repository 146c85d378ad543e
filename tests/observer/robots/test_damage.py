"""Damaged bytes from robots: packets, settings and lines are read or refused."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.robots.arcos import Command, PacketParser, command, decode_command, packet
from observer.robots.config_reply import decode_config
from observer.robots.models import robot_spec
from observer.robots.network.messages import (
    LONGEST_LINE,
    BadMessage,
    Lines,
    parse_hello,
    parse_odometry,
)
from observer.robots.sip import decode_status

from ...damage import assert_one_sentence, damaged, examples, hostile_bytes, read_or_refused
from .network.test_messages import HELLO, ODOMETRY

CONFIG = (
    b"\x20Pioneer\0p3dx-sh\0000000\0" + bytes(13) + b"robot\0" + bytes(range(60))
)  # fmt: skip
STATUS = bytes((0x32,)) + bytes(range(1, 40))
STREAM = b"".join((command(Command.ENABLE, 1), command(Command.VEL, -300),
                   packet(STATUS), packet(CONFIG)))  # fmt: skip
NETWORK = tuple(json.dumps(each).encode() for each in (HELLO, ODOMETRY))


@examples(60)
@given(damaged([STREAM]) | hostile_bytes((STREAM, b"\xfa\xfb", b"\xfa\xfb\xff")),
       st.integers(1, 60))  # fmt: skip
def test_any_bytes_on_the_line_are_decoded_or_refused(content: bytes, size: int) -> None:
    parser = PacketParser()
    payloads = []
    for at in range(0, len(content), size):
        payloads += parser.feed(content[at : at + size])
    payloads += parser.abandon()
    for payload in (*payloads, content[:253]):
        for decode in (decode_command, decode_config):
            read_or_refused(lambda decode=decode, of=payload: decode(of), ValueError)  # type: ignore[misc]
        status = read_or_refused(
            lambda of=payload: decode_status(of, robot_spec("p3dx-sh"), 5, 5),  # type: ignore[misc]
            ValueError,
        )
        if status is not None:
            assert math.isfinite(status.speed_mps + status.turn_rate_radps)
            assert all(each is None or 0 <= each < 100 for each in status.ranges_m.values())


@pytest.mark.parametrize("parse", [parse_hello, parse_odometry])
@examples(60)
@given(damaged(NETWORK, (b"null", b"[]", b"{}", b'"x": ')) | hostile_bytes(NETWORK))
def test_damaged_messages_of_a_network_robot_are_refused_or_finite(parse, content: bytes) -> None:  # type: ignore[no-untyped-def]
    told = read_or_refused(lambda: parse(content), BadMessage)
    if told is None:
        return
    numbers = [each for each in vars(told).values() if isinstance(each, float)]
    assert all(map(math.isfinite, numbers))


@examples(40)
@given(st.lists(hostile_bytes((b"\n", b"x" * LONGEST_LINE)), max_size=4))
def test_lines_stay_short_or_are_refused(pieces: list[bytes]) -> None:
    lines = Lines()
    try:
        for piece in pieces:
            for line in lines.feed(piece):
                assert len(line) <= LONGEST_LINE
    except BadMessage as error:
        assert_one_sentence(str(error))
