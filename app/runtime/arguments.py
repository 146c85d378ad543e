"""Command line of a child process, as ``app.runtime.child`` writes it. Imports nothing slow."""

from __future__ import annotations

import argparse
import os
import socket
from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class ProcessArguments:
    """Arguments that a child process inherits.

    Attributes:
        channel: descriptor of the message socket.
        parent: process id of the server.
        slots: descriptor of each latest-value slot by name.
    """

    channel: int
    parent: int
    slots: Mapping[str, int]

    def as_command_line(self) -> list[str]:
        words = ["--channel", str(self.channel), "--parent", str(self.parent)]
        for name, fd in self.slots.items():
            words += ["--slot", f"{name}={fd}"]
        return words

    def open_channel(self) -> socket.socket:
        """Return the message socket; programs started by this process do not inherit it."""
        for fd in (self.channel, *self.slots.values()):
            os.set_inheritable(fd, False)
        return socket.socket(fileno=self.channel)


def parse_arguments(words: Sequence[str], name: str = "engine") -> ProcessArguments:
    """Parse the output of ``as_command_line``; exit with code 2 on anything else.

    Args:
        name: name of the process and of its package in ``app``.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m app.{name}",
        description=f"The {name} process of dynamic-observer; started by the server only.",
    )
    parser.add_argument("--channel", type=int, required=True, help="descriptor of the messages")
    parser.add_argument("--parent", type=int, required=True, help="process id of the server")
    parser.add_argument(
        "--slot", action="append", default=[], help="NAME=DESCRIPTOR of a latest-value slot"
    )
    options = parser.parse_args(words)
    slots = {name: int(fd) for name, _, fd in (text.partition("=") for text in options.slot)}
    return ProcessArguments(options.channel, options.parent, slots)
