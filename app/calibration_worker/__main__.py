"""``python -m app.calibration_worker PARENT``: one job from stdin, messages to stdout."""

from __future__ import annotations

import os
import sys

from app.processes.lifeline import die_with_parent

_NICENESS = 5


def main() -> None:
    """Read the job, do it, and leave."""
    die_with_parent(int(sys.argv[1]))
    # The engine's loop and the server go first.
    os.nice(_NICENESS)

    from app.calibration_worker.work import do_job
    from app.channel.pipe import encode, load_message

    # Messages go out by this descriptor alone: what a library prints must not come between.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    job = load_message(sys.stdin.buffer)
    if job is None:
        # Who asked is gone.
        return

    def send(message: object) -> None:
        out.write(encode(message))
        out.flush()

    do_job(job, send)


if __name__ == "__main__":
    main()
