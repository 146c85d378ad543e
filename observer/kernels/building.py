"""Compiles all kernels in advance, in separate processes, so that no frame has to wait."""

from __future__ import annotations

import contextlib
import importlib
import inspect
import os
import pkgutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from typing import IO, Any

import observer.kernels
from observer.kernels.compiled import Kernel
from observer.processes import die_with_parent

# Compiling processes; each takes some hundred megabytes.
_MOST_PROCESSES = 4
_NICENESS = 10

COMPILING = (
    "compiling the vision code for this computer's processor (once, about half a minute); "
    "sources open when it is done"
)


@cache
def every_kernel() -> dict[str, Kernel[..., Any]]:
    """Return all kernels by module and name."""
    found = {}
    for info in pkgutil.iter_modules(observer.kernels.__path__):
        if info.name in ("__main__", "building"):
            continue
        module = importlib.import_module(f"{observer.kernels.__name__}.{info.name}")
        for name, kernel in vars(module).items():
            if isinstance(kernel, Kernel) and kernel.function.__module__ == module.__name__:
                found[f"{info.name}.{name}"] = kernel
    return found


def make_ready(tell: Callable[[str], None]) -> None:
    """Load all kernels; have other processes compile missing ones first.

    Args:
        tell: called with a sentence saying that this takes a while, if it does.
    """
    missing = [kernel for kernel in every_kernel().values() if not kernel.load()]
    if not missing:
        return
    tell(COMPILING)
    # In a separate process, since this one may have to send heartbeats. Its failure is ignored:
    # kernels still missing are compiled below.
    subprocess.run(
        [sys.executable, "-P", "-m", observer.kernels.__name__, str(os.getpid())],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    for kernel in missing:
        kernel.ready()


def build() -> tuple[int, float]:
    """Compile all kernels that are not in the cache, in several processes.

    Returns:
        How many were compiled, and the seconds it took.
    """
    began = time.monotonic()
    with contextlib.suppress(OSError, AttributeError):
        os.nice(_NICENESS)
    with _alone():
        missing = [name for name, kernel in every_kernel().items() if not kernel.load()]
        # Longest first; compile time is roughly proportional to the module's length.
        missing.sort(key=lambda name: -_length(every_kernel()[name]))
        processes = min(_MOST_PROCESSES, os.cpu_count() or 1, len(missing))
        if processes:
            pool = ProcessPoolExecutor(
                processes,
                get_context("spawn"),
                # They would outlive this process if it were killed.
                initializer=die_with_parent,
                initargs=(os.getpid(),),
            )
            with pool:
                list(pool.map(_compile, missing))
    return len(missing), time.monotonic() - began


def _length(kernel: Kernel[..., Any]) -> int:
    return len(inspect.getsource(sys.modules[kernel.function.__module__]))


def _compile(name: str) -> None:
    every_kernel()[name].ready()


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """Keep other processes from compiling the same kernels; without file locks, both do."""
    with contextlib.ExitStack() as stack:
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            path = next(iter(every_kernel().values())).cache.lock_file
            file: IO[str] = stack.enter_context(open(path, "w"))
            fcntl.flock(file, fcntl.LOCK_EX)
        yield
