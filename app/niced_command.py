"""Runs one module for the server, behind everything else that wants the processor.

Started as ``python -m app.niced_command PARENT MODULE ARGUMENT...``; it ends with its parent.
"""

from __future__ import annotations

import os
import runpy
import sys

# Behind the engine and the drive process, whose loops must not notice it.
_NICENESS = 15


def main() -> None:
    """Run the module as ``python -m MODULE`` would."""
    from app.processes.lifeline import die_with_parent

    parent, module, *arguments = sys.argv[1:]
    die_with_parent(int(parent))
    os.nice(_NICENESS)
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
