"""How the engine's process gets its memory from the system."""

from __future__ import annotations

import contextlib
import ctypes

# From malloc.h of the GNU C library.
_TRIM_THRESHOLD, _TOP_PAD, _MMAP_THRESHOLD = -1, -2, -3
# The most that it takes: what is larger is mapped from the system every time.
_LARGEST_KEPT = 32 << 20
_KEPT = 256 << 20
_STEP = 16 << 20


def keep_freed_memory() -> None:
    """Keep the memory of images that are let go of, in place of giving it back to the system.

    The GNU C library maps every larger array anew, and the system clears it page by page while all
    threads of the process that need memory wait. An engine needs as much again with the next
    frame. Elsewhere, as with musl, nothing changes. To be called before large arrays are made.
    """
    with contextlib.suppress(OSError, AttributeError):
        mallopt = ctypes.CDLL(None).mallopt
        mallopt(_MMAP_THRESHOLD, _LARGEST_KEPT)
        mallopt(_TRIM_THRESHOLD, _KEPT)
        mallopt(_TOP_PAD, _STEP)
