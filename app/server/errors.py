"""Reasons why the server refused a request; the web layer maps each to its status."""

from __future__ import annotations

from observer.errors import DynamicObserverError, InputError


class FieldError(InputError):
    """Unusable value in a request.

    Attributes:
        field: its place in the request, such as ``("body", "source")``.
    """

    def __init__(self, field: tuple[str, ...], sentence: str) -> None:
        self.field = field
        super().__init__(sentence)


class NotThere(DynamicObserverError):
    """Request for an object that does not exist."""


class Conflict(DynamicObserverError):
    """Valid request that is not possible in the present state."""


class NotAvailable(DynamicObserverError):
    """Request that is not possible at the moment; the same request may succeed later."""
