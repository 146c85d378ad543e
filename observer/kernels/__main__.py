"""Entry point ``python -m observer.kernels``: compile all kernels that are not compiled yet."""

from __future__ import annotations

import sys

from observer.kernels.building import build

if __name__ == "__main__":
    count, seconds = build()
    told = f"{count} kernels compiled in {seconds:.0f} s" if count else "all kernels are compiled"
    sys.stdout.write(f"{told}\n")
