"""The installed version of this project, and how to install the packages it can do without."""

from __future__ import annotations

import functools
import importlib.metadata
import shlex
import sys

_WHOLE = "dynamic-observer"
_LIBRARY = "dynamic-observer-library"


@functools.cache
def library_version() -> str:
    """Return the installed version; ``source`` if the code runs from a bare source tree."""
    return _version(_WHOLE) or _version(_LIBRARY) or "source"


def install_command(extra: str, *packages: str) -> str:
    """Return the command that installs an extra into the Python in use.

    The distribution of the library alone has no extras: there it names the packages.

    Args:
        extra: of the complete distribution. packages: those that it installs.
    """
    return pip_install(*packages) if _version(_WHOLE) is None else pip_install(f"{_WHOLE}[{extra}]")


def package_missing(purpose: str, package: str, extra: str) -> str:
    """Return one sentence on how to install an optional package.

    Args:
        purpose: what needs it. extra: of the complete distribution, which installs it.
    """
    return (
        f"{purpose} needs the package {package}, which is not installed; install it with: "
        f"{install_command(extra, package)}"
    )


def pip_install(*packages: str) -> str:
    """Return the command that installs packages into the Python in use.

    A plain ``pip`` may belong to another Python.
    """
    return shlex.join([sys.executable, "-m", "pip", "install", *packages])


def _version(distribution: str) -> str | None:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return None
