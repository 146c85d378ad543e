"""Vicon's datagrams: what Tracker sends is read, anything else is refused with a reason."""

from __future__ import annotations

import contextlib
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.truth.live.vicon_stream import (
    ViconObject,
    ViconStreamError,
    unpack_frame,
)

from .vicon_sender import pack_frame

_finite = st.floats(allow_nan=False, allow_infinity=False)
_triples = st.tuples(_finite, _finite, _finite)
_names = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=24)
_objects = st.lists(st.builds(ViconObject, _names, _triples, _triples), max_size=6)


def test_hand_written_datagram_is_read() -> None:
    data = struct.pack("<IB", 1234, 1) + struct.pack("<BH", 0, 72)
    data += b"Amigo".ljust(24, b"\0") + struct.pack("<6d", 1000, -2, 3, 0.1, 0.2, 0.3)
    amigo = ViconObject("Amigo", (1000, -2, 3), (0.1, 0.2, 0.3))
    assert unpack_frame(data) == (1234, (amigo,))
    assert len(data) == 80


@given(st.integers(0, 2**32 - 1), _objects, st.integers(0, 1024))
def test_packed_frames_are_read_back(frame: int, objects: list[ViconObject], filling: int) -> None:
    assert unpack_frame(pack_frame(frame, objects, filling)) == (frame, tuple(objects))


@given(st.integers(1, 255), st.integers(0, 300), st.integers(0, 40))
def test_other_and_larger_items_are_skipped_by_their_size(kind: int, size: int, more: int) -> None:
    body = b"Cart".ljust(24, b"\0") + struct.pack("<6d", 1, 2, 3, 4, 5, 6)
    data = struct.pack("<IB", 5, 2) + struct.pack("<BH", kind, size) + bytes(size)
    data += struct.pack("<BH", 0, 72 + more) + body + bytes(more)
    assert [each.name for each in unpack_frame(data)[1]] == ["Cart"]


@given(st.binary(max_size=400))
def test_garbage_is_refused_or_harmless(data: bytes) -> None:
    with contextlib.suppress(ViconStreamError):
        assert len(unpack_frame(data)[1]) <= 255


@given(_objects.filter(bool), st.data())
def test_truncated_datagram_is_refused(objects: list[ViconObject], data: st.DataObject) -> None:
    whole = pack_frame(1, objects)
    with pytest.raises(ViconStreamError):
        unpack_frame(whole[: data.draw(st.integers(0, len(whole) - 1))])


def test_too_small_object_is_refused() -> None:
    data = struct.pack("<IB", 5, 1) + struct.pack("<BH", 0, 71) + bytes(71)
    with pytest.raises(ViconStreamError, match="72 bytes"):
        unpack_frame(data)
