"""The engine as a process: from inherited descriptors to a running loop and back."""

from __future__ import annotations

import argparse
import logging
import os
import queue
import signal
import socket
import time
from collections.abc import Sequence
from typing import Any

from app.channel.latest import LatestWriter
from app.channel.pipe import MessageSender
from app.engine.lifeline import die_with_parent, receive_until_parent_ends
from app.engine.loop import Engine, Inbox
from app.engine.publishing import Publisher
from app.engine.session import ObserverFactory, SourceOpener


def run_engine(
    arguments: Sequence[str], *, open_source: SourceOpener, make_observer: ObserverFactory
) -> int:
    """Run an engine in this process until it is told to leave.

    Args:
        arguments: the command line that ``app.engine.launch`` made.
        open_source, make_observer: where sources and observers come from.

    Returns:
        The process's exit code.
    """
    options = _parse(arguments)
    # Ctrl-C reaches every process of the terminal; the parent decides what follows.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    die_with_parent(options.parent)
    logging.basicConfig(level=logging.WARNING, format="engine %(process)d: %(message)s")
    for fd in (options.channel, *options.slots.values()):
        # No program that this one may start shall hold the channel open.
        os.set_inheritable(fd, False)

    inbox: Inbox = queue.SimpleQueue()
    signal.signal(signal.SIGTERM, lambda *_: inbox.put(None))
    leaving = False
    sock = socket.socket(fileno=options.channel)
    sender = MessageSender(sock)
    slots = {name: LatestWriter(fd) for name, fd in options.slots.items()}
    engine = Engine(
        inbox=inbox,
        send=sender.send,
        observations_lost=lambda: sender.observations_lost,
        publisher=Publisher(slots, time.monotonic),
        open_source=open_source,
        make_observer=make_observer,
    )
    receive_until_parent_ends(sock, inbox.put, expects_end=lambda: leaving)
    engine.run()
    leaving = True
    sender.close()
    # Without the interpreter's own end: a thread that still opens a source, or a library that
    # waits for its own threads, would hold it up.
    os._exit(0)


def _parse(arguments: Sequence[str]) -> Any:
    parser = argparse.ArgumentParser(
        prog="python -m app.engine",
        description="The engine process of dynamic-observer; started by the server only.",
    )
    parser.add_argument("--channel", type=int, required=True, help="descriptor of the messages")
    parser.add_argument("--parent", type=int, required=True, help="process id of the server")
    parser.add_argument(
        "--slot", action="append", default=[], help="NAME=DESCRIPTOR of a latest-value slot"
    )
    options = parser.parse_args(arguments)
    options.slots = {
        name: int(fd) for name, _, fd in (text.partition("=") for text in options.slot)
    }
    return options
