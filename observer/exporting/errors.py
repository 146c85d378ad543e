"""Errors in exporting."""

from __future__ import annotations

from observer.errors import InputError
from observer.version import package_missing


class ExportError(InputError):
    """The recording lacks the data to export, or a required package is not installed."""


def missing_extra(package: str, extra: str, purpose: str) -> ExportError:
    """Return the error for an optional package that is not installed.

    Args:
        package: the missing one. extra: ours that installs it. purpose: what needs it.
    """
    return ExportError(package_missing(purpose, package, extra))
