"""Entry point ``python -m observer.kernels [PARENT]``: compile all kernels that are not yet.

With a process id, compiling stops when that process, the parent, ends; what is compiled stays.
"""

from __future__ import annotations

import sys

from observer.kernels.building import build
from observer.processes import die_with_parent

if __name__ == "__main__":
    if len(sys.argv) > 1:
        die_with_parent(int(sys.argv[1]))
    count, seconds = build()
    told = f"{count} kernels compiled in {seconds:.0f} s" if count else "all kernels are compiled"
    sys.stdout.write(f"{told}\n")
