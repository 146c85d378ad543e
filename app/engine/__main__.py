"""Entry point ``python -m app.engine``.

Only ``app.engine.supervisor`` starts it, passing descriptors as arguments.
"""

from __future__ import annotations

import os
import sys

from app.runtime.arguments import parse_arguments
from app.runtime.heap import keep_freed_memory
from observer.processes import die_with_parent


def main() -> None:
    """Run the engine with the library's sources and observer."""
    arguments = parse_arguments(sys.argv[1:])
    # Do this first: the imports below take long enough for the parent to die meanwhile.
    die_with_parent(arguments.parent)

    keep_freed_memory()

    import cv2

    from app.engine.process import run_engine
    from observer.kernels.building import make_ready
    from observer.observer import Observer
    from observer.opening import open_source

    # Two threads halve the stereo matching time on two idle cores and cost nothing on busy ones.
    # More than four gain nothing at this image size, and the web process needs a core too.
    cv2.setNumThreads(min(4, os.cpu_count() or 1))
    run_engine(arguments, open_source=open_source, make_observer=Observer, prepare=make_ready)


if __name__ == "__main__":
    main()
