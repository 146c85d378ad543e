"""Runner of a module as a worker.

``python -m app.runtime.worker_main PARENT NICENESS MODULE ARGUMENT...`` runs it like ``python -m
MODULE ARGUMENT...``, but niced and only as long as its parent lives.
"""

from __future__ import annotations

import os
import runpy
import sys

from observer.processes import die_with_parent


def main() -> None:
    """Become a worker before running the module, whose imports take seconds."""
    parent, niceness, module, *arguments = sys.argv[1:]
    die_with_parent(int(parent))
    os.nice(int(niceness))
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
