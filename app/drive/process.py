"""Drive process: from inherited descriptors to a running loop and back."""

from __future__ import annotations

import logging
import os
import queue
import signal
import socket
import time
from typing import NoReturn

from app.contract.drive import (
    PLAN_NAME,
    SIGHT_NAME,
    WHEELS_NAME,
    DriveState,
    WheelSpeedEvent,
)
from app.drive.engine_feed import EngineFeed
from app.drive.loop import DriveLoop, Inbox
from app.drive.priority import calm_interpreter, raise_priority
from app.drive.robot_opener import OpenRobot, RobotOpener
from app.drive.roles import Roles
from app.runtime.arguments import ProcessArguments
from app.runtime.latest import LatestReader, LatestWriter
from app.runtime.lifeline import receive_until_parent_ends
from app.runtime.pipe import MessageSender
from observer.guard.guard import Guard
from observer.guard.parameters import GuardParameters
from observer.guard.sight import sight_of
from observer.navigation.plan import plan_of
from observer.rig.rig import ROLES

# Longer than a working loop takes to release all robots.
_LAST_S = 5.0


def message_sender(sock: socket.socket) -> MessageSender:
    """Return the sender of replies and events.

    Incidents and stops are records of safety and rare, so only wheel speeds are dropped.
    """
    return MessageSender(sock, latest=(DriveState,), droppable=(WheelSpeedEvent,))


def run_drive(arguments: ProcessArguments, *, open_robot: OpenRobot) -> NoReturn:
    """Run the drive loop in this process until it is asked to stop, then exit the process.

    Args:
        open_robot: factory of robots.
    """
    logging.basicConfig(level=logging.WARNING, format="drive %(process)d: %(message)s")
    sock = arguments.open_channel()

    inbox: Inbox = queue.SimpleQueue()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        signal.signal(number, lambda *_: inbox.put(None))
    # Before any thread is started: they must all inherit it.
    priority = raise_priority()
    sender = message_sender(sock)
    parameters = GuardParameters()
    openers = {role: RobotOpener(role, open_robot) for role in ROLES}
    loop = DriveLoop(
        roles=Roles(Guard(parameters), openers, parameters),
        inbox=inbox,
        send=sender.send,
        wheel_speeds_lost=lambda: sender.lost(WheelSpeedEvent),
        newest_sight=EngineFeed(LatestReader(arguments.slots[SIGHT_NAME]), sight_of).newest,
        newest_plan=EngineFeed(LatestReader(arguments.slots[PLAN_NAME]), plan_of).newest,
        write_wheels=LatestWriter(arguments.slots[WHEELS_NAME]).write,
        orphaned=lambda: os.getppid() != arguments.parent,
        priority=priority,
    )

    # However the parent ends, the robots are stopped and released before this process is gone.
    def leave() -> None:
        inbox.put(None)
        # A hung loop must not outlive its parent for ever; it sends nothing any more.
        time.sleep(_LAST_S)
        os._exit(1)

    receive_until_parent_ends(sock, inbox.put, expects_end=lambda: loop.leaving, leave=leave)
    calm_interpreter()
    loop.run()
    sender.close(0.2)
    # Skip the interpreter's own shutdown: a hung thread of a port would hold it up.
    os._exit(0)
