"""Faults that can be injected into a simulated robot while it runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Faults:
    """Injected faults, to be changed at any time from any thread; none by default.

    On the serial line, in ``serving``:
        noise: share of the bytes that are corrupted, in both directions, 0 to 1.
        truncated: share of the messages that lose their end, in both directions, 0 to 1.
        repeated: every message arrives twice, in both directions.
        split: output arrives in pieces of a few bytes, milliseconds apart.
        merge_s: output is held back for this many seconds and arrives in one piece.
        silent: it sends nothing but still receives. deaf: it receives nothing but still sends.
        unplugged: the cable is pulled: the client's reads fail, and the port cannot be opened until
            it is plugged in again, under the same name.

    In what the robot sends:
        double_header: every packet begins ``FA FA FB``.
        false_header: before every packet comes a header that announces more bytes than follow.
        sonar_overrun: a status packet claims more sonar readings than it holds.
        no_sync_reply: SYNC is never answered. strange_sync_reply: it is answered with type 0xFF.
        no_config_reply: CONFIG is never answered.
        short_status: status packets end after the digital output, as in old firmware.
        strange_packets: packets of unknown types between status packets.

    Of the robot itself:
        stalled: left and right wheel, in addition to true stalls.
        front_bumpers, rear_bumpers: bit k is bumper k, in addition to those really touched.
        phantom_bumpers: all bumper bits read 1 although none are fitted.
        stop_pressed: the hardware e-stop; motors stay off while it is pressed.
        flags: bits that are set in addition to the true FLAGS of a status packet.
        battery_v: None is unknown. charge_state: as in a status packet. temperature_c: None
            without a thermometer. state_of_charge: per cent, 0 is unknown.
    """

    noise: float = 0.0
    truncated: float = 0.0
    repeated: bool = False
    split: bool = False
    merge_s: float = 0.0
    silent: bool = False
    deaf: bool = False
    unplugged: bool = False

    double_header: bool = False
    false_header: bool = False
    sonar_overrun: bool = False
    no_sync_reply: bool = False
    strange_sync_reply: bool = False
    no_config_reply: bool = False
    short_status: bool = False
    strange_packets: bool = False

    stalled: tuple[bool, bool] = (False, False)
    front_bumpers: int = 0
    rear_bumpers: int = 0
    phantom_bumpers: bool = False
    stop_pressed: bool = False
    flags: int = 0
    battery_v: float | None = 12.6
    charge_state: int = 0
    temperature_c: int | None = 31
    state_of_charge: int = 0
