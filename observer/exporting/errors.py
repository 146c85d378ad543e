"""Errors in exporting."""

from __future__ import annotations

from observer.errors import InputError


class ExportError(InputError):
    """The recording lacks the data to export, or a required package is not installed."""
