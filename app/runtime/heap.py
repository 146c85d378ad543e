"""Memory of a process: objects that are never collected, and freed blocks that are kept."""

from __future__ import annotations

import contextlib
import ctypes
import gc

# From malloc.h of the GNU C library.
_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD, _ARENA_MAX = -1, -2, -3, -8
# The largest value it accepts: larger blocks are mapped from the system every time.
_LARGEST_KEPT = 32 << 20
_KEPT = 256 << 20
_STEP = 16 << 20
_ARENAS = 2


def keep_for_good() -> None:
    """Exclude all objects made so far from collection; call it when everything is imported.

    A full collection stops every thread: a tenth of a second for the modules of the web process on
    a slow machine, which is half the time in which a command for a robot expires.
    """
    gc.collect()
    gc.freeze()


def keep_freed_memory() -> None:
    """Keep the memory of freed images instead of returning it to the system.

    The GNU C library maps every larger array anew, and the system clears it page by page while all
    threads of the process that need memory wait. An engine needs the same amount again with the
    next frame.

    Threads share two arenas. The library gives each one of its own, up to eight for each core, and
    each keeps the largest amount that it ever held: the threads of every source that is opened
    would add to it for hours.

    Elsewhere, as with musl, nothing changes. Call this before large arrays are made.
    """
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_TRIM_THRESHOLD, _KEPT)
        mallopt(_TOP_PAD, _STEP)
        mallopt(_ARENA_MAX, _ARENAS)


def return_freed_memory() -> None:
    """Return what is free to the system; call it when much that was in use is not any more.

    What lies between blocks that stay is returned as well. Otherwise each busy moment, with more
    frames in flight than ever before, would leave the process larger for good. Takes milliseconds.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
