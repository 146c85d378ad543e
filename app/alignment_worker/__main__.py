"""``python -m app.alignment_worker PARENT``: jobs from stdin, their results to stdout."""

from __future__ import annotations

import os
import sys

from app.processes.lifeline import die_with_parent

# Robots are driven, frames observed and pages served before this.
_NICENESS = 15


def main() -> None:
    """Do jobs until there are no more."""
    die_with_parent(int(sys.argv[1]))
    os.nice(_NICENESS)

    from app.alignment_worker.work import Aligner
    from app.channel.pipe import encode, load_message

    # Messages go out by this descriptor alone: what a library prints must not come between.
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    aligner = Aligner()
    while (job := load_message(sys.stdin.buffer)) is not None:
        out.write(encode(aligner.solve(job)))
        out.flush()


if __name__ == "__main__":
    main()
