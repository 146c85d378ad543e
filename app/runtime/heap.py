"""What a process keeps the garbage collector from looking through."""

from __future__ import annotations

import gc


def keep_for_good() -> None:
    """Never look again through what was made so far; call it when everything is imported.

    A collection of all objects stops every thread: a tenth of a second for the modules of the web
    process on a slow machine, which is half the time in which a command for a robot expires.
    """
    gc.collect()
    gc.freeze()
