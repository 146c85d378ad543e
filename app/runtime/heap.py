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

    A full collection stops every thread. For the modules of the web process it takes a tenth of a
    second on a slow machine, which is half the lifetime of a robot command.
    """
    gc.collect()
    gc.freeze()


def keep_freed_memory() -> None:
    """Keep the memory of freed images instead of returning it to the system.

    By default the GNU C library maps every large array anew, and the system clears it page by page
    while all threads of the process that need memory wait. An engine needs the same amount again
    for the next frame.

    This also limits the threads to two shared arenas. By default the library gives each thread its
    own, up to eight per core, and an arena never shrinks below its peak: the threads of each source
    opened would add to the total for hours.

    With other C libraries, such as musl, nothing changes. Call this before large arrays are made.
    """
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_TRIM_THRESHOLD, _KEPT)
        mallopt(_TOP_PAD, _STEP)
        mallopt(_ARENA_MAX, _ARENAS)


def return_freed_memory() -> None:
    """Return free memory to the system; call it after much memory was freed.

    Free memory between blocks still in use is returned as well. Otherwise each new peak of frames
    in flight would leave the process larger permanently. Takes milliseconds.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
