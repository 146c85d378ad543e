"""Bytes to packets and back, with any splitting, garbage and damage."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from observer.robots.arcos import (
    Command,
    Decoded,
    PacketParser,
    checksum,
    command,
    decode_command,
    packet,
)

SIP = bytes.fromhex("fafb21320000000000000000000090fefe00000000000204007d07007d05005930f011b4")


@pytest.mark.parametrize(
    ("made", "hexadecimal"),
    [
        (command(0), "fafb03000000"),
        (command(1), "fafb03010001"),
        (command(2), "fafb03020002"),
        (command(Command.ENABLE, 1), "fafb06043b0100053b"),
        (command(Command.VEL, 200), "fafb060b3bc800d33b"),
        (command(Command.VEL, -200), "fafb060b1bc800d31b"),
        (command(Command.E_STOP), "fafb03370037"),
        (command(Command.STOP), "fafb031d001d"),
    ],
)
def test_commands_match_the_manual(made: bytes, hexadecimal: str) -> None:
    assert made.hex() == hexadecimal


def test_the_status_packet_of_the_manual_is_parsed() -> None:
    parser = PacketParser()
    assert parser.feed(SIP) == [SIP[3:-2]]
    assert (parser.packets, parser.bad_packets, parser.skipped_bytes) == (1, 0, 0)


def test_reset_and_maintenance_have_no_name() -> None:
    assert {253, 255}.isdisjoint(int(each) for each in Command)


@pytest.mark.parametrize("argument", [-32769, 65536])
def test_a_number_beyond_16_bits_is_refused(argument: int) -> None:
    with pytest.raises(ValueError, match="-32768 to 65535"):
        command(Command.VEL, argument)


@pytest.mark.parametrize("payload", [b"", b"\x0b\x3b\x01", b"\x0b\x77\x01\x00", b"\x0b\x2b\x05ab"])
def test_a_malformed_command_is_refused(payload: bytes) -> None:
    with pytest.raises(ValueError, match="command"):
        decode_command(payload)


@given(st.integers(0, 255), st.none() | st.integers(-32768, 65535) | st.binary(max_size=200))
def test_a_command_is_read_back(number: int, argument: int | bytes | None) -> None:
    (payload,) = PacketParser().feed(command(number, argument))
    assert decode_command(payload) == Decoded(number, argument)


PAYLOADS = st.lists(st.binary(min_size=1, max_size=253), min_size=1, max_size=6)
# Garbage that cannot begin a packet: it lacks the header's first byte.
GARBAGE = st.binary(max_size=30).map(lambda data: data.replace(b"\xfa", b"\x00"))


@given(PAYLOADS, st.data())
def test_any_split_of_a_stream_gives_the_same_packets(
    payloads: list[bytes], data: st.DataObject
) -> None:
    stream = b"".join(map(packet, payloads))
    parser, found, at = PacketParser(), [], 0
    while at < len(stream):
        size = data.draw(st.integers(1, 80))
        found += parser.feed(stream[at : at + size])
        at += size
    assert found == payloads
    assert parser.bad_packets == parser.skipped_bytes == 0


@given(PAYLOADS, st.data())
def test_garbage_between_packets_is_skipped(payloads: list[bytes], data: st.DataObject) -> None:
    stream = b""
    for payload in payloads:
        stream += data.draw(GARBAGE) + packet(payload)
    parser = PacketParser()
    assert parser.feed(stream) == payloads
    assert parser.skipped_bytes == len(stream) - sum(len(packet(each)) for each in payloads)


@given(st.binary(max_size=2000), st.lists(st.integers(1, 50), min_size=1))
def test_arbitrary_bytes_never_raise(noise: bytes, sizes: list[int]) -> None:
    parser, at, which = PacketParser(), 0, 0
    while at < len(noise):
        size = sizes[which % len(sizes)]
        for payload in parser.feed(noise[at : at + size]):
            assert 1 <= len(payload) <= 253
        at, which = at + size, which + 1
    parser.abandon()
    assert not parser.pending


def test_a_doubled_first_byte_of_a_header_loses_nothing() -> None:
    assert PacketParser().feed(b"\xfa" + SIP) == [SIP[3:-2]]
    parser = PacketParser()
    assert parser.feed(b"\xfa") + parser.feed(SIP[:1]) + parser.feed(SIP[1:]) == [SIP[3:-2]]


def test_a_header_within_a_payload_starts_no_packet() -> None:
    inner = b"\x32" + command(Command.VEL, 500) + b"\xfa\xfb"
    assert PacketParser().feed(packet(inner) * 2) == [inner, inner]


def test_a_bad_checksum_loses_only_one_packet() -> None:
    bad = bytearray(SIP)
    bad[8] ^= 0x10
    parser = PacketParser()
    assert parser.feed(bytes(bad) + SIP) == [SIP[3:-2]]
    assert parser.bad_packets == 1


@pytest.mark.parametrize("cut", range(3, len(SIP)))
def test_a_truncated_packet_loses_none_after_it(cut: int) -> None:
    parser = PacketParser()
    assert parser.feed(SIP[:cut] + SIP + SIP) == [SIP[3:-2]] * 2


def test_a_packet_with_too_small_a_count_is_bad() -> None:
    parser = PacketParser()
    assert parser.feed(b"\xfa\xfb\x02\x00\x00" + SIP) == [SIP[3:-2]]
    assert parser.bad_packets == 1


def test_a_damaged_count_blocks_nothing_once_the_line_is_quiet() -> None:
    greedy = SIP[:2] + b"\xff" + SIP[3:]
    parser = PacketParser()
    assert parser.feed(greedy + SIP) == []
    assert parser.pending
    assert parser.abandon() == [SIP[3:-2]]
    assert not parser.pending
    assert parser.bad_packets == 1
    assert parser.feed(SIP) == [SIP[3:-2]]


@given(st.binary(min_size=1, max_size=253), st.integers(1, 255), st.data())
@settings(max_examples=200)
def test_one_damaged_byte_of_the_data_is_always_detected(
    payload: bytes, flip: int, data: st.DataObject
) -> None:
    made = bytearray(packet(payload))
    at = data.draw(st.integers(3, len(made) - 1))
    made[at] ^= flip
    assert payload not in PacketParser().feed(bytes(made))
    assert checksum(bytes(made[3:-2])) != int.from_bytes(made[-2:], "big")
