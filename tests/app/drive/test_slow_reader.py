"""What the drive process still reports to a web process that does not read for a while."""

from __future__ import annotations

import socket

from app.contract.drive import IncidentEvent, WheelSpeedEvent
from app.drive.process import message_sender
from app.runtime.pipe import DEFAULT_BACKLOG, load_message


def test_wheel_speeds_are_dropped_and_counted_before_any_incident() -> None:
    here, there = socket.socketpair()
    with here, there:
        here.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)
        sender = message_sender(here)
        incident = IncidentEvent("observer", "guard", "something is ahead", 1.0, 0.3)
        sent = 40 * DEFAULT_BACKLOG
        for number in range(sent):
            if number == sent // 2:
                sender.send(incident)
            sender.send(WheelSpeedEvent("observer", float(number), 0.3, 0.3))
        lost = sender.lost(WheelSpeedEvent)
        with there.makefile("rb") as stream:
            heard = [load_message(stream) for _ in range(sent + 1 - lost)]
        sender.close()
    assert lost > sent // 2
    assert incident in heard
