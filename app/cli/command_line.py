"""Commands by name, imported on demand, and the handling of their errors.

An error is one sentence on stderr. The exit code is 2 for usage and input, 1 for failed work.
Data goes only to stdout or to the named file; progress goes to stderr.
"""

from __future__ import annotations

import importlib
import os
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
    "link": "Print the links that sign a browser in to the running server, and a QR code.",
    "observe": "Process a source from its first to its last frame and write one JSON line per "
    "frame.",
    "evaluate": "Compare tracks with ground truth: recall, false obstacles, position and velocity "
    "errors.",
    "export": "Export the tracks, ground truth, video, point cloud or ROS 2 bag of a run.",
    "chart": "Plot estimated, true, commanded and wheel-encoder speeds over time.",
    "frames": "Write each frame's boxes, speeds and counts against ground truth as JSON.",
    "align": "Align motion capture with a run: time offset, room frame and matching of tracks to "
    "bodies.",
    "truth": "Describe a motion-capture file: its bodies, frame rate, units, angles and gaps.",
    "purge": "Permanently remove deleted runs and ground truth, with their recordings.",
    "report": "Write a self-contained report of a run: figures 9-17, errors, parameters, "
    "calibration.",
    "reproduce": "Run both experiments of figure 17 in the simulated lab and reproduce the paper's "
    "figures.",
    "simulate": "Render a scenario into left/, right/, times.txt, calibration.yaml and truth.csv.",
    "calibrate": "Calibrate a stereo camera from images of a board, and state what it can detect.",
    "coppelia-scene": "Build two P3-DX, stereo cameras on one, walls and textured boxes in "
    "CoppeliaSim.",
    "parameters": "List the parameters that --set, the web page and REST accept.",
    "drive": "Run a programme on the robots of a running server; they stop when this command ends.",
    "go": "Send the observer to a goal; it stops when this command ends.",
    "programmes": "List the built-in programmes; a server may have more.",
    "benchmark": "Compare the presets over scenarios and seeds, and measure the processing time.",
    "navigate-benchmark": "Measure driving to a goal among people: the planner compared with the "
    "guard alone.",
    "sweep": "Evaluate every combination of parameters on every source, and rank them.",
    "emulate": "Emulate a robot on an empty floor until Ctrl-C, and print the port to connect to.",
    "backup": "Back up runs, speeds, parameters, presets, calibrations, rig, programmes and ground "
    "truth.",
    "restore": "Restore a backup; it is checked completely before anything is changed.",
    "systemd-unit": "Print a systemd unit that starts this installation's server at boot.",
    "doctor": "Check cameras, ports and the data folder; exit code 1 if a problem prevents the "
    "start.",
}
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
        _leave(f"{said} (see --help)", EXIT_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        _leave("interrupted", EXIT_INTERRUPTED)
    sys.exit(code if isinstance(code, int) else 0)


def _leave(sentence: str, code: int) -> NoReturn:
    print(f"dynamic-observer: {sentence}", file=sys.stderr)  # noqa: T201
    sys.exit(code)
