"""Engine process: from inherited descriptors to a running loop to the exit."""

from __future__ import annotations

import contextlib
import logging
import os
import queue
import signal
import time
from typing import NoReturn

from app.contract.drive import PLAN_NAME, SIGHT_NAME, WHEELS_NAME
from app.contract.events import (
    BoardLookEvent,
    DenseStereoEvent,
    HeartbeatEvent,
    LocalMapEvent,
    ObservationEvent,
    SkippedFrameEvent,
)
from app.engine.drive_link import DriveLink
from app.engine.loop import Engine, Inbox
from app.engine.played_source import SourceOpener
from app.engine.preparing import Preparation, Preparing
from app.engine.publishing import Publisher
from app.engine.session import ObserverFactory
from app.engine.sight import SightWriter
from app.engine.wayfinding import Wayfinder
from app.engine.wheel_feed import WheelFeed
from app.runtime.arguments import ProcessArguments
from app.runtime.heap import keep_for_good
from app.runtime.latest import LatestReader, LatestWriter
from app.runtime.lifeline import receive_until_parent_ends
from app.runtime.pipe import MessageSender

# Robots drive by these observations, so the engine goes ahead of ordinary processes but behind the
# drive loop, and not so far ahead that a saturated engine starves the web process, which handles
# the operators' commands.
_NICENESS = -5


def run_engine(
    arguments: ProcessArguments,
    *,
    open_source: SourceOpener,
    make_observer: ObserverFactory,
    prepare: Preparation = lambda _: None,
) -> NoReturn:
    """Run an engine in this process until it is asked to stop, then exit the process.

    Args:
        open_source, make_observer: factories of sources and observers.
        prepare: prepares what every observer needs; see ``app.engine.preparing``.
    """
    # Ctrl-C reaches every process of the terminal; the parent decides what to do.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, 0, _NICENESS)
    logging.basicConfig(level=logging.WARNING, format="engine %(process)d: %(message)s")
    sock = arguments.open_channel()

    inbox: Inbox = queue.SimpleQueue()
    signal.signal(signal.SIGTERM, lambda *_: inbox.put(None))
    leaving = False
    sender = MessageSender(
        sock,
        latest=(HeartbeatEvent, DenseStereoEvent, BoardLookEvent, LocalMapEvent),
        droppable=(ObservationEvent, SkippedFrameEvent),
    )
    slots = dict(arguments.slots)
    # Slots shared with the drive process.
    sight, plan = (LatestWriter(slots.pop(name)) for name in (SIGHT_NAME, PLAN_NAME))
    wheels = WheelFeed(LatestReader(slots.pop(WHEELS_NAME)))
    preparing = Preparing(prepare)
    preparing.start()
    engine = Engine(
        inbox=inbox,
        send=sender.send,
        observations_lost=lambda: sender.lost(ObservationEvent),
        publisher=Publisher({name: LatestWriter(fd) for name, fd in slots.items()}, sender.send),
        drive=DriveLink(
            SightWriter(sight, wheels, time.monotonic),
            wheels,
            Wayfinder(plan, wheels, time.monotonic),
        ),
        open_source=open_source,
        make_observer=make_observer,
        preparing=preparing,
    )
    receive_until_parent_ends(sock, inbox.put, expects_end=lambda: leaving)
    keep_for_good()
    engine.run()
    leaving = True
    sender.close()
    # Skip the interpreter's own shutdown: a thread still opening a source, or a library waiting for
    # its own threads, would block it.
    os._exit(0)
