"""Errors of exporting."""

from __future__ import annotations

from observer.errors import InputError


class ExportError(InputError):
    """Export of what a recording does not hold, or without a package that it needs."""


def missing_extra(package: str, extra: str, purpose: str) -> ExportError:
    """Return the error for an optional package that is not installed.

    Args:
        package: what was imported. extra: of ours, which brings it. purpose: what needs it.
    """
    return ExportError(
        f"{purpose} needs the package {package}, which is not installed; install it with: pip "
        f"install 'dynamic-observer[{extra}]'"
    )
