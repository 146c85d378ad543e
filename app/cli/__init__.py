"""The command line: ``dynamic-observer COMMAND``."""

from app.cli.command_line import main

__all__ = ["main"]
