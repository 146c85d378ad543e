"""Entry point ``python -m app.drive``.

Only ``app.drive.supervisor`` starts it, passing descriptors as arguments.
"""

from __future__ import annotations

import signal
import sys

from app.runtime.arguments import parse_arguments
from observer.processes import die_with_parent


def main() -> None:
    """Drive the robots that the library can open."""
    arguments = parse_arguments(sys.argv[1:], "drive")
    # Until the loop runs there is no robot to stop, so the signal ends the process.
    die_with_parent(arguments.parent, signal.SIGTERM)

    from app.drive.process import run_drive
    from observer.robot_opening import open_robot

    run_drive(arguments, open_robot=open_robot)


if __name__ == "__main__":
    main()
