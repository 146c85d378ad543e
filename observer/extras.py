"""Installation of the packages that this project can do without, its *extras*."""

from __future__ import annotations

import shlex
import sys

from observer.version import COMPLETE, installed_version


def package_missing(purpose: str, extra: str, *packages: str) -> str:
    """Return one sentence on how to install what is missing.

    Args:
        purpose: what needs it. extra: of the complete distribution, which installs it.
        packages: the missing ones, as pip takes them.
    """
    names = " and ".join(package.partition("[")[0] for package in packages)
    several = len(packages) > 1
    return (
        f"{purpose} needs the package{'s' if several else ''} {names}, "
        f"{'which are' if several else 'which is'} not installed; "
        f"install {'them' if several else 'it'} with: {install_command(extra, *packages)}"
    )


def install_command(extra: str, *packages: str) -> str:
    """Return the command that installs an extra into the Python in use.

    The distribution of the library alone has no extras: there it names the packages.

    Args:
        extra: of the complete distribution. packages: those that it installs.
    """
    if installed_version(COMPLETE) is None:
        return pip_install(*packages)
    return pip_install(f"{COMPLETE}[{extra}]")


def pip_install(*packages: str) -> str:
    """Return the command that installs packages into the Python in use.

    A plain ``pip`` may belong to another Python.
    """
    return shlex.join([sys.executable, "-m", "pip", "install", *packages])
