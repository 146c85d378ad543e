"""Errors in exporting."""

from __future__ import annotations

from observer.errors import InputError
from observer.version import install_command


class ExportError(InputError):
    """The recording lacks the data to export, or a required package is not installed."""


def missing_extra(package: str, extra: str, purpose: str) -> ExportError:
    """Return the error for an optional package that is not installed.

    Args:
        package: the missing one. extra: ours that installs it. purpose: what needs it.
    """
    return ExportError(
        f"{purpose} needs the package {package}, which is not installed; install it with: "
        f"{install_command(extra, package)}"
    )
