"""The reply to CONFIG, complete and cut off anywhere."""

from __future__ import annotations

import struct

import pytest

from observer.robots.config_reply import ConfigReply, decode_config

REPLY = (
    b"\x20Pioneer\0p3dx-sh\0ABC_123\0"
    + struct.pack("<BHHHHH", 0, 360, 1500, 300, 2000, 500)
    + b"Robby\0"
    + struct.pack("<BBBHHB", 100, 2, 0, 0, 1, 1)
    + struct.pack("<HHHB", 115, 16570, 2000, 0)
    + struct.pack("<16H", 200, 100, 500, 30, 120, 750, 100, 100, 1, 2, 3, 300, 300, 4, 5, 6)
    + struct.pack("<6B", 5, 3, 0, 40, 1, 0)
)
WHOLE = ConfigReply(
    type="Pioneer", subtype="p3dx-sh", name="Robby", turn_rate_top=360, turn_rate_max=120,
    speed_top=1500, speed_max=750, acceleration_top=2000, turn_acceleration_top=300,
    watchdog_ms=2000, front_sonar=1, rear_sonar=1, front_bumpers=5, rear_bumpers=3,
)  # fmt: skip


@pytest.mark.parametrize("more", [b"", b"\x01\x02\x03\x04"])
def test_a_complete_reply_is_decoded(more: bytes) -> None:
    assert decode_config(REPLY + more) == WHOLE


@pytest.mark.parametrize("length", range(1, len(REPLY)))
def test_a_truncated_reply_gives_fewer_values_but_none_wrong(length: int) -> None:
    reply = decode_config(REPLY[:length])
    for name, value in vars(WHOLE).items():
        assert getattr(reply, name) in (None, value)


def test_the_watchdog_is_decoded_only_if_complete() -> None:
    # Low battery, encoder counts, watchdog.
    until = REPLY.index(struct.pack("<HHH", 115, 16570, 2000)) + 6
    assert decode_config(REPLY[:until]).watchdog_ms == 2000
    assert decode_config(REPLY[: until - 1]).watchdog_ms is None


@pytest.mark.parametrize("payload", [b"", b"\x32abc"])
def test_an_invalid_reply_is_refused(payload: bytes) -> None:
    with pytest.raises(ValueError, match="CONFIG"):
        decode_config(payload)


def test_unprintable_text_is_replaced() -> None:
    assert decode_config(b"\x20Pio\x07neer\xff\0").type == "Pio?neer?"
