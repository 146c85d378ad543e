"""Everything that can be made wrong with a simulated robot, while it runs."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Faults:
    """Change any of it at any time, from any thread; the defaults are a healthy robot.

    On the line, in ``serving``:
        noise: share of the bytes that arrive altered, both ways, 0 to 1.
        split: what the robot sends comes in pieces of a few bytes, milliseconds apart.
        merge_s: what it sends is held back until it is so old, and comes in one piece.
        silent: it sends nothing; it still hears. deaf: it hears nothing; it still sends.
        refuse: it takes no connection (TCP), and ends the one it has.

    In what the robot sends:
        double_header: every packet begins ``FA FA FB``.
        false_header: every packet follows a header that promises more than comes.
        sonar_overrun: a status packet claims more sonar readings than it holds.
        no_sync_reply: SYNC is never answered. strange_sync_reply: it is, by type 0xFF.
        short_status: status packets end behind digital out, as old firmware's do.
        strange_packets: packets of unknown types between those of status.

    Of the robot itself:
        stalled: left and right, beside a true stall.
        front_bumpers, rear_bumpers: bit k is bumper k, beside those really touched.
        phantom_bumpers: all bumper bits read 1 though none are fitted.
        stop_pressed: its hardware stop button; motors stay off while it is.
        flags: bits that are set beside the true ones, as in a status packet's FLAGS.
        battery_v: None is unknown. charge_state: as in a status packet. temperature_c: None
            where it has no thermometer. state_of_charge: per cent, 0 is unknown.
    """

    noise: float = 0.0
    split: bool = False
    merge_s: float = 0.0
    silent: bool = False
    deaf: bool = False
    refuse: bool = False

    double_header: bool = False
    false_header: bool = False
    sonar_overrun: bool = False
    no_sync_reply: bool = False
    strange_sync_reply: bool = False
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
