"""Damaged streams of live truth, from wire to samples: finite and increasing, or dropped."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from observer.truth.live.vicon_stream import ViconObject, ViconStreamError, unpack_frame
from observer.truth.live.vrpn import (
    COOKIE,
    POSE_TYPE,
    SENDER_DESCRIPTION,
    TYPE_DESCRIPTION,
    Conversation,
    Message,
    VrpnError,
    check_cookie,
    describe,
    pack,
)

from ....damage import damaged, examples, hostile_bytes, read_or_refused
from .vicon_sender import pack_frame
from .vrpn_server import pose_body

POSE = pose_body(0, (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0))
VRPN = b"".join(
    map(pack, (
        describe(SENDER_DESCRIPTION, 0, "robot"), describe(TYPE_DESCRIPTION, 0, POSE_TYPE),
        *(Message(100 + k, 5, 0, 0, POSE) for k in range(3)),
    ))
)  # fmt: skip
VICON = pack_frame(7, [ViconObject("robot", (1.0, 2.0, 3.0), (0.1, 0.2, 0.3))])


@examples(60)
@given(damaged([VRPN]) | hostile_bytes((VRPN[:40],)), st.integers(1, 60))
def test_damaged_vrpn_is_refused_or_parsed(content: bytes, size: int) -> None:
    conversation = Conversation()

    def feed() -> None:
        for at in range(0, len(content), size):
            conversation.feed(content[at : at + size])

    read_or_refused(feed, VrpnError)
    assert all(isinstance(name, str) for name in conversation.senders)


@examples(40)
@given(damaged([COOKIE]) | hostile_bytes((COOKIE,)))
def test_any_cookie_gives_at_most_a_one_line_note(cookie: bytes) -> None:
    note = read_or_refused(lambda: check_cookie(cookie), VrpnError)
    assert note is None or len(note.splitlines()) == 1


@examples(40)
@given(damaged([VICON]) | hostile_bytes((VICON,)))
def test_damaged_datagram_is_refused_or_parsed(content: bytes) -> None:
    read_or_refused(lambda: unpack_frame(content), ViconStreamError)
