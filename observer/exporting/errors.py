"""Errors of exporting."""

from __future__ import annotations

from observer.errors import InputError


class ExportError(InputError):
    """The recording does not hold what was asked for, or a package for it is not installed."""


def missing_extra(package: str, extra: str, purpose: str) -> ExportError:
    """Return the error for an optional package that is not installed.

    Args:
        package: what was imported. extra: of ours, which brings it. purpose: what needs it.
    """
    return ExportError(
        f"{purpose} needs the package {package}, which is not installed; install it with "
        f"pip install 'dynamic-observer[{extra}]'"
    )
