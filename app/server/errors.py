"""Why the server did not do what was asked; the web layer maps each to its status."""

from __future__ import annotations

from observer.errors import DynamicObserverError, InputError


class FieldError(InputError):
    """One value of a request cannot be used.

    Attributes:
        field: where it stands in the request, as in ``("body", "source")``.
    """

    def __init__(self, field: tuple[str, ...], sentence: str) -> None:
        self.field = field
        super().__init__(sentence)


class NotThere(DynamicObserverError):
    """What was asked for does not exist."""


class Conflict(DynamicObserverError):
    """Right in itself, but not possible in the present state."""


class NotAvailable(DynamicObserverError):
    """Not possible for the moment; the same request may succeed later."""
