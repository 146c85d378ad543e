"""Commands by name, imported on demand, and the handling of their errors.

An error is one sentence on stderr. The exit code is 2 for usage and input, 1 for failed work.
Data goes only to stdout or to the named file; progress goes to stderr.
"""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

import typer
from typer.core import TyperGroup
from typer.exceptions import TyperException

from app.runtime.environment import NATIVE_ENVIRONMENT
from observer.errors import DynamicObserverError, InputError

EXIT_FAILED = 1
EXIT_INPUT = 2
EXIT_INTERRUPTED = 130

# Shown by ``--help``: the first sentence of each command's own help.
COMMANDS: Mapping[str, str] = {
    "serve": "Serve the web page and print the link to open.",
    "link": "Print links that sign in to a running server.",
    "observe": "Process a source, one JSON line per frame.",
    "evaluate": "Compare tracks with ground truth.",
    "export": "Export a run for other tools.",
    "chart": "Plot a run's speeds over time.",
    "frames": "Write the results of each frame as JSON.",
    "align": "Align motion capture with a run.",
    "truth": "Describe a motion-capture file.",
    "purge": "Permanently remove deleted runs and ground truth.",
    "report": "Write a self-contained report of a run.",
    "reproduce": "Reproduce the paper's figures.",
    "simulate": "Render a scenario into a stereo folder.",
    "calibrate": "Calibrate a stereo camera from images of a board.",
    "coppelia-scene": "Build the paper's scene in CoppeliaSim.",
    "parameters": "List the parameters.",
    "drive": "Run a programme on the robots of a server.",
    "go": "Send the observer to a goal.",
    "programmes": "List the built-in programmes; a server may have more.",
    "benchmark": "Compare the presets over scenarios and seeds.",
    "navigate-benchmark": "Measure driving to a goal among people.",
    "sweep": "Evaluate and rank combinations of parameters.",
    "emulate": "Print a port, and emulate a robot on it until Ctrl-C.",
    "backup": "Back up runs, settings and ground truth.",
    "restore": "Restore a backup.",
    "systemd-unit": "Print a systemd unit for this installation.",
    "doctor": "Check cameras, ports and the data folder.",
}
# The parser takes a negative number for an option.
_NEGATIVE = re.compile(r"^No such option: -[0-9.]")
# Each command lives in the module of its name, with this one exception.
_MODULES = {"programmes": "drive"}


class _Commands(TyperGroup):
    """Group of stand-ins with help lines; a command is imported when it is called."""

    # Any: Typer does not export the types of its contexts and commands.
    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        name, stand_in, rest = super().resolve_command(ctx, args)
        return name, stand_in if name is None else load_command(name), rest


def load_command(name: str) -> Any:
    """Import one of ``COMMANDS`` and return Typer's form of it."""
    function = name.replace("-", "_")
    module = importlib.import_module(f"app.cli.{_MODULES.get(name, function)}")
    alone = _empty()
    alone.command(name)(getattr(module, function))
    return typer.main.get_command(alone)


def build() -> typer.Typer:
    """Build the command line."""
    cli = _empty()
    for name, help_line in COMMANDS.items():
        cli.command(name, help=help_line)(_stand_in)
    return cli


def _stand_in() -> None:
    """Stand in for a command; never called, see ``_Commands``."""


def _empty() -> typer.Typer:
    return typer.Typer(
        name="dynamic-observer",
        cls=_Commands,
        help="Detects moving obstacles from a moving robot with a low-cost stereo camera.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit."""
    run(build(), arguments)


def run(cli: typer.Typer, arguments: Sequence[str] | None = None) -> NoReturn:
    """Run a command line, print its errors in the common form, and exit.

    Args:
        arguments: used instead of the process's own.
    """
    # Must be set before numpy and OpenCV are imported: they read it then.
    for name, value in NATIVE_ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    try:
        code = cli(args=arguments, standalone_mode=False)
    except InputError as error:
        _leave(str(error), EXIT_INPUT)
    except DynamicObserverError as error:
        _leave(str(error), EXIT_FAILED)
    except TyperException as error:
        said = error.format_message().rstrip(".").replace("Input should", "must")
        if _NEGATIVE.search(said):
            said += "; put -- before a negative number"
        _leave(f"{said} (see --help)", EXIT_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        _leave("interrupted", EXIT_INTERRUPTED)
    sys.exit(code if isinstance(code, int) else 0)


def _leave(sentence: str, code: int) -> NoReturn:
    print(f"dynamic-observer: {sentence}", file=sys.stderr)  # noqa: T201
    sys.exit(code)
