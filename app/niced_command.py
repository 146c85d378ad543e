"""Runs one command for the server, behind everything else that wants the processor.

Started as ``python -m app.niced_command PARENT MODULE ARGUMENT...``; it ends with its parent.
``MODULE`` is ``app.cli``, of which only the command is imported, or any other.
"""

from __future__ import annotations

import os
import runpy
import sys
from functools import partial

# Behind the engine and the drive process, whose loops must not notice it.
_NICENESS = 15
_CLI = "app.cli"


def main() -> None:
    """Run it as ``python -m MODULE`` would."""
    from app.cli import build_one
    from app.cli import main as command_line
    from app.processes.lifeline import die_with_parent

    parent, module, *arguments = sys.argv[1:]
    die_with_parent(int(parent))
    os.nice(_NICENESS)
    if module == _CLI:
        command_line(arguments, partial(build_one, arguments[0]))
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
