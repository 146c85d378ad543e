"""The command line: ``dynamic-observer COMMAND``.

Errors are one sentence on stderr; the exit code is 2 for usage and input, 1 for failed work.
Data goes to stdout or to the named file only, progress to stderr.
"""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable, Sequence

import typer
from typer.exceptions import TyperException

from app.native_environment import NATIVE_ENVIRONMENT
from observer.errors import DynamicObserverError, InputError

EXIT_FAILED = 1
EXIT_INPUT = 2
EXIT_INTERRUPTED = 130


def build() -> typer.Typer:
    """The command line with all its commands."""
    # Imported here, because they bring numpy and OpenCV, which read the environment when imported.
    from app.commands.align import align
    from app.commands.backup import backup
    from app.commands.benchmark import benchmark
    from app.commands.calibrate import calibrate
    from app.commands.chart import chart
    from app.commands.coppelia_scene import coppelia_scene
    from app.commands.doctor import doctor
    from app.commands.drive import drive, programmes
    from app.commands.emulate import emulate
    from app.commands.evaluate import evaluate
    from app.commands.export import export
    from app.commands.observe import observe
    from app.commands.parameters import parameters
    from app.commands.purge import purge
    from app.commands.report import report
    from app.commands.reproduce import reproduce
    from app.commands.restore import restore
    from app.commands.serve import serve
    from app.commands.simulate import simulate
    from app.commands.sweep import sweep
    from app.commands.truth import truth

    cli = _empty()
    cli.command("serve")(serve)
    cli.command("observe")(observe)
    cli.command("evaluate")(evaluate)
    cli.command("export")(export)
    cli.command("chart")(chart)
    cli.command("align")(align)
    cli.command("truth")(truth)
    cli.command("purge")(purge)
    cli.command("report")(report)
    cli.command("reproduce")(reproduce)
    cli.command("simulate")(simulate)
    cli.command("calibrate")(calibrate)
    cli.command("coppelia-scene")(coppelia_scene)
    cli.command("parameters")(parameters)
    cli.command("drive")(drive)
    cli.command("programmes")(programmes)
    cli.command("benchmark")(benchmark)
    cli.command("sweep")(sweep)
    cli.command("emulate")(emulate)
    cli.command("backup")(backup)
    cli.command("restore")(restore)
    cli.command("doctor")(doctor)
    return cli


def build_one(name: str) -> typer.Typer:
    """The command line with one command only, for whom the imports of all others take too long.

    Args:
        name: of the command, and of its module.
    """
    cli = _empty()
    # With a callback it is called by its name, as among others.
    cli.callback()(lambda: None)
    cli.command(name)(getattr(importlib.import_module(f"app.commands.{name}"), name))
    return cli


def _empty() -> typer.Typer:
    return typer.Typer(
        name="dynamic-observer",
        help="Sees moving obstacles from a moving robot with two cheap cameras.",
        no_args_is_help=True,
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
    )


def main(arguments: Sequence[str] | None = None, made: Callable[[], typer.Typer] = build) -> None:
    """Run the command line and exit.

    Args:
        made: makes it, once the environment is as native libraries are to find it.
    """
    for name, value in NATIVE_ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    try:
        code = made()(args=arguments, standalone_mode=False)
    except InputError as error:
        _leave(str(error), EXIT_INPUT)
    except DynamicObserverError as error:
        _leave(str(error), EXIT_FAILED)
    except TyperException as error:
        _leave(f"{error.format_message().rstrip('.')} (see --help)", EXIT_INPUT)
    except (KeyboardInterrupt, typer.Abort):
        _leave("interrupted", EXIT_INTERRUPTED)
    sys.exit(code if isinstance(code, int) else 0)


def _leave(sentence: str, code: int) -> None:
    print(f"dynamic-observer: {sentence}", file=sys.stderr)  # noqa: T201
    sys.exit(code)


if __name__ == "__main__":
    main()
