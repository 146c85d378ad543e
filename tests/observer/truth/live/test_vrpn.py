"""VRPN's bytes: what the public library writes is read, and nothing else breaks us."""

from __future__ import annotations

import contextlib
import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.truth.live.vrpn import (
    COOKIE,
    PING_TYPE,
    POSE_TYPE,
    Conversation,
    Message,
    MessageParser,
    Sign,
    Speaker,
    TrackerPose,
    VrpnError,
    check_cookie,
    describe,
    pack,
)

from .vrpn_server import pose_body

_words = st.integers(0, 2**32 - 1)
_numbers = st.integers(-(2**31), 2**31 - 1)
_messages = st.builds(Message, _words, _words, _numbers, _numbers, st.binary(max_size=200))
_names = st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=20)
_finite = st.floats(allow_nan=False, allow_infinity=False)


def split(data: bytes, cuts: list[int]) -> list[bytes]:
    at = sorted({min(each, len(data)) for each in cuts} | {0, len(data)})
    return [data[a:b] for a, b in pairwise(at)]


def test_messages_match_the_public_library_byte_for_byte() -> None:
    # Typed by hand, as marshall_message of vrpn_Connection.C lays them out.
    assert COOKIE == b"vrpn: ver. 07.35  0\0\0\0\0\0"
    described = pack(describe(-1, 3, "Robot"), sequence=1)
    assert described == bytes.fromhex(
        "00000022 00000000 00000000 00000003 ffffffff 00000001 00000006 526f626f74 00".replace(
            " ", ""
        )
    ) + bytes(6)
    pose = pack(Message(7, 8, 3, 5, pose_body(2, (1, 2, 3, 0, 0, 0, 1))), sequence=9)
    assert pose == struct.pack(">iiiiii", 24 + 64, 7, 8, 3, 5, 9) + struct.pack(
        ">ii7d", 2, 0, 1, 2, 3, 0, 0, 0, 1
    )


@given(st.lists(_messages, max_size=8), st.lists(st.integers(0, 2000), max_size=12))
def test_messages_are_parsed_however_they_are_split(sent: list[Message], cuts: list[int]) -> None:
    parser = MessageParser()
    data = b"".join(pack(each, number) for number, each in enumerate(sent))
    assert [each for piece in split(data, cuts) for each in parser.feed(piece)] == sent


@given(_names, _names, st.integers(0, 99), st.lists(_finite, min_size=7, max_size=7), _words)
def test_described_sensor_is_reported_by_name(
    sender: str, other: str, sensor: int, numbers: list[float], seconds: int
) -> None:
    conversation = Conversation()
    body = pose_body(sensor, tuple(numbers))
    data = pack(Message(seconds, 5, 7, 4, body))
    assert conversation.feed(data) == []  # 7 and 4 are not described yet
    begin = pack(describe(-1, 2, other)) + pack(describe(-1, 7, sender))
    begin += pack(describe(-2, 4, POSE_TYPE)) + pack(Message(0, 0, 40_000, -3, b"10.0.0.1\0"))
    assert conversation.feed(begin) == []
    (pose,) = conversation.feed(data)
    assert isinstance(pose, TrackerPose)
    assert (pose.sender, pose.sensor, pose.time) == (sender, sensor, seconds + 5 / 1e6)
    assert (*pose.position, *pose.quaternion) == tuple(numbers)


def test_redescribed_sender_gets_its_new_name() -> None:
    conversation = Conversation()
    conversation.feed(pack(describe(-1, 0, "before")) + pack(describe(-2, 0, POSE_TYPE)))
    conversation.feed(pack(describe(-1, 0, "after")))
    (pose,) = conversation.feed(pack(Message(1, 0, 0, 0, pose_body(0, (0.0,) * 7))))
    assert isinstance(pose, TrackerPose)
    assert pose.sender == "after"


@given(st.lists(st.binary(max_size=300), max_size=6))
def test_garbage_is_refused_or_ignored(pieces: list[bytes]) -> None:
    conversation = Conversation()
    with contextlib.suppress(VrpnError):
        for piece in pieces:
            conversation.feed(piece)


@given(st.lists(_messages, min_size=1, max_size=4), st.data())
def test_flipped_byte_raises_at_most_a_vrpn_error(sent: list[Message], data: st.DataObject) -> None:
    whole = bytearray(b"".join(pack(each) for each in sent))
    at = data.draw(st.integers(0, len(whole) - 1))
    whole[at] ^= data.draw(st.integers(1, 255))
    begin = pack(describe(-1, 0, "a")) + pack(describe(-2, 0, POSE_TYPE))
    with contextlib.suppress(VrpnError):
        Conversation().feed(begin + bytes(whole))


@pytest.mark.parametrize("length", [-1, 0, 23, 24 + 64_001, 2**31 - 1])
def test_impossible_message_length_is_refused_at_once(length: int) -> None:
    with pytest.raises(VrpnError, match="length"):
        MessageParser().feed(struct.pack(">6i", length, 0, 0, 0, 0, 0))


def test_pose_of_wrong_length_is_refused() -> None:
    conversation = Conversation()
    conversation.feed(pack(describe(-1, 0, "a")) + pack(describe(-2, 0, POSE_TYPE)))
    with pytest.raises(VrpnError, match="64 bytes"):
        conversation.feed(pack(Message(0, 0, 0, 0, bytes(56))))


def test_names_beyond_the_librarys_tables_are_refused() -> None:
    conversation = Conversation()
    names = b"".join(pack(describe(-1, number, str(number))) for number in range(2001))
    with pytest.raises(VrpnError, match="2000"):
        conversation.feed(names)
    with pytest.raises(VrpnError, match="95 bytes"):
        describe(-1, 0, "x" * 96)
    assert len(pack(describe(-1, 0, "x" * 95))) == 24 + 104


def test_outgoing_types_and_senders_are_described_before_use() -> None:
    speaker, there = Speaker(), Conversation()
    assert there.feed(speaker.say(PING_TYPE, "Robot")) == [Sign(PING_TYPE, "Robot")]
    second = speaker.say(PING_TYPE, "Robot")
    assert len(second) == 24
    assert there.feed(second) == [Sign(PING_TYPE, "Robot")]
    assert there.feed(speaker.say(PING_TYPE, "Cart")) == [Sign(PING_TYPE, "Cart")]


def test_only_version_7_cookies_are_accepted() -> None:
    assert check_cookie(COOKIE) is None
    minor = check_cookie(b"vrpn: ver. 07.33  0".ljust(24, b"\0"))
    assert minor is not None
    assert "07.33" in minor
    with pytest.raises(VrpnError, match=r"06\.04"):
        check_cookie(b"vrpn: ver. 06.04  0".ljust(24, b"\0"))
    with pytest.raises(VrpnError, match="not a VRPN server"):
        check_cookie(b"SSH-2.0-OpenSSH_9.6\r\n\0\0\0")
