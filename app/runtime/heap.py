"""Exclusion of long-lived objects from garbage collection."""

from __future__ import annotations

import gc


def keep_for_good() -> None:
    """Exclude all objects made so far from collection; call it when everything is imported.

    A full collection stops every thread: a tenth of a second for the modules of the web process on
    a slow machine, which is half the time in which a command for a robot expires.
    """
    gc.collect()
    gc.freeze()
