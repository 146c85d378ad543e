"""Status packets to SI units."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from observer.robots.models import SPECS, robot_spec
from observer.robots.sip import decode_status

MANUAL = bytes.fromhex("320000000000000000000090fefe00000000000204007d07007d05005930f0")
P3DX, AMIGO = robot_spec("p3dx-sh"), robot_spec("amigo")


def sip(
    *,
    x: int = 0,
    y: int = 0,
    heading: int = 0,
    left: int = 0,
    right: int = 0,
    battery: int = 120,
    bumps: int = 0,
    flags: int = 0,
    sonar: tuple[tuple[int, int], ...] = (),
    tail: bytes = b"",
    kind: int = 0x32,
) -> bytes:
    fixed = struct.pack(
        "<BHHhhhBHhHBB", kind, x, y, heading, left, right, battery, bumps, 0, flags, 0, len(sonar)
    )
    return fixed + b"".join(struct.pack("<BH", *each) for each in sonar) + tail


def tail(
    battery10: int = 126,
    charge: int = 1,
    rotation: int = -150,
    faults: int = 3,
    lateral: int = 0,
    temperature: int = 31,
    soc: int = 77,
) -> bytes:
    return bytes(5) + struct.pack(
        "<HBhHhbB", battery10, charge, rotation, faults, lateral, temperature, soc
    )


def test_the_packet_of_the_manual_is_decoded() -> None:
    status = decode_status(MANUAL, P3DX)
    assert status.battery_v == 14.4
    assert status.stalled == (False, False)
    # The word is fefe: all bumper bits are set, but none is fitted.
    assert status.front_bumpers == status.rear_bumpers == ()
    assert status.ranges_m == {4: None, 7: None}
    assert status.charging is status.temperature_c is None


def test_fitted_bumpers_are_reported_and_others_are_masked() -> None:
    status = decode_status(sip(bumps=0b0000_0101_0000_1011), P3DX, 5, 4)
    assert status.stalled == (True, True)
    assert status.rear_bumpers == (True, False, True, False)
    assert status.front_bumpers == (False, True, False, False, False)
    assert decode_status(MANUAL, P3DX, 3, 9).rear_bumpers == (True,) * 7


def test_speeds_and_their_factors() -> None:
    plain = decode_status(sip(left=200, right=300, kind=0x33), P3DX)
    assert plain.speed_mps == pytest.approx(0.25)
    assert plain.turn_rate_radps == pytest.approx(50 * 0.0056)
    amigo = decode_status(sip(left=-100, right=-100), AMIGO)
    assert amigo.speed_mps == pytest.approx(-0.06154)


def test_a_complete_tail_is_decoded() -> None:
    status = decode_status(sip(sonar=((0, 1234), (15, 4999)), tail=tail()), P3DX)
    assert status.ranges_m == {0: 1.234, 15: 4.999}
    assert status.battery_v == 12.6
    assert status.charging == "bulk"
    assert status.turn_rate_radps == pytest.approx(math.radians(-15))
    assert status.temperature_c == 31.0


@pytest.mark.parametrize("length", range(17))
def test_a_tail_may_end_anywhere(length: int) -> None:
    status = decode_status(sip(left=10, right=30, tail=tail()[:length]), P3DX)
    assert status.battery_v == (12.6 if length >= 7 else 12.0)
    assert status.charging == ("bulk" if length >= 8 else None)
    assert status.turn_rate_radps == pytest.approx(math.radians(-15) if length >= 10 else 0.056)
    assert status.temperature_c == (31.0 if length >= 15 else None)


def test_unknown_values_are_none() -> None:
    status = decode_status(sip(battery=0, tail=tail(0, 255, temperature=-127)), P3DX)
    assert status.battery_v is status.charging is status.temperature_c is None


def test_an_unknown_battery_in_the_tail_falls_back_to_the_main_value() -> None:
    assert decode_status(sip(battery=118, tail=tail(0)), P3DX).battery_v == 11.8


def test_flags() -> None:
    status = decode_status(sip(flags=0b10_0110_0001), P3DX)
    assert status.motors_enabled
    assert status.stop_pressed
    assert status.e_stalled
    assert status.joystick
    # An AmigoBot has only the first two.
    amigo = decode_status(sip(flags=0b10_0110_0001), robot_spec("amigo-sh"))
    assert amigo.motors_enabled
    assert amigo.stop_pressed is amigo.e_stalled is amigo.joystick is None


def test_a_sonar_count_that_overruns_gives_no_readings_and_no_tail() -> None:
    payload = bytearray(sip(left=100, right=100, sonar=((0, 4000), (1, 300)), tail=tail()))
    payload[19] = 30
    status = decode_status(bytes(payload), P3DX)
    assert status.sonar_overrun
    assert status.ranges_m == {}
    assert status.charging is None
    assert status.speed_mps == pytest.approx(0.1)


def test_a_sonar_that_is_not_fitted_is_left_out() -> None:
    assert decode_status(sip(sonar=((8, 1000), (7, 500))), AMIGO).ranges_m == {7: 0.5}


def test_no_echo_is_none_and_contact_is_zero() -> None:
    status = decode_status(sip(sonar=((0, 5000), (1, 0))), P3DX)
    assert status.ranges_m == {0: None, 1: 0.0}


def test_the_position_is_masked_and_the_heading_is_signed() -> None:
    status = decode_status(sip(x=0x8005, y=0xFFFF, heading=-7), P3DX)
    assert (status.raw_x, status.raw_y, status.raw_heading) == (5, 0x7FFF, -7)


@pytest.mark.parametrize("payload", [b"", b"\x32", sip()[:19], b"\x20" + sip()[1:]])
def test_an_invalid_status_packet_is_refused(payload: bytes) -> None:
    with pytest.raises(ValueError, match="status packet"):
        decode_status(payload, P3DX)


@given(st.binary(min_size=20, max_size=253), st.sampled_from(sorted(SPECS)), st.integers(0, 255))
def test_any_bytes_are_decoded_or_refused(data: bytes, model: str, bumpers: int) -> None:
    status = decode_status(b"\x33" + data[1:], robot_spec(model), bumpers, bumpers)
    assert math.isfinite(status.speed_mps)
    assert math.isfinite(status.turn_rate_radps)
